//! The bare pendulum: steps in one go or one by one, its linear model, the thesis' controller to the letter.

use nalgebra::DMatrix;
use rodgym_core::pendulum::BarePendulum;
use rodgym_core::simulation::Simulation;
use serde_json::{Value, json};
use std::f64::consts::PI;

fn pendulum(kwargs: Value) -> BarePendulum {
    BarePendulum::new(kwargs.as_object().expect("a dictionary")).expect("allowed keywords")
}

#[test]
fn many_steps_at_once_give_the_bits_of_single_steps() {
    for stepper in ["verlet", "backward_euler", "implicit"] {
        let mut together = pendulum(json!({"stepper": stepper}));
        let mut apart = together.clone();
        for torque in [0.03, -0.05, 0.0] {
            together.step(torque, 25).unwrap();
            (0..25).for_each(|_| apart.step(torque, 1).unwrap());
            assert_eq!(together.state(), apart.state(), "{stepper}");
            assert_eq!(together.time(), apart.time());
        }
    }
}

#[test]
fn the_cheaper_scheme_is_taken_and_small_explicit_steps_are_allowed() {
    for (keywords, stepper, physics_dt) in [
        (json!({}), "verlet", 5e-4),
        (json!({"nodes": 31}), "verlet", 6.25e-5),
        (json!({"nodes": 101}), "esdirk3", 2.5e-3),
        (json!({"youngs_modulus": 2e11}), "esdirk3", 2.5e-3),
    ] {
        let rod = pendulum(keywords.clone());
        assert_eq!(rod.resolved()["stepper"], stepper, "{keywords}");
        assert_eq!(rod.physics_dt(), physics_dt, "{keywords}");
    }
    let fine = pendulum(json!({"nodes": 31, "physics_dt": 1e-4, "bending_damping": 0.0}));
    assert_eq!(fine.resolved()["stepper"], "verlet");
    let error = BarePendulum::new(json!({"torque_limit": 1.0}).as_object().unwrap()).unwrap_err();
    assert!(error.to_string().contains("torque_limit"), "{error}");
}

/// Poles about up: the inextensible model's, which stretching and the lumped load change little.
#[test]
fn linear_model_about_up_has_the_poles_of_the_inextensible_pendulum() {
    let mut sim = pendulum(json!({"bending_damping": 0.0, "stepper": "verlet"}));
    // Upright is an equilibrium only with every edge shortened by the weight above it.
    let (mass, stretch) = (1500.0 * 0.007 * 0.007 * 0.05, 1e7 * 0.007 * 0.007);
    let mut up = vec![[0.0, 0.0]];
    for k in 0..6 {
        let above = mass * (5.5 - k as f64);
        up.push([0.0, up[k][1] + 0.05 * (1.0 - above * 9.81 / stretch)]);
    }
    sim.set_state(&up, &[[0.0, 0.0]; 7]).unwrap();
    let linear = sim.linearize(0.0);
    let a = DMatrix::from_row_slice(linear.states, linear.states, &linear.a);
    let poles = a.complex_eigenvalues();
    let near = |re: f64, im: f64| {
        poles.iter().map(|p| (p.re - re).hypot(p.im - im)).fold(f64::INFINITY, f64::min)
    };
    assert!(near(7.0201, 0.0) < 5e-3 && near(-7.0201, 0.0) < 5e-3, "{poles}");
    for w in [20.715, 73.763, 138.554] {
        assert!(near(0.0, w) < 1e-3 * w, "{w}: {poles}");
    }
}

/// The matrices against differences of the motion itself, in a bent, moving state.
#[test]
fn linear_model_is_the_derivative_of_the_motion() {
    let dt = 1e-7;
    let angles = [2.8, 3.0, 3.3, 3.5, 3.3, 3.0];
    let rates = [1.0, -1.0, 0.5, 2.0, 0.0, -1.0];
    let mut start = pendulum(json!({"physics_dt": dt, "stepper": "verlet", "damping": 0.01}));
    start.set_angles(&angles, &rates).unwrap();
    let torque = 0.02;
    let linear = start.linearize(torque);
    let state = start.state();
    // Mean acceleration over one small step: half a step late, so compared to first order in dt.
    let derivative = |j: Option<usize>, d: f64, torque: f64| {
        let (mut x, mut v) = (state.positions.clone(), state.velocities.clone());
        if let Some(j) = j {
            let list = if j < 12 { &mut x } else { &mut v };
            list[(j % 12) / 2 + 1][j % 2] += d;
        }
        let mut sim = start.clone();
        sim.set_state(&x, &v).unwrap();
        sim.step(torque, 1).unwrap();
        let after = sim.state();
        let change = |i: usize, c: usize| (after.velocities[i][c] - v[i][c]) / dt;
        (1..7).flat_map(|i| [change(i, 0), change(i, 1)]).collect::<Vec<_>>()
    };
    let n = linear.states;
    for j in 0..n {
        let d = 1e-5;
        let (up, down) = (derivative(Some(j), d, torque), derivative(Some(j), -d, torque));
        for i in 0..12 {
            assert_eq!(linear.a[i * n + j], f64::from(u8::from(j == i + 12)), "A({i}, {j})");
        }
        for i in 12..n {
            let slope = (up[i - 12] - down[i - 12]) / (2.0 * d);
            let found = linear.a[i * n + j];
            let close = (slope - found).abs() < 2e-3 * (300.0 + found.abs());
            assert!(close, "A({i}, {j}): {found} {slope}");
        }
    }
    let (up, down) = (derivative(None, 0.0, torque + 1e-3), derivative(None, 0.0, torque - 1e-3));
    for i in 12..n {
        let slope = (up[i - 12] - down[i - 12]) / 2e-3;
        assert!((slope - linear.b[i]).abs() < 1e-4 * linear.b[12].hypot(linear.b[13]), "B({i})");
    }
}

/// Gains of the continuous LQR with the thesis' weights for w = 7 mm, as an independent solver gives them.
const THESIS_GAIN: [f64; 12] = [
    41.9915, -6.4612, 13.5714, 8.5106, 0.8539, 2.2641, 2.2083, 2.0638, 1.6190, 1.3820, 0.8615,
    0.3368,
];

/// From rest, open-loop swing-up, then state feedback within 60 degrees of up, both inside the implicit step.
#[test]
fn thesis_state_feedback_swings_up_switches_and_stands() {
    let mut sim = pendulum(json!({"thesis": true}));
    let frequency = (9.81_f64 / 0.3).sqrt();
    let gain = THESIS_GAIN.map(|k| -k);
    let mut switched = None;
    for _ in 0..30_000 {
        let mut off = sim.angles()[0] - PI;
        if off <= -PI {
            off += 2.0 * PI;
        }
        if off.abs() < PI / 3.0 {
            switched.get_or_insert(sim.time());
            sim.step_feedback(0.0, &gain, 1).unwrap();
        } else {
            let time = sim.time() + 1e-4;
            sim.step(0.025 * (frequency * time).cos(), 1).unwrap();
        }
    }
    let switched = switched.expect("it should come near up");
    assert!((switched - 0.638).abs() < 1e-3, "switched at {switched} s");
    let worst = sim.angles().iter().map(|t| (t.abs() - PI).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-6, "off by {worst} rad at 3 s");
}
