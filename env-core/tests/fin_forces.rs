//! The forces on the fin against what they must be by their own definition: gradients of energies, exact
//! balances of power and momentum, symmetries.

use rodgym_core::fin::Design;
use rodgym_core::fin::Scheme;
use rodgym_core::fin::{BareFin, Forces, Geometry, Parameters};
use rodgym_core::fluid::Hydrodynamics;
use rodgym_core::seed::Stream;
use rodgym_core::simulation::Simulation;

type Nodes = Vec<[f64; 2]>;

fn fin(hydrodynamics: Hydrodynamics, parameters: Parameters) -> BareFin {
    let design = Design {
        geometry: Geometry::thesis(),
        hydrodynamics,
        scheme: Scheme::Bdf2,
        physics_dt: 1e-3,
        free_swimming: false,
    };
    BareFin::new(design, parameters).expect("allowed")
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

fn forces(fin: &BareFin, x: &Nodes, v: &Nodes) -> Forces {
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

/// Motion of one edge as the theory has it, written apart from the code under test: everything about the
/// straight line from `a` to `b` whose ends have velocities `v` and accelerations `acc` relative to the water.
struct Line {
    length: f64,
    tangent: [f64; 2],
    normal: [f64; 2],
    u: [f64; 2],
    w: [f64; 2],
    length_rate: f64,
    turn_rate: f64,
    w_rate: [f64; 2],
}

fn line(x: [[f64; 2]; 2], v: [[f64; 2]; 2], acc: [[f64; 2]; 2]) -> Line {
    let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
    let e = [x[1][0] - x[0][0], x[1][1] - x[0][1]];
    let length = e[0].hypot(e[1]);
    let tangent = [e[0] / length, e[1] / length];
    let normal = [-tangent[1], tangent[0]];
    let u = v.map(|v| dot(v, tangent));
    let w = v.map(|v| dot(v, normal));
    let turn_rate = (w[1] - w[0]) / length;
    // n' = -turn_rate t, so w' = a . n - turn_rate u.
    let w_rate = [dot(acc[0], normal) - turn_rate * u[0], dot(acc[1], normal) - turn_rate * u[1]];
    Line { length, tangent, normal, u, w, length_rate: u[1] - u[0], turn_rate, w_rate }
}

/// Power of the reactive force + rate of the water's kinetic energy + what the tail sheds = 0, exactly. The rate
/// of p_f and of T_f under any acceleration are taken by the rules of differentiation, edge by edge, so that
/// nothing but rounding is left.
#[test]
fn power_of_the_water_balances_to_rounding() {
    let still = Parameters { flow_speed: 0.0, ..Parameters::default() };
    let fin = fin(Hydrodynamics::Lighthill, still);
    let mass = 0.5 * 1000.0 * std::f64::consts::PI * 0.115 * 0.115 / 4.0;
    let mut stream = Stream::new(2);
    for _ in 0..100 {
        let (x, v) = motion(&mut stream);
        let acc: Nodes = motion(&mut stream).1.iter().map(|a| [30.0 * a[0], 30.0 * a[1]]).collect();
        let here = forces(&fin, &x, &v);
        let (mut momentum, mut rate) = (vec![[0.0; 2]; 8], vec![[0.0; 2]; 8]);
        let (mut energy, mut energy_rate) = (0.0, 0.0);
        for k in 0..7 {
            let edge = line([x[k], x[k + 1]], [v[k], v[k + 1]], [acc[k], acc[k + 1]]);
            let share = |w: [f64; 2]| [(2.0 * w[0] + w[1]) / 6.0, (w[0] + 2.0 * w[1]) / 6.0];
            let (p, dp) = (share(edge.w), share(edge.w_rate));
            for end in 0..2 {
                let along_n = mass * (edge.length_rate * p[end] + edge.length * dp[end]);
                let along_t = -mass * edge.length * p[end] * edge.turn_rate;
                for c in 0..2 {
                    momentum[k + end][c] += mass * edge.length * p[end] * edge.normal[c];
                    rate[k + end][c] += along_n * edge.normal[c] + along_t * edge.tangent[c];
                }
            }
            let square = p[0] * edge.w[0] + p[1] * edge.w[1];
            energy += 0.5 * mass * edge.length * square;
            let rises = p[0] * edge.w_rate[0] + p[1] * edge.w_rate[1];
            energy_rate += 0.5 * mass * edge.length_rate * square + mass * edge.length * rises;
        }
        assert_close("T_f", here.fluid_energy, energy, 1e-9, 1e-13);
        for (ours, theirs) in here.fluid_momentum.iter().zip(&momentum) {
            assert_close("p_f", ours[0], theirs[0], 1e-3, 1e-12);
            assert_close("p_f", ours[1], theirs[1], 1e-3, 1e-12);
        }
        let terms = [-dot(&rate, &v), dot(&here.fluid_gradient, &v), dot(&here.tail_flux, &v)];
        // Water that slides off the tail takes m w^2/2 per metre of it along: u < 0 when the fin moves on.
        let tail = line([x[6], x[7]], [v[6], v[7]], [[0.0; 2]; 2]);
        let shed = -0.5 * mass * tail.u[1] * tail.w[1] * tail.w[1];
        let balance = terms.iter().sum::<f64>() + energy_rate + shed;
        let scale = terms.iter().map(|t| t.abs()).sum::<f64>() + energy_rate.abs() + shed.abs();
        assert!(balance.abs() < 1e-14 * scale.max(1e-3), "{balance} of {scale}");
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

/// A fin that is pitched the other way moves and pulls as the mirror image does, to the bit.
#[test]
fn motion_is_mirror_symmetric() {
    let (mut left, mut right) = (
        fin(Hydrodynamics::Lighthill, Parameters::default()),
        fin(Hydrodynamics::Lighthill, Parameters::default()),
    );
    for k in 1..=400 {
        let pitch = 0.3 * (0.02 * f64::from(k)).sin() + 0.05 * (0.11 * f64::from(k)).sin();
        left.step(pitch, 1).expect("solved");
        right.step(-pitch, 1).expect("solved");
        let mirrored: Nodes = right.positions().iter().map(|p| [p[0], -p[1]]).collect();
        assert_eq!(left.positions(), mirrored, "step {k}");
        let (a, b) = (left.loads(), right.loads());
        assert_eq!((a.thrust, a.torque, a.power), (b.thrust, -b.torque, b.power), "step {k}");
    }
}

/// Without damping relative to the laboratory, a fin towed through water at rest by a very heavy hull
/// moves as one that is held in a flow of that speed; with damping it does not.
#[test]
fn a_towed_fin_moves_as_one_in_a_flow() {
    let speed = 0.2;
    let gap = |damping: f64| {
        let held = Parameters { flow_speed: speed, damping, ..Parameters::default() };
        let mut held = fin(Hydrodynamics::Lighthill, held);
        let towed = Parameters { hull_mass: 1000.0, hull_drag_area: 0.0, damping, ..held_still() };
        let design = Design { free_swimming: true, ..held.design().clone() };
        let mut towed = BareFin::new(design, towed).expect("allowed");
        let start = towed.positions();
        towed.set_state(&start, &[[-speed, 0.0]; 8]).expect("a straight fin on its way");
        let (mut worst, mut largest) = (0.0f64, 0.0f64);
        for k in 1..=500 {
            let pitch = 0.2 * (0.012 * f64::from(k)).sin();
            held.step(pitch, 1).expect("solved");
            towed.step(pitch, 1).expect("solved");
            let (a, b) = (held.loads().thrust, towed.loads().thrust);
            worst = worst.max((a - b).abs());
            largest = largest.max(a.abs());
        }
        worst / largest
    };
    let (without, with) = (gap(0.0), gap(0.1238));
    assert!(without < 2e-3, "thrust differs by {without}");
    assert!(with > 10.0 * without, "damping should tell the laboratory: {with}");
}

fn held_still() -> Parameters {
    Parameters { flow_speed: 0.0, ..Parameters::default() }
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
    let perimeters: f64 = Geometry::thesis().perimeters().sum();
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
