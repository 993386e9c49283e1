//! The literal controllers of thesis chapter 4 inside the implicit step, against what an independent
//! program found: when they switch, whom they catch and whom they lose.

use rodgym_baselines::linalg::spectral_abscissa;
use rodgym_baselines::pendulum::{ProcessNoise, RodDesign, ThesisDesign, ThesisRun};
use rodgym_core::pendulum::BarePendulum;
use rodgym_core::simulation::Simulation;
use serde_json::json;
use std::f64::consts::PI;

struct Outcome {
    switched: f64,
    end: f64,
    /// Largest distance of an edge from up at the end \[rad\].
    error: f64,
    largest_torque: f64,
}

fn run(width: f64, observes: bool, noise: ProcessNoise, duration: f64) -> Outcome {
    run_thesis(width, observes, false, noise, duration)
}

fn run_thesis(
    width: f64,
    observes: bool,
    latches: bool,
    noise: ProcessNoise,
    duration: f64,
) -> Outcome {
    let rod = RodDesign { width, bending_damping: 0.0, ..RodDesign::default() };
    let serde_json::Value::Object(keywords) = json!({"width": width, "thesis": true}) else {
        unreachable!()
    };
    let mut sim = BarePendulum::new(&keywords).unwrap();
    assert_eq!(sim.physics_dt(), 1e-4);
    let mut controller = ThesisRun::new(ThesisDesign::new(&rod, noise).unwrap(), observes, latches);
    let (mut switched, mut largest) = (f64::NAN, 0f64);
    while sim.time() < duration - 5e-5 {
        let start = sim.time();
        let Ok(step) = controller.step(&mut sim) else { break };
        if step.linear {
            largest = largest.max(step.torque.abs());
            if switched.is_nan() {
                switched = start;
            }
        }
    }
    let error = sim.angles().iter().map(|a| PI - a.abs()).fold(0.0, f64::max);
    Outcome { switched, end: sim.time(), error, largest_torque: largest }
}

#[test]
fn state_feedback_stands_at_7_and_9_mm_and_loses_8_1_mm() {
    let seven = run(0.007, false, ProcessNoise::Torque, 3.0);
    assert!((seven.switched - 0.638).abs() < 2e-3, "{}", seven.switched);
    assert!(seven.error < 1e-6, "{}", seven.error);
    let nine = run(0.009, false, ProcessNoise::Torque, 3.0);
    assert!((nine.switched - 1.225).abs() < 2e-3, "{}", nine.switched);
    assert!(nine.error < 1e-6, "{}", nine.error);
    // In between the torque grows without bound and the rod is folded.
    let lost = run(0.0081, false, ProcessNoise::Torque, 1.6);
    assert!((lost.switched - 1.233).abs() < 2e-3, "{}", lost.switched);
    assert!(lost.end < 1.6 || lost.error > 0.1);
    assert!(lost.largest_torque > 100.0, "{}", lost.largest_torque);
}

/// In every reading of the text the linear observer is stable and does not catch the 7 mm rod.
#[test]
fn the_linear_observer_does_not_catch_the_rod() {
    for noise in [ProcessNoise::Torque, ProcessNoise::State] {
        let rod = RodDesign { bending_damping: 0.0, ..RodDesign::default() };
        let design = ThesisDesign::new(&rod, noise).unwrap();
        assert!(spectral_abscissa(&design.error_dynamics()) < 0.0);
        for latches in [false, true] {
            let outcome = run_thesis(0.007, true, latches, noise, 2.5);
            assert!(outcome.end < 2.5 || outcome.error > 0.1, "{noise:?} {latches} caught it");
        }
    }
}
