//! The promise under test: an environment's results depend on its seed and actions alone, never on the
//! size of the batch, the number of lanes or threads, the instruction set, or a restored snapshot.

use rodgym_core::batch::{Batch, BatchOptions, in_lanes};
use rodgym_core::catalog::{MakeOptions, entry, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};
use rodgym_core::isa::Isa;
use rodgym_core::lane::Lanes;
use rodgym_core::pendulum::tasks::SwingUp;
use rodgym_core::pendulum::{Pendulum, Sensors};
use rodgym_core::seed::Stream;
use serde_json::{Map, Value, json};

fn map(value: Value) -> Map<String, Value> {
    value.as_object().expect("a dictionary").clone()
}

/// Keyword sets that exercise every stepper and every random draw.
fn variants() -> Vec<Value> {
    vec![
        json!({}),
        json!({"stepper": "backward_euler", "physics_dt": 1e-3, "observation": "base",
               "sensor_noise": {"angle": 1e-2, "rate": 1e-1}}),
        json!({"nodes": 13, "stepper": "implicit", "physics_dt": 2e-3, "observation": "tip",
               "randomize": {"width": [0.006, 0.009], "youngs_modulus": ["log_uniform", 5e6, 2e7]},
               "actuator_delay": 0.012, "torque_disturbance": 0.01}),
        json!({"start_rate": [-5.0, 5.0], "actuator_gain": 0.8,
               "push": {"torque": 0.1, "start": 0.055, "duration": 0.05}}),
    ]
}

fn options(n: usize, kwargs: &Value, mode: AutoresetMode, threads: usize) -> MakeOptions {
    MakeOptions {
        id: "rodgym/PendulumSwingUp-v0".into(),
        num_envs: n,
        kwargs: map(kwargs.clone()),
        autoreset_mode: mode,
        max_episode_steps: Some(30),
        num_threads: threads,
    }
}

/// Random actions of environment i at a step: the same whatever the batch.
fn action(i: usize, step: usize) -> f32 {
    Stream::new((1000 * step + i) as u64).uniform(-1.0, 1.0) as f32
}

/// Bits of everything that `steps` steps return for the environments `0..watch`.
fn trace(env: &mut dyn VectorEnv, watch: usize, steps: usize) -> Vec<u64> {
    let n = env.num_envs();
    let spec = env.spec().clone();
    let mut buffer = StepBuffer::new(&spec, n);
    env.reset(&Seeds::Base(7), None, &ResetOptions::default(), buffer.data()).unwrap();
    let mut bits = vec![];
    for step in 0..steps {
        let actions: Vec<f32> = (0..n).map(|i| action(i, step)).collect();
        env.step(&actions, buffer.data()).unwrap();
        record(&buffer, &spec, watch, &mut bits);
    }
    bits
}

fn record(buffer: &StepBuffer, spec: &rodgym_core::env::Spec, watch: usize, bits: &mut Vec<u64>) {
    let d = spec.observation.size();
    let k = spec.reward_terms.len() + spec.metrics.len();
    bits.extend(buffer.observation[..watch * d].iter().map(|x| x.to_bits() as u64));
    bits.extend(buffer.reward[..watch].iter().map(|x| x.to_bits()));
    bits.extend(buffer.terms[..watch * k].iter().map(|x| x.to_bits()));
    for i in 0..watch {
        let flags = [buffer.terminated[i], buffer.truncated[i], buffer.began[i]];
        bits.extend(flags.map(u64::from));
    }
}

#[test]
fn same_bits_for_every_batch_size_and_number_of_threads() {
    for kwargs in variants() {
        for mode in [AutoresetMode::NextStep, AutoresetMode::SameStep] {
            let alone = trace(make(&options(1, &kwargs, mode, 1)).unwrap().as_mut(), 1, 70);
            for (n, threads) in [(5, 1), (64, 1), (100, 2), (100, 3)] {
                let mut env = make(&options(n, &kwargs, mode, threads)).unwrap();
                assert_eq!(trace(env.as_mut(), n.min(1), 70), alone, "{n} {threads} {mode:?}");
            }
            let five = trace(make(&options(5, &kwargs, mode, 1)).unwrap().as_mut(), 5, 70);
            let many = trace(make(&options(200, &kwargs, mode, 2)).unwrap().as_mut(), 5, 70);
            assert_eq!(five, many, "{mode:?} {kwargs}");
        }
    }
}

#[test]
fn same_bits_for_every_instruction_set_and_lane_width() {
    for kwargs in variants() {
        let (row, given) = (entry("rodgym/PendulumSwingUp-v0").unwrap(), map(kwargs));
        let task = SwingUp { sensors: Sensors::Full };
        let options = BatchOptions {
            num_envs: 20,
            autoreset_mode: AutoresetMode::NextStep,
            max_episode_steps: Some(25),
            num_threads: 1,
        };
        let mut scalar = Batch::<Pendulum, f64>::new(row.id, &task, &given, &options).unwrap();
        let scalar = trace(&mut scalar, 20, 60);
        let mut four = Batch::<Pendulum, Lanes<4>>::new(row.id, &task, &given, &options).unwrap();
        assert_eq!(trace(&mut four, 20, 60), scalar, "4 lanes");
        for isa in Isa::available() {
            let mut eight = in_lanes(row.id, &task, &given, &options, isa).unwrap();
            assert_eq!(trace(eight.as_mut(), 20, 60), scalar, "{isa:?}, 8 lanes");
        }
    }
}

#[test]
fn a_snapshot_restored_in_mid_episode_continues_with_the_same_bits() {
    for kwargs in variants() {
        let mode = AutoresetMode::NextStep;
        let mut first = make(&options(9, &kwargs, mode, 1)).unwrap();
        trace(first.as_mut(), 9, 17);
        let mut second = make(&options(3, &kwargs, mode, 1)).unwrap();
        trace(second.as_mut(), 3, 2);
        for i in 0..3 {
            second.set_state(i, &first.get_state(i + 4).unwrap()).unwrap();
        }
        let spec = first.spec().clone();
        let mut left = StepBuffer::new(&spec, 9);
        let mut right = StepBuffer::new(&spec, 3);
        let d = spec.observation.size();
        for step in 0..40 {
            let actions: Vec<f32> = (0..9).map(|i| action(i, step)).collect();
            first.step(&actions, left.data()).unwrap();
            second.step(&actions[4..7], right.data()).unwrap();
            assert_eq!(left.observation[4 * d..7 * d], right.observation[..], "step {step}");
            assert_eq!(left.reward[4..7], right.reward[..], "step {step}");
            assert_eq!(left.began[4..7], right.began[..], "step {step}");
        }
    }
}

#[test]
fn a_damaged_or_foreign_snapshot_is_refused_and_changes_nothing() {
    let mode = AutoresetMode::Disabled;
    let mut env = make(&options(2, &json!({}), mode, 1)).unwrap();
    trace(env.as_mut(), 2, 5);
    let before = env.get_state(0).unwrap();
    for at in 0..before.len() {
        let mut damaged = before.clone();
        damaged[at] ^= 0x10;
        assert!(env.set_state(0, &damaged).is_err(), "byte {at}");
        assert!(env.set_state(0, &before[..at]).is_err(), "cut at {at}");
    }
    let other = make(&options(2, &json!({"nodes": 9}), mode, 1)).unwrap();
    assert!(env.set_state(0, &other.get_state(0).unwrap()).is_err());
    assert_eq!(env.get_state(0).unwrap(), before);
}

#[test]
fn bad_calls_are_refused_by_name_and_change_nothing() {
    let mut env = make(&options(3, &json!({}), AutoresetMode::Disabled, 1)).unwrap();
    let spec = env.spec().clone();
    let mut buffer = StepBuffer::new(&spec, 3);
    let error = env.step(&[0.0; 3], buffer.data()).unwrap_err().to_string();
    assert!(error.contains("reset()"), "{error}");
    trace(env.as_mut(), 3, 3);
    let before = env.get_state(1).unwrap();
    let error = env.step(&[0.0, f32::NAN, 0.0], buffer.data()).unwrap_err().to_string();
    assert!(error.contains("environment 1") && error.contains("NaN"), "{error}");
    assert!(env.step(&[0.0; 2], buffer.data()).is_err());
    let unknown =
        ResetOptions { parameters: map(json!({"widht": 0.007})), ..ResetOptions::default() };
    let error = env.reset(&Seeds::Continue, None, &unknown, buffer.data()).unwrap_err().to_string();
    assert!(error.contains("widht") && error.contains("width"), "{error}");
    assert_eq!(env.get_state(1).unwrap(), before);
    for _ in 0..27 {
        env.step(&[0.0; 3], buffer.data()).unwrap();
    }
    assert!(buffer.truncated.iter().all(|&t| t));
    let error = env.step(&[0.0; 3], buffer.data()).unwrap_err().to_string();
    assert!(error.contains("reset_mask"), "{error}");
}

#[test]
fn keywords_outside_their_range_are_refused_with_value_and_range() {
    let cases = [
        (json!({"width": -1.0}), "width = -1"),
        (json!({"width": "thick"}), "width = \"thick\""),
        (json!({"nodes": 1}), "nodes = 1"),
        (json!({"nodes": 100_000_000}), "from 2 to 1001"),
        (json!({"stepper": "rk4"}), "'verlet'"),
        (json!({"physics_dt": 7e-4, "stepper": "verlet"}), "physics_dt = 0.0007"),
        (json!({"physics_dt": 3e-4}), "multiple of physics_dt"),
        (json!({"randomize": {"width": [0.009, 0.006]}}), "randomize['width']"),
        (json!({"randomize": {"nodes": [3, 5]}}), "'nodes'"),
        (json!({"sensor_noise": {"angle": -1.0}}), "sensor_noise['angle']"),
        (json!({"actuator_gain": 0.0}), "a number from 0.01 to 10"),
        (json!({"start_rate": [5.0, -5.0]}), "start_rate"),
        (json!({"push": {"torque": 0.1}}), "push['duration']"),
        (json!({"push": {"torque": 0.1, "start": -1.0, "duration": 1.0}}), "push['start']"),
        (json!({"push": {"force": 0.1}}), "'force'"),
        (json!({"colour": 3}), "'colour'"),
    ];
    for (kwargs, expected) in cases {
        let result = make(&options(1, &kwargs, AutoresetMode::Single, 1));
        let error = result.err().unwrap_or_else(|| panic!("{kwargs} was accepted")).to_string();
        assert!(error.contains(expected), "{kwargs}: {error}");
    }
}

/// A light, soft, hard-driven rod: nothing that a policy can do may bring a NaN to it.
#[test]
fn violent_torques_never_give_nan() {
    for stepper in ["verlet", "implicit", "backward_euler"] {
        let kwargs = json!({"torque_limit": 2.0, "stepper": stepper, "bending_damping": 0.0,
            "physics_dt": if stepper == "verlet" { 4e-4 } else { 5e-3 }, "control_dt": 0.02});
        let mut env = make(&options(16, &kwargs, AutoresetMode::SameStep, 1)).unwrap();
        let spec = env.spec().clone();
        let mut buffer = StepBuffer::new(&spec, 16);
        env.reset(&Seeds::Base(1), None, &ResetOptions::default(), buffer.data()).unwrap();
        for step in 0..300 {
            let actions: Vec<f32> = (0..16).map(|i| action(i, step).signum()).collect();
            env.step(&actions, buffer.data()).unwrap();
            assert!(buffer.observation.iter().all(|x| x.is_finite()), "{stepper} step {step}");
            assert!(buffer.reward.iter().all(|x| (-0.1..=1.0).contains(x)), "{stepper}");
        }
    }
}
