//! The thesis' pendulum against reference numbers that an independent program computed: free swing
//! from horizontal, N = 7, w = 7 mm, no damping.

use rodgym_core::rod::{Energy, Motion, Rod, Uniform, energy, forces};
use rodgym_core::solver::{Constant, Integrator, Scheme};
use rodgym_core::vec2::Vec2;

fn thesis_rod(nodes: usize) -> Rod<f64> {
    Uniform {
        nodes,
        length: 0.3,
        width: 0.007,
        density: 1500.0,
        youngs_modulus: 1e7,
        damping: 0.0,
        bending_damping: 0.0,
        gravity: 9.81,
    }
    .rod()
}

fn horizontal(rod: &Rod<f64>) -> Motion<f64> {
    let mut motion = Motion::new(rod.nodes());
    for i in 0..rod.nodes() {
        motion.x[i] = Vec2::new(0.3 * i as f64 / (rod.nodes() - 1) as f64, 0.0);
    }
    motion
}

/// Positions after one second of free swing, and the energies.
fn swing(scheme: Scheme, dt: f64, nodes: usize) -> (Vec<Vec2<f64>>, Energy<f64>) {
    let rod = thesis_rod(nodes);
    let mut motion = horizontal(&rod);
    Integrator::<f64>::prepare(scheme, &rod, &mut motion);
    let steps = (1.0 / dt).round() as usize;
    let sound =
        Integrator::new(scheme, dt, nodes).advance(&rod, &mut motion, &Constant(0.0), steps);
    assert!(sound, "{scheme:?} at {dt}");
    let energies = energy(&rod, &motion.x, &motion.v);
    (motion.x, energies)
}

fn distance(a: &[Vec2<f64>], b: &[Vec2<f64>]) -> f64 {
    a.iter().zip(b).map(|(p, q)| (p.x - q.x).abs().max((p.y - q.y).abs())).fold(0.0, f64::max)
}

#[test]
fn tip_in_the_limit_of_small_steps() {
    let (x, _) = swing(Scheme::Verlet, 1e-5, 7);
    let tip = x[6];
    assert!((tip.x - 0.298143).abs() < 1e-5, "x = {}", tip.x);
    assert!((tip.y + 0.033309).abs() < 1e-5, "y = {}", tip.y);
}

#[test]
fn verlet_at_its_default_step_is_within_a_hundredth_of_a_millimetre() {
    let (exact, _) = swing(Scheme::Verlet, 1e-5, 7);
    let (x, _) = swing(Scheme::Verlet, 2e-4, 7);
    let error = distance(&x, &exact);
    assert!(error < 1e-5, "error {error} m");
}

#[test]
fn backward_euler_loses_the_energy_that_the_thesis_stepper_loses() {
    let (x, energy) = swing(Scheme::BackwardEuler, 1e-4, 7);
    let total = energy.total();
    assert!((total + 3.67e-4).abs() < 3.67e-6, "energy change {total} J");
    let (exact, _) = swing(Scheme::Verlet, 1e-5, 7);
    let off = distance(&x[6..], &exact[6..]);
    assert!((1.2e-3..1.5e-3).contains(&off), "tip off by {off} m");
}

/// Each scheme's error falls with the power of the step that it promises, for a coarse and a fine rod.
#[test]
fn steppers_converge_at_their_orders() {
    let cases = [
        (Scheme::Verlet, 4e-4, 2.0),
        (Scheme::BackwardEuler, 5e-4, 1.0),
        (Scheme::Implicit, 5e-4, 2.0),
        (Scheme::Bdf2, 5e-4, 2.0),
    ];
    let (exact, _) = swing(Scheme::Verlet, 5e-6, 7);
    for (scheme, dt, order) in cases {
        let coarse = distance(&swing(scheme, dt, 7).0, &exact);
        let fine = distance(&swing(scheme, dt / 4.0, 7).0, &exact);
        let found = (coarse / fine).log2() / 2.0;
        assert!((found - order).abs() < 0.25, "{scheme:?}: order {found}, errors {coarse} {fine}");
    }
}

#[test]
fn implicit_errors_are_those_of_the_reference_table() {
    let (exact, _) = swing(Scheme::Verlet, 5e-6, 7);
    let sdirk = distance(&swing(Scheme::Implicit, 1e-3, 7).0, &exact);
    assert!((sdirk - 0.030e-3).abs() < 0.003e-3, "SDIRK2 at 1 ms: {sdirk} m");
    let euler = distance(&swing(Scheme::BackwardEuler, 1e-3, 7).0, &exact);
    assert!((euler - 14.6e-3).abs() < 0.2e-3, "backward Euler at 1 ms: {euler} m");
}

/// However few iterations a step takes, what remains of `M (v - v0)/h = F` would move no node by more than
/// 1e-10 of the rod's length; in free swing it is at the level of rounding. Torques jump as in an environment.
#[test]
fn steps_of_backward_euler_satisfy_their_equation() {
    let (h, length) = (1e-4, 0.3);
    for (nodes, strength, bound) in [(7, 0.05, 1e-10), (31, 0.05, 1e-10), (7, 0.0, 1e-14)] {
        let rod = thesis_rod(nodes);
        let mut motion = horizontal(&rod);
        Integrator::<f64>::prepare(Scheme::BackwardEuler, &rod, &mut motion);
        let mut integrator = Integrator::new(Scheme::BackwardEuler, h, nodes);
        let mut worst = 0.0_f64;
        for step in 0..3000 {
            // Jumps of up to twice the strength every 10 ms, in a fixed order.
            let torque = strength * f64::from((step / 100 * 37) % 21 - 10) / 10.0;
            let before = motion.clone();
            assert!(integrator.advance_one(&rod, &mut motion, torque, 1));
            let mut force = vec![Vec2::zero(); nodes];
            let shape = forces(&rod, &motion.x, &motion.v, &mut force);
            force[1] += shape.base.scale(torque);
            // Without an acceleration to guess from, the first steps are as good as two iterations make them.
            for i in (1..nodes).filter(|_| step > 2) {
                let dv = motion.v[i] - before.v[i];
                let left = force[i].scale(rod.inverse_mass[i] * h * h) - dv.scale(h);
                worst = worst.max(left.x.abs().max(left.y.abs()) / length);
            }
        }
        assert!(worst < bound, "{nodes} nodes, {strength} N m: {worst:e}");
    }
}
