//! The forces on the fin against what they must be by their own definition: gradients of energies, exact
//! balances of power and momentum, symmetries.

use rodgym_core::fin::plant::{Design, Scheme};
use rodgym_core::fin::{Fin, Forces, Geometry, Parameters};
use rodgym_core::fluid::Hydrodynamics;
use rodgym_core::seed::Stream;

type Nodes = Vec<[f64; 2]>;

fn fin(hydrodynamics: Hydrodynamics, parameters: Parameters) -> Fin {
    let design = Design {
        geometry: Geometry::thesis(),
        hydrodynamics,
        scheme: Scheme::Bdf2,
        physics_dt: 1e-3,
        free_swimming: false,
    };
    Fin::new(design, parameters).expect("allowed")
}

/// A strongly bent and stretched fin in rapid motion.
fn motion(stream: &mut Stream) -> (Nodes, Nodes) {
    let mut x = [-0.04, 0.0];
    let mut angle = stream.uniform(-0.5, 0.5);
    let mut positions = vec![x];
    for _ in 0..7 {
        angle += stream.uniform(-0.4, 0.4);
        let length = 0.02 * stream.uniform(0.9, 1.1);
        x = [x[0] + length * angle.cos(), x[1] + length * angle.sin()];
        positions.push(x);
    }
    let mut draw = || [stream.uniform(-0.3, 0.3), stream.uniform(-0.3, 0.3)];
    let velocities = (0..8).map(|_| draw()).collect();
    (positions, velocities)
}

fn forces(fin: &Fin, x: &Nodes, v: &Nodes) -> Forces {
    fin.forces(x, v).expect("finite")
}

/// Central difference of a function of the forces as coordinate `c` of node `i` of `array` moves.
fn slope(array: &Nodes, i: usize, c: usize, f: impl Fn(&Nodes) -> f64) -> f64 {
    let at = |step: f64| {
        let mut moved = array.clone();
        moved[i][c] += step;
        f(&moved)
    };
    let h = 1e-5;
    // Fourth order, so that rounding and truncation both stay below 1e-9 of the force.
    (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)
}

fn assert_close(what: &str, ours: f64, exact: f64, scale: f64, tolerance: f64) {
    let error = (ours - exact).abs() / exact.abs().max(scale);
    assert!(error < tolerance, "{what}: {ours} against {exact}, off by {error:.1e}");
}

fn dot(a: &Nodes, b: &Nodes) -> f64 {
    a.iter().zip(b).map(|(p, q)| p[0] * q[0] + p[1] * q[1]).sum()
}

#[test]
fn forces_are_gradients_of_the_energies() {
    let fin = fin(Hydrodynamics::Lighthill, Parameters::default());
    let mut stream = Stream::new(1);
    for _ in 0..5 {
        let (x, v) = motion(&mut stream);
        let here = forces(&fin, &x, &v);
        for i in 0..8 {
            for c in 0..2 {
                let elastic = -slope(&x, i, c, |x| forces(&fin, x, &v).elastic_energy);
                assert_close("elastic", here.elastic[i][c], elastic, 10.0, 1e-7);
                let gradient = slope(&x, i, c, |x| forces(&fin, x, &v).fluid_energy);
                assert_close("dT/dq", here.fluid_gradient[i][c], gradient, 0.1, 1e-8);
                let momentum = slope(&v, i, c, |v| forces(&fin, &x, v).fluid_energy);
                assert_close("p_f", here.fluid_momentum[i][c], momentum, 1e-2, 1e-9);
            }
        }
    }
}

/// Power of the reactive force + rate of the water's kinetic energy + what the tail sheds = 0, exactly: along
/// any motion V(t) = V + t A, with d p_f/dt from p_f being linear in V and the chain rule in q.
#[test]
fn power_of_the_water_balances_to_rounding() {
    let still = Parameters { flow_speed: 0.0, ..Parameters::default() };
    let fin = fin(Hydrodynamics::Lighthill, still);
    let mut stream = Stream::new(2);
    for _ in 0..20 {
        let (x, v) = motion(&mut stream);
        let (_, a) = motion(&mut stream);
        let here = forces(&fin, &x, &v);
        let at = |t: f64| {
            let along = |p: &Nodes, q: &Nodes, s: f64| -> Nodes {
                p.iter().zip(q).map(|(p, q)| [p[0] + s * q[0], p[1] + s * q[1]]).collect()
            };
            forces(&fin, &along(&along(&x, &v, t), &a, 0.5 * t * t), &along(&v, &a, t))
        };
        let h = 1e-4;
        let derivative = |f: &dyn Fn(&Forces) -> f64| {
            let d = |s: f64| f(&at(s)) - f(&at(-s));
            (8.0 * d(h) - d(2.0 * h)) / (12.0 * h)
        };
        let momentum_rate = derivative(&|f| dot(&f.fluid_momentum, &v));
        let reactive = -momentum_rate + dot(&here.fluid_gradient, &v) + dot(&here.tail_flux, &v);
        let energy_rate = derivative(&|f| f.fluid_energy);
        // Water that slides off the tail takes m w^2/2 per metre of it along: u < 0 when the fin moves on.
        let edge = [x[7][0] - x[6][0], x[7][1] - x[6][1]];
        let length = edge[0].hypot(edge[1]);
        let (u, w) = (
            (v[7][0] * edge[0] + v[7][1] * edge[1]) / length,
            (v[7][1] * edge[0] - v[7][0] * edge[1]) / length,
        );
        let mass = 0.5 * 1000.0 * std::f64::consts::PI * 0.115 * 0.115 / 4.0;
        let shed = -0.5 * mass * u * w * w;
        let scale = energy_rate.abs() + shed.abs() + reactive.abs();
        assert!(
            (reactive + energy_rate + shed).abs() < 1e-9 * scale,
            "{reactive} {energy_rate} {shed}"
        );
        // What the tail loses is the power of G itself, without any differentiation: to rounding.
        assert_close("G . V", dot(&here.tail_flux, &v), -shed, 1e-3, 1e-13);
        let lost = dot(&here.resistive, &v);
        assert!(lost < 0.0, "resistance gives power {lost}");
    }
}

/// Momentum: internal forces add up to nothing, and neither does dT_f/dq.
#[test]
fn interior_forces_cancel() {
    let fin = fin(Hydrodynamics::Lighthill, Parameters::default());
    let (x, v) = motion(&mut Stream::new(3));
    let here = forces(&fin, &x, &v);
    for c in 0..2 {
        for (what, column) in [("elastic", &here.elastic), ("dT/dq", &here.fluid_gradient)] {
            let sum: f64 = column.iter().map(|f| f[c]).sum();
            let largest = column.iter().map(|f| f[c].abs()).fold(0.0, f64::max);
            assert!(sum.abs() < 1e-13 * largest, "{what}: {sum} of {largest}");
        }
        assert!(here.tail_flux[..7].iter().all(|f| f[c] == 0.0), "flux belongs to the tail");
    }
}

#[test]
fn forces_are_mirror_symmetric() {
    let fin = fin(Hydrodynamics::Lighthill, Parameters::default());
    let mirror = |a: &Nodes| -> Nodes { a.iter().map(|p| [p[0], -p[1]]).collect() };
    let (x, v) = motion(&mut Stream::new(4));
    let (here, there) = (forces(&fin, &x, &v), forces(&fin, &mirror(&x), &mirror(&v)));
    for (a, b) in [
        (&here.elastic, &there.elastic),
        (&here.fluid_momentum, &there.fluid_momentum),
        (&here.fluid_gradient, &there.fluid_gradient),
        (&here.tail_flux, &there.tail_flux),
        (&here.resistive, &there.resistive),
    ] {
        assert_eq!(mirror(a), *b);
    }
    assert_eq!(here.fluid_energy, there.fluid_energy);
}

/// Only velocity relative to the water counts.
#[test]
fn forces_are_the_same_in_a_moving_laboratory() {
    let flow = fin(Hydrodynamics::Lighthill, Parameters { flow_speed: 0.25, ..Default::default() });
    let still = fin(Hydrodynamics::Lighthill, Parameters { flow_speed: 0.0, ..Default::default() });
    let (x, v) = motion(&mut Stream::new(5));
    let shifted: Nodes = v.iter().map(|p| [p[0] - 0.25, p[1]]).collect();
    assert_eq!(forces(&flow, &x, &v), forces(&still, &x, &shifted));
}

#[test]
fn a_fin_at_rest_in_still_water_feels_nothing_and_stays() {
    let still = Parameters { flow_speed: 0.0, ..Parameters::default() };
    for (_, model) in Hydrodynamics::NAMES {
        let mut fin = fin(model, still);
        fin.step(0.0, 200).expect("nothing moves");
        let loads = *fin.loads();
        for value in [loads.thrust, loads.mount_thrust, loads.torque, loads.power] {
            assert!(value.abs() < 1e-12, "{model:?}: {value}");
        }
        assert!(fin.velocities().iter().flatten().all(|&v| v.abs() < 1e-12));
    }
    // In a flow along it, a straight fin feels friction alone, and no torque.
    let mut fin = fin(Hydrodynamics::Lighthill, Parameters::default());
    fin.step(0.0, 200).expect("the flow is steady");
    let perimeters: f64 = Geometry::thesis().perimeters().iter().sum();
    let friction = 0.5 * 1000.0 * 0.016 * 0.05 * 0.05 * perimeters * 0.02;
    assert_close("friction", fin.loads().thrust, -friction, 1e-4, 1e-3);
    assert!(fin.loads().torque.abs() < 1e-15);
}

#[test]
fn models_drop_the_terms_that_they_say() {
    let (x, v) = motion(&mut Stream::new(6));
    let of = |model| forces(&fin(model, Parameters::default()), &x, &v);
    let (full, morison) = (of(Hydrodynamics::Lighthill), of(Hydrodynamics::Morison));
    let (resistive, air) = (of(Hydrodynamics::Resistive), of(Hydrodynamics::Air));
    let zero = vec![[0.0; 2]; 8];
    assert_eq!(Forces { tail_flux: zero.clone(), ..full.clone() }, morison);
    assert_eq!(resistive.resistive, full.resistive);
    assert_eq!((&resistive.fluid_momentum, &resistive.fluid_gradient), (&zero, &zero));
    assert_eq!((&air.resistive, air.fluid_energy), (&zero, 0.0));
    assert_eq!(air.elastic, full.elastic);
}
