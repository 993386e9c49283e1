//! The rod against theory: exact derivatives, conserved quantities, Euler-Bernoulli beams, Greenhill's
//! column, a large-deflection elastica.

use nalgebra::{DMatrix, DVector};
use rodgym_core::linear::Banded;
use rodgym_core::rod::{Motion, Rod, Uniform, add_stiffness, energy, forces, linearize};
use rodgym_core::seed::Stream;
use rodgym_core::solver::{Constant, Integrator, Scheme};
use rodgym_core::vec2::Vec2;

fn uniform(nodes: usize) -> Uniform {
    Uniform {
        nodes,
        length: 0.3,
        width: 0.007,
        density: 1500.0,
        youngs_modulus: 1e7,
        damping: 0.02,
        bending_damping: 5e-4,
        gravity: 9.81,
    }
}

/// A rod in a random, strongly bent and stretched motion.
fn tangled(nodes: usize, seed: u64) -> (Rod<f64>, Vec<Vec2<f64>>, Vec<Vec2<f64>>) {
    let mut stream = Stream::new(seed);
    let rod = uniform(nodes).rod();
    let mut x = vec![Vec2::zero(); nodes];
    let mut angle = 0.3;
    for i in 1..nodes {
        angle += stream.uniform(-1.2, 1.2);
        let length = rod.rest[i - 1] * stream.uniform(0.9, 1.1);
        x[i] = x[i - 1] + Vec2::new(libm::sin(angle), -libm::cos(angle)).scale(length);
    }
    let mut draw = || Vec2::new(stream.uniform(-1.0, 1.0), stream.uniform(-1.0, 1.0));
    let v = (0..nodes).map(|_| draw()).collect();
    (rod, x, v)
}

fn coordinate(list: &mut [Vec2<f64>], j: usize) -> &mut f64 {
    if j.is_multiple_of(2) { &mut list[j / 2].x } else { &mut list[j / 2].y }
}

fn flat(list: &[Vec2<f64>]) -> Vec<f64> {
    list.iter().flat_map(|p| [p.x, p.y]).collect()
}

#[test]
fn conservative_forces_are_minus_the_gradient_of_the_energies() {
    for seed in 0..20 {
        let (mut rod, x, _) = tangled(7, seed);
        rod.damping = 0.0;
        let rest = vec![Vec2::zero(); 7];
        let mut force = rest.clone();
        forces(&rod, &x, &rest, &mut force);
        let step = 1e-6;
        for j in 0..14 {
            let at = |d: f64| {
                let mut moved = x.clone();
                *coordinate(&mut moved, j) += d;
                energy(&rod, &moved, &rest).total()
            };
            let slope = (at(step) - at(-step)) / (2.0 * step);
            let found = flat(&force)[j];
            assert!((found + slope).abs() < 1e-6 * (1.0 + slope.abs()), "{found} against {slope}");
        }
    }
}

/// Positions and velocities both move, velocities at `rate` times the positions, as in an implicit step.
#[test]
fn stiffness_is_the_derivative_of_the_forces() {
    let (torque, rate, step) = (0.04, 300.0, 1e-7);
    for seed in 0..20 {
        let (rod, x, v) = tangled(7, seed);
        let mut matrix = Banded::new(6);
        add_stiffness(&rod, &x, &v, torque, rate, 1, &mut matrix);
        let at = |j: usize, d: f64| {
            let (mut x, mut v) = (x.clone(), v.clone());
            *coordinate(&mut x, j) += d;
            *coordinate(&mut v, j) += rate * d;
            let mut force = vec![Vec2::zero(); 7];
            let shape = forces(&rod, &x, &v, &mut force);
            force[1] += shape.base.scale(torque);
            flat(&force)
        };
        for j in 2..14 {
            let (up, down) = (at(j, step), at(j, -step));
            for i in 2..14 {
                let slope = (up[i] - down[i]) / (2.0 * step);
                let found = matrix.get(i - 2, j - 2);
                let close = (found + slope).abs() < 1e-5 * (1.0 + slope.abs());
                assert!(close, "seed {seed} ({i}, {j}): {found} against {}", -slope);
            }
        }
    }
}

/// Newton's method takes forces from the sweep that makes the derivative, the explicit stepper from its own.
#[test]
fn both_sweeps_give_the_same_forces() {
    for nodes in [2, 3, 7, 20] {
        let (rod, x, v) = tangled(nodes, nodes as u64);
        let torque = 0.04;
        let mut expected = vec![Vec2::zero(); nodes];
        let shape = forces(&rod, &x, &v, &mut expected);
        expected[0] -= shape.base.scale(torque);
        expected[1] += shape.base.scale(torque);
        let size = expected.iter().map(|f| f.dot(*f).sqrt()).fold(0.0, f64::max);
        let mut sweep = linearize(&rod, &x, &v, torque, 300.0);
        for (i, expected) in expected.iter().enumerate() {
            let gap = sweep.next().expect("one item a node").0 - *expected;
            assert!(gap.dot(gap).sqrt() < 1e-13 * size, "node {i} of {nodes}: {gap:?} of {size}");
        }
        assert!(sweep.next().is_none());
        assert!((sweep.shape.openness - shape.openness).abs() < 1e-14);
    }
}

/// A rod that nothing holds keeps its momentum and its angular momentum, bending damping included.
#[test]
fn inner_forces_balance_and_have_no_moment() {
    for seed in 0..20 {
        let (mut rod, x, v) = tangled(9, seed);
        rod.gravity = 0.0;
        rod.damping = 0.0;
        let mut force = vec![Vec2::zero(); 9];
        forces(&rod, &x, &v, &mut force);
        let size: f64 = force.iter().map(|f| f.dot(*f).sqrt()).sum();
        let sum = force.iter().fold(Vec2::zero(), |a, f| a + *f);
        let moment: f64 = x.iter().zip(&force).map(|(x, f)| x.cross(*f)).sum();
        assert!(sum.dot(sum).sqrt() < 1e-13 * size, "force {sum:?} of {size}");
        assert!(moment.abs() < 1e-13 * size, "moment {moment}");
    }
}

#[test]
fn damping_only_takes_energy() {
    for seed in 0..50 {
        let (mut rod, x, v) = tangled(7, seed);
        let mut damped = vec![Vec2::zero(); 7];
        forces(&rod, &x, &v, &mut damped);
        (rod.damping, rod.bend_damping) = (0.0, vec![0.0; 7]);
        let mut free = damped.clone();
        forces(&rod, &x, &v, &mut free);
        let power: f64 = (0..7).map(|i| (damped[i] - free[i]).dot(v[i])).sum();
        assert!(power < 0.0, "power {power} W");
    }
}

#[test]
fn verlet_energy_does_not_drift_over_a_minute() {
    let rod = Uniform { damping: 0.0, bending_damping: 0.0, ..uniform(7) }.rod();
    let mut motion = Motion::new(7);
    for i in 0..7 {
        motion.x[i] = Vec2::new(0.05 * i as f64, 0.0);
    }
    Integrator::<f64>::prepare(Scheme::Verlet, &rod, &mut motion);
    let mut integrator = Integrator::new(Scheme::Verlet, 2e-4, 7);
    let swing = 1500.0 * 0.007 * 0.007 * 0.3 * 9.81 * 0.15;
    let mut worst: [f64; 2] = [0.0; 2];
    for second in 0..60 {
        for _ in 0..50 {
            assert!(integrator.advance(&rod, &mut motion, &Constant(0.0), 100));
            let off = energy(&rod, &motion.x, &motion.v).total().abs() / swing;
            worst[second / 30] = worst[second / 30].max(off);
        }
    }
    assert!(worst[0] < 2e-3, "error of the first half minute: {worst:?}");
    assert!(worst[1] < 1.5 * worst[0], "it grows: {worst:?}");
}

/// Natural frequencies \[rad/s\] about a straight rod along E2, the first `held` nodes fixed.
fn frequencies(uniform: &Uniform, held: usize) -> Vec<f64> {
    let rod = Uniform { damping: 0.0, bending_damping: 0.0, ..*uniform }.rod();
    let nodes = uniform.nodes;
    let x: Vec<_> = (0..nodes).map(|i| Vec2::new(0.0, uniform.edge() * i as f64)).collect();
    let v = vec![Vec2::zero(); nodes];
    let mut matrix = Banded::new(nodes - held);
    add_stiffness(&rod, &x, &v, 0.0, 0.0, held, &mut matrix);
    // Compression by the weight acts as a follower of the tension, which a linear chain carries itself;
    // here only motion across the rod is looked at, so stretching rows are left out.
    let n = nodes - held;
    let across = DMatrix::from_fn(n, n, |r, c| {
        let scale = (rod.mass[r + held] * rod.mass[c + held]).sqrt();
        matrix.get(2 * r, 2 * c) / scale
    });
    let mut values: Vec<f64> = across.symmetric_eigenvalues().iter().map(|w2| w2.sqrt()).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Cantilever: (beta L)^2 of Euler and Bernoulli, approached with the square of the edge length.
#[test]
fn clamped_frequencies_approach_euler_bernoulli() {
    let exact: [f64; 3] = [1.875_104_069, 4.694_091_133, 7.854_757_438];
    // Two held nodes clamp the first edge; a lumped chain behaves as a beam clamped half an edge further in.
    let found = |nodes: usize| {
        let rod = Uniform { gravity: 0.0, ..uniform(nodes) };
        let free = rod.length - 0.5 * rod.edge();
        let ei = rod.youngs_modulus * rod.second_moment();
        let unit = (ei / (rod.density * rod.area())).sqrt() / (free * free);
        frequencies(&rod, 2).iter().take(3).map(|w| w / unit).collect::<Vec<_>>()
    };
    let (coarse, fine) = (found(41), found(161));
    for i in 0..3 {
        let target = exact[i] * exact[i];
        let error = |x: f64| (x / target - 1.0).abs();
        assert!(error(fine[i]) < 2e-3, "mode {i}: {} against {target}", fine[i]);
        assert!(error(fine[i]) < 0.5 * error(coarse[i]), "mode {i} does not converge");
    }
}

/// Lowest stiffness of the standing rod with its first edge clamped, gravity included (relaxed first).
fn lowest_stiffness(nodes: usize, width: f64) -> f64 {
    let rod = Uniform { width, ..uniform(nodes) }.rod();
    // Each edge is shortened by the weight above it.
    let mut x = vec![Vec2::zero(); nodes];
    for k in 0..nodes - 1 {
        let above: f64 = rod.mass[k + 1..].iter().sum();
        let length = rod.rest[k] * (1.0 - above * rod.gravity / rod.stretch[k]);
        x[k + 1] = x[k] + Vec2::new(0.0, length);
    }
    let mut matrix = Banded::new(nodes - 2);
    add_stiffness(&rod, &x, &vec![Vec2::zero(); nodes], 0.0, 0.0, 2, &mut matrix);
    let n = 2 * (nodes - 2);
    DMatrix::from_fn(n, n, |r, c| matrix.get(r, c)).symmetric_eigenvalues().min()
}

fn buckling_width(nodes: usize) -> f64 {
    let (mut low, mut high) = (0.005, 0.010);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if lowest_stiffness(nodes, middle) > 0.0 { high = middle } else { low = middle }
    }
    high
}

/// Greenhill's self-buckling width is 7.80 mm (thesis 4.16); the discrete rod comes to it from below.
#[test]
fn self_buckling_approaches_greenhill() {
    let widths: Vec<f64> = [7, 13, 31, 101].map(|n| 1e3 * buckling_width(n)).to_vec();
    for (found, expected) in widths.iter().zip([6.90, 7.33, 7.61, 7.74]) {
        assert!((found - expected).abs() < 0.01, "{found} mm against {expected} mm");
    }
}

/// A cantilever bent by a tip load to 0.8 of its length: elliptic integrals by quadrature of
/// `EI theta'' = -F cos(theta)`, against the relaxed rod.
#[test]
fn a_large_deflection_is_that_of_the_elastica() {
    let load = 4.0; // F L^2 / (EI)
    let shape = |slope: f64| {
        // Integrates from the clamp with RK4; returns curvature and height at the tip.
        let (n, mut theta, mut kappa, mut height) = (20_000, 0.0_f64, slope, 0.0);
        let h = 1.0 / n as f64;
        for _ in 0..n {
            let (k1, l1) = (kappa, -load * theta.cos());
            let (k2, l2) = (kappa + 0.5 * h * l1, -load * (theta + 0.5 * h * k1).cos());
            let (k3, l3) = (kappa + 0.5 * h * l2, -load * (theta + 0.5 * h * k2).cos());
            let (k4, l4) = (kappa + h * l3, -load * (theta + h * k3).cos());
            let middle = theta + 0.5 * h * k2;
            height += h / 6.0 * (theta.sin() + 4.0 * middle.sin() + (theta + h * k3).sin());
            theta += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
            kappa += h / 6.0 * (l1 + 2.0 * l2 + 2.0 * l3 + l4);
        }
        (kappa, height)
    };
    let (mut low, mut high) = (0.0, 10.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if shape(middle).0 > 0.0 { high = middle } else { low = middle }
    }
    let exact = shape(low).1;

    let nodes = 121;
    let rod = Uniform { gravity: 0.0, youngs_modulus: 1e9, width: 0.002, ..uniform(nodes) };
    let free = rod.length - 0.5 * rod.edge();
    let force = load * rod.youngs_modulus * rod.second_moment() / (free * free);
    let discrete = rod.rod();
    let mut x: Vec<_> = (0..nodes).map(|i| Vec2::new(rod.edge() * i as f64, 0.0)).collect();
    let v = vec![Vec2::zero(); nodes];
    let n = 2 * (nodes - 2);
    // Load in small parts, Newton's method at each.
    for part in 1..=20 {
        for _ in 0..12 {
            let mut f = vec![Vec2::zero(); nodes];
            forces(&discrete, &x, &v, &mut f);
            f[nodes - 1].y += force * part as f64 / 20.0;
            let mut matrix = Banded::new(nodes - 2);
            add_stiffness(&discrete, &x, &v, 0.0, 0.0, 2, &mut matrix);
            let dense = DMatrix::from_fn(n, n, |r, c| matrix.get(r, c));
            let right = DVector::from_vec(flat(&f[2..]));
            let change = dense.lu().solve(&right).expect("a loaded cantilever is stable");
            for i in 0..n {
                *coordinate(&mut x[2..], i) += change[i];
            }
        }
    }
    let found = x[nodes - 1].y / free;
    assert!(exact > 0.6, "the test should bend the rod far: {exact}");
    assert!((found / exact - 1.0).abs() < 3e-3, "{found} against {exact}");
}
