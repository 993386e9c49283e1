//! The promise under test: what stands between a command and the machine, and what pushes it, is what its keyword says.

use rodgym_core::catalog::{MakeOptions, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};
use rodgym_core::pendulum::PARAMETERS;
use rodgym_core::pendulum::config::uniform;
use serde_json::{Value, json};

const SWING_UP: &str = "rodgym/PendulumSwingUp-v0";
const THRUST: &str = "rodgym/FinThrust-v0";

/// `n` environments at the start of the episodes of seeds 0, 1, ...
fn begun(id: &str, n: usize, kwargs: Value) -> (Box<dyn VectorEnv>, StepBuffer) {
    let options = MakeOptions {
        id: id.into(),
        num_envs: n,
        kwargs: kwargs.as_object().unwrap().clone(),
        autoreset_mode: AutoresetMode::Disabled,
        max_episode_steps: None,
        num_threads: 1,
    };
    let mut env = make(&options).unwrap_or_else(|error| panic!("{kwargs}: {error}"));
    let mut buffer = StepBuffer::new(&env.spec().clone(), n);
    env.reset(&Seeds::Base(0), None, &ResetOptions::default(), buffer.data()).unwrap();
    (env, buffer)
}

/// A metric of the first environment after each of `steps` steps under an action.
fn metric(id: &str, kwargs: Value, name: &str, action: f32, steps: usize) -> Vec<f64> {
    let (mut env, mut buffer) = begun(id, 1, kwargs);
    let at = env.spec().metrics.iter().position(|known| *known == name).unwrap();
    let mut taken = vec![];
    for _ in 0..steps {
        env.step(&[action], buffer.data()).unwrap();
        taken.push(buffer.terms[env.spec().reward_terms.len() + at]);
    }
    taken
}

/// Angular momentum of the first environment's rod about its base \[N m s\].
fn angular_momentum(env: &dyn VectorEnv) -> f64 {
    let values: Vec<f64> = PARAMETERS.iter().map(|row| row.default).collect();
    let masses = uniform(7, &values).rod().mass;
    let nodes = env.nodes(0).unwrap();
    let moment = |(x, v): (&[f64; 2], &[f64; 2])| x[0] * v[1] - x[1] * v[0];
    let moments = nodes.positions.iter().zip(&nodes.velocities).map(moment);
    moments.zip(&masses).map(|(moment, mass)| moment * mass).sum()
}

/// Without gravity the rod keeps what a push gives it: torque times duration, wherever control steps begin and end.
#[test]
fn a_push_gives_its_impulse_whatever_the_control_step() {
    for control_dt in [0.01, 0.02, 0.016] {
        for stepper in ["verlet", "esdirk3"] {
            let push = json!({"torque": 0.04, "start": 0.033, "duration": 0.05});
            let (mut env, mut buffer) = begun(
                SWING_UP,
                1,
                json!({"gravity": 0.0, "control_dt": control_dt, "stepper": stepper, "push": push}),
            );
            for step in 1..=8 {
                env.step(&[0.0], buffer.data()).unwrap();
                let time = control_dt * f64::from(step);
                let expected = 0.04 * (time - 0.033).clamp(0.0, 0.05);
                let got = angular_momentum(env.as_ref());
                let case = format!("{stepper}, {time} s: {got}, not {expected}");
                // ESDIRK3 conserves it to the square of its step only.
                let within = if stepper == "verlet" { 1e-12 } else { 2e-5 };
                assert!((got - expected).abs() < within, "{case}");
            }
        }
    }
}

/// The push comes on top of what the motor does, and in every episode again.
#[test]
fn a_push_is_added_to_the_motors_torque() {
    let push = json!({"torque": -0.1, "start": 0.02, "duration": 0.03});
    let torque = metric(SWING_UP, json!({"push": push}), "torque", 0.5, 7);
    let expected = [0.025, 0.025, -0.075, -0.075, -0.075, 0.025, 0.025];
    for (got, expected) in torque.iter().zip(expected) {
        assert!((got - expected).abs() < 1e-12, "{torque:?}");
    }
}

/// A motor of half the gain is a motor told half.
#[test]
fn the_motors_gain_scales_its_command() {
    let weak = metric(SWING_UP, json!({"actuator_gain": 0.5}), "tip_height", 1.0, 60);
    let told = metric(SWING_UP, json!({}), "tip_height", 0.5, 60);
    assert_eq!(weak, told);
    assert_ne!(weak, metric(SWING_UP, json!({}), "tip_height", 1.0, 60));
}

/// The same of the fin's servo, whose low-pass is linear.
#[test]
fn the_servos_gain_scales_its_command() {
    let still = |gain: f64| json!({"start_pitch": [0.0, 0.0], "actuator_gain": gain});
    let weak = metric(THRUST, still(0.5), "pitch", 1.0, 60);
    let told = metric(THRUST, still(1.0), "pitch", 0.5, 60);
    assert_eq!(weak, told);
    let limit = 20f64.to_radians();
    assert!((weak.last().unwrap() / (0.5 * limit) - 1.0).abs() < 1e-3, "{weak:?}");
    // It begins at rest whatever its gain.
    let placed = json!({"start_pitch": [0.2, 0.2], "actuator_gain": 0.8});
    let (mut env, mut buffer) = begun(THRUST, 1, placed);
    let command = 0.2 / (0.8 * limit);
    env.step(&[command as f32], buffer.data()).unwrap();
    let pitch = env.spec().metrics.iter().position(|known| *known == "pitch").unwrap();
    let pitch = buffer.terms[env.spec().reward_terms.len() + pitch];
    assert!((pitch - 0.2).abs() < 1e-6, "{pitch}");
}

/// A servo turns by at most 30 degrees.
#[test]
fn a_servo_that_would_turn_too_far_is_refused() {
    let options = MakeOptions {
        id: THRUST.into(),
        num_envs: 1,
        kwargs: json!({"actuator_gain": 1.6}).as_object().unwrap().clone(),
        autoreset_mode: AutoresetMode::Disabled,
        max_episode_steps: None,
        num_threads: 1,
    };
    let error = make(&options).err().expect("refused").to_string();
    assert!(error.contains("actuator_gain") && error.contains("0.01 to 1.5"), "{error}");
}

/// Noise of the fin's command has the size that was asked for, and follows the seed.
#[test]
fn noise_of_the_command_moves_the_pitch() {
    let noisy =
        json!({"start_pitch": [0.0, 0.0], "command_disturbance": 0.1, "command_cutoff": null});
    let pitch = metric(THRUST, noisy.clone(), "pitch", 0.0, 400);
    assert_eq!(pitch, metric(THRUST, noisy, "pitch", 0.0, 400));
    let rms = (pitch.iter().map(|x| x * x).sum::<f64>() / 400.0).sqrt();
    let commanded = 0.1 * 20f64.to_radians();
    // The servo follows most of what is held for 40 ms.
    assert!((0.4..1.0).contains(&(rms / commanded)), "{}", rms / commanded);
}

/// The whole rod turns at the rate that was drawn, each environment at its own; at 0 by default.
#[test]
fn starts_turn_at_the_rate_that_is_asked_for() {
    let rates = |kwargs: Value| -> Vec<Vec<f32>> {
        let (_, buffer) = begun(SWING_UP, 64, kwargs);
        buffer.observation.chunks(18).map(|seen| seen[12..].to_vec()).collect()
    };
    let drawn = rates(json!({"start_angle": [-3.2, 3.2], "start_rate": [-5.0, 5.0]}));
    for seen in &drawn {
        assert!(seen.iter().all(|rate| (rate - seen[0]).abs() < 1e-6), "{seen:?}");
        assert!(seen[0].abs() <= 0.5 + 1e-6, "{seen:?}");
    }
    let fast = drawn.iter().filter(|seen| seen[0].abs() > 0.25).count();
    assert!((16..48).contains(&fast), "{fast} of 64 turn at more than 2.5 rad/s");
    assert!(rates(json!({})).iter().flatten().all(|rate| *rate == 0.0));
    let same = rates(json!({"start_rate": [2.0, 2.0]}));
    assert!(same.iter().flatten().all(|rate| (rate - 0.2).abs() < 1e-6));
}
