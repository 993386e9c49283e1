//! Promises of the fin environments: bounded rewards that nothing but swimming well can earn, the servo of the
//! reference, failures that never reach the agent as NaN.

use rodgym_core::catalog::{MakeOptions, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};
use serde_json::{Map, Value, json};
use std::f64::consts::TAU;

const IDS: [&str; 3] = ["rodgym/FinThrust-v0", "rodgym/FinEfficiency-v0", "rodgym/FinSwim-v0"];

fn batch(id: &str, num_envs: usize, kwargs: Value) -> Box<dyn VectorEnv> {
    let kwargs: Map<String, Value> = kwargs.as_object().expect("a dictionary").clone();
    let id = id.to_string();
    let autoreset_mode = AutoresetMode::NextStep;
    let max_episode_steps = Some(200);
    make(&MakeOptions { id, num_envs, kwargs, autoreset_mode, max_episode_steps, num_threads: 1 })
        .expect("allowed keywords")
}

/// Seeds of an evaluation: each command meets the same fins.
const SEEDS: usize = 6;

/// Mean returns of episodes of 200 steps under open-loop commands, over the same seeds for each command.
fn returns(id: &str, kwargs: Value, commands: &[&dyn Fn(usize) -> f64]) -> Vec<f64> {
    let n = commands.len() * SEEDS;
    let mut env = batch(id, n, kwargs);
    let mut out = StepBuffer::new(env.spec(), n);
    let seeds = Seeds::Each((0..n).map(|i| Some((i % SEEDS) as u64)).collect());
    env.reset(&seeds, None, &ResetOptions::default(), out.data()).expect("reset");
    let mut sums = vec![0.0; commands.len()];
    for step in 0..200 {
        let actions: Vec<f32> = (0..n).map(|i| commands[i / SEEDS](step) as f32).collect();
        env.step(&actions, out.data()).expect("finite actions");
        assert!(!out.solver_failure.contains(&true), "the solver failed");
        for (i, reward) in out.reward.iter().enumerate() {
            sums[i / SEEDS] += reward / SEEDS as f64;
        }
    }
    sums
}

fn sine(amplitude: f64, frequency: f64, step: usize) -> f64 {
    amplitude * libm::sin(TAU * frequency * 0.04 * step as f64)
}

/// Random commands over stiffness from 3e4 to 1e7 Pa and flow from 0 to 0.3 m/s: observations finite and within
/// bounds, rewards within their documented range, no solver failure. (`physics_dt` default.)
#[test]
fn random_commands_never_break_the_fin() {
    for id in IDS {
        let n = 64;
        let mut ranges = json!({"youngs_modulus": ["log_uniform", 3e4, 1e7]});
        if id != "rodgym/FinSwim-v0" {
            ranges["flow_speed"] = json!([0.0, 0.3]);
        }
        let mut env = batch(id, n, json!({ "randomize": ranges }));
        let spec = env.spec().clone();
        let mut out = StepBuffer::new(&spec, n);
        env.reset(&Seeds::Base(1), None, &ResetOptions::default(), out.data()).expect("reset");
        let mut stream = rodgym_core::seed::Stream::new(2);
        let mut failures = 0;
        for _ in 0..300 {
            let actions: Vec<f32> = (0..n).map(|_| stream.uniform(-1.0, 1.0) as f32).collect();
            env.step(&actions, out.data()).expect("finite actions");
            let d = spec.observation.size();
            for (j, &x) in out.observation.iter().enumerate() {
                let (low, high) = (spec.observation.low[j % d], spec.observation.high[j % d]);
                assert!((low..=high).contains(&f64::from(x)), "{id}: observation {x}");
            }
            for (&reward, terms) in out.reward.iter().zip(out.terms.chunks(out.terms.len() / n)) {
                assert!((-20.0..=4.0).contains(&reward), "{id}: reward {reward}");
                assert!(terms.iter().all(|t| t.is_finite()), "{id}: {terms:?}");
                assert!((terms[0] + terms[1] - reward).abs() < 1e-15 || reward == 0.0);
            }
            failures += out.solver_failure.iter().filter(|&&failed| failed).count();
        }
        assert_eq!(failures, 0, "{id}");
    }
}

type Command = Box<dyn Fn(usize) -> f64>;

/// Fins that are soft, as stiff as allowed, resonant just above 5 Hz (the wet bending mode is at 11.8 Hz times the
/// root of E / 8.11 MPa), and the thesis'.
fn fins() -> Vec<Value> {
    let mut fins: Vec<Value> = [3e4, 2.5e5, 8e5, 1.5e6, 1.7e6, 2e6, 3e6, 8.11e6, 1e7]
        .map(|e| json!({"youngs_modulus": e, "start_pitch": [0.0, 0.0]}))
        .to_vec();
    fins.push(json!({"thesis": true, "stepper": "bdf2", "start_pitch": [0.0, 0.0]}));
    fins
}

/// Sines to 5 Hz (and holding still); above, sines and patterns of two, three and four steps (12.5, 8.3 and 6.25 Hz);
/// all amplitudes up to the largest.
fn slow_and_fast() -> (Vec<Command>, Vec<Command>) {
    let (mut slow, mut fast): (Vec<Command>, Vec<Command>) = (vec![], vec![]);
    for a in [0.0, 0.1, 0.2, 0.4, 0.6, 1.0] {
        for f in [0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0] {
            slow.push(Box::new(move |k: usize| sine(a, f, k)));
        }
    }
    for a in [0.1, 0.3, 1.0] {
        for f in [5.25, 5.5, 5.75, 6.0, 6.5, 7.0, 8.0, 9.5, 11.0, 11.5, 12.0, 12.5] {
            // A quarter period off, so that 12.5 Hz is not sampled at its zeros.
            fast.push(Box::new(move |k: usize| a * libm::cos(TAU * f * 0.04 * k as f64)));
        }
        for pattern in [[1.0, -1.0, 1.0, -1.0], [1.0, 1.0, -1.0, -1.0], [1.0, 0.0, -1.0, 0.0]] {
            fast.push(Box::new(move |k: usize| a * pattern[k % 4]));
        }
        for pattern in [[1.0, 0.0, -1.0], [1.0, -0.5, -0.5]] {
            fast.push(Box::new(move |k: usize| a * pattern[k % 3]));
        }
    }
    (slow, fast)
}

/// Returns of one fin under each command.
fn returns_of(id: &str, kwargs: &Value, commands: &[Command]) -> Vec<f64> {
    let n = commands.len();
    let mut env = batch(id, n, kwargs.clone());
    let mut out = StepBuffer::new(env.spec(), n);
    env.reset(&Seeds::Base(0), None, &ResetOptions::default(), out.data()).expect("reset");
    let mut sums = vec![0.0; n];
    for step in 0..200 {
        let actions: Vec<f32> = commands.iter().map(|c| c(step) as f32).collect();
        env.step(&actions, out.data()).expect("finite actions");
        sums.iter_mut().zip(&out.reward).for_each(|(sum, reward)| *sum += reward);
    }
    sums
}

/// Commands faster than 5 Hz earn nothing that a slow one or none would not, whatever fin it is.
#[test]
fn fast_commands_do_not_pay() {
    let (slow, fast) = slow_and_fast();
    for id in IDS {
        let mut fins = fins();
        match id {
            "rodgym/FinThrust-v0" => {
                let still = [1.5e6, 1.6e6, 1.7e6, 1.8e6].map(
                    |e| json!({"youngs_modulus": e, "flow_speed": 0.0, "start_pitch": [0.0, 0.0]}),
                );
                let quick = [2.5e5, 1.7e6, 8.11e6].map(
                    |e| json!({"youngs_modulus": e, "flow_speed": 0.3, "start_pitch": [0.0, 0.0]}),
                );
                fins.extend(still.into_iter().chain(quick));
            }
            "rodgym/FinEfficiency-v0" => {
                fins.iter_mut().for_each(|fin| fin["demand"] = json!([0.1, 0.1]));
            }
            _ => {}
        }
        for fin in fins {
            let best = |commands: &[Command]| {
                returns_of(id, &fin, commands).into_iter().fold(f64::NEG_INFINITY, f64::max)
            };
            let (slow, fast) = (best(&slow), best(&fast));
            assert!(slow >= fast, "{id} {fin}: slow {slow}, fast {fast}");
        }
    }
}

/// A rapid chatter on top of a gait goes unnoticed: the servo never hears of it.
#[test]
fn chatter_on_a_gait_does_not_pay() {
    for id in ["rodgym/FinThrust-v0", "rodgym/FinSwim-v0"] {
        for fin in [json!({}), json!({"thesis": true, "stepper": "bdf2"})] {
            let chatter = |a: f64| {
                move |k: usize| sine(0.5, 2.0, k) + if k.is_multiple_of(2) { a } else { -a }
            };
            let (none, some, much) = (chatter(0.0), chatter(0.1), chatter(0.5));
            let r = returns(id, fin, &[&none, &some, &much]);
            let most = r[1].max(r[2]);
            assert!(most < r[0] + 0.1, "{id}: chatter pays {r:?}");
        }
    }
}

/// The thesis' stiff fin can be swum: a slow sine earns what standing still does not.
#[test]
fn the_thesis_fin_can_earn() {
    let r = returns(
        "rodgym/FinThrust-v0",
        json!({"thesis": true, "stepper": "bdf2"}),
        &[&|_| 0.0, &|k| sine(1.0, 1.25, k)],
    );
    assert!(r[0] < 0.0 && r[1] > 5.0, "{r:?}");
}

/// The low-pass has the gain of Butterworth's filter of order ten, and its servo that of a critically damped one.
#[test]
fn the_low_pass_is_butterworths() {
    use rodgym_core::fin::servo::{FREQUENCY, Servo, Ticks};
    let (cutoff, dt) = (3.0, 4e-3);
    let ticks = Ticks::new(dt, Some(cutoff), 1.0);
    for frequency in [0.5, 1.0, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0] {
        let mut servo = Servo::<f64>::default();
        let (mut smoothed, mut pitch) = ([0.0; 2], [0.0; 2]);
        let (settle, window) = (3000, (20.0 / frequency / dt).round() as usize);
        for step in 0..settle + window {
            let phase = TAU * frequency * dt * step as f64;
            servo.advance(0.1 * libm::sin(phase), &ticks);
            if step >= settle {
                let weight = 20.0 / window as f64;
                for (sum, part) in [libm::cos(phase), libm::sin(phase)].into_iter().enumerate() {
                    smoothed[sum] += weight * part * servo.smoothed.last().unwrap().angle;
                    pitch[sum] += weight * part * servo.angle;
                }
            }
        }
        let gain = libm::hypot(smoothed[0], smoothed[1]);
        let expected = 1.0 / (1.0 + (frequency / cutoff).powi(20)).sqrt();
        // First order in the tick of 1 ms; the least damped stage feels it most.
        assert!((gain / expected - 1.0).abs() < 0.15, "{frequency} Hz: {gain}, not {expected}");
        let servo_gain = 1.0 / (1.0 + (TAU * frequency / FREQUENCY).powi(2));
        let found = libm::hypot(pitch[0], pitch[1]) / gain;
        assert!((found / servo_gain - 1.0).abs() < 0.05, "{frequency} Hz: servo {found}");
    }
}

/// A kick every eighth step, whose power a tight bound would forgive, earns less than the sinusoid that gives
/// the same thrust.
#[test]
fn bursts_of_power_do_not_pay() {
    let kick = [0.072, 0.07, 0.104, -0.283, 0.402, 0.054, 0.07, 0.069];
    let kicks = move |k: usize| kick[k % 8];
    // The low-pass takes the kicks themselves; the bound must hold without it too.
    for (cutoff, amplitude) in [(json!(3.0), 0.18), (Value::Null, 0.115)] {
        let steady = |k: usize| sine(amplitude, 3.0, k);
        let start = json!([0.0, 0.0]);
        let kwargs =
            json!({"demand": [0.02, 0.02], "start_pitch": start, "command_cutoff": cutoff});
        let r = returns("rodgym/FinEfficiency-v0", kwargs, &[&kicks, &steady]);
        assert!(r[1] > r[0] + 50.0, "{cutoff}: kicks earn {}, the sinusoid {}", r[0], r[1]);
    }
}

/// Nothing is earned by the settling at the start: a fin that is told to stay where it begins. A single stroke
/// to another pitch earns little thrust (a hull may glide on it).
#[test]
fn holding_still_earns_nothing() {
    let limit = 20f64.to_radians();
    for pitch in [-0.1, 0.0, 0.1] {
        let hold = move |_| pitch / limit;
        for id in ["rodgym/FinThrust-v0", "rodgym/FinSwim-v0"] {
            let r = returns(id, json!({"start_pitch": [pitch, pitch]}), &[&hold]);
            assert!(r[0] < 0.1, "{id}: {r:?} for staying at {pitch} rad");
        }
        let (left, right) = (|_| -1.0, |_| 1.0);
        let start = json!({"start_pitch": [pitch, pitch]});
        let r = returns("rodgym/FinThrust-v0", start, &[&left, &right]);
        assert!(r.iter().all(|&r| r < 1.0), "one stroke from {pitch} rad: {r:?}");
    }
}

/// Bits of what `steps` steps return for environment `watch` of a batch.
fn bits(id: &str, num_envs: usize, num_threads: usize, first: u64, watch: usize) -> Vec<u64> {
    let kwargs = json!({"sensor_noise": {"angle": 0.01, "rate": 0.1}, "actuator_delay": 0.012});
    let mut env = batch(id, num_envs, kwargs);
    env.set_num_threads(num_threads).expect("a few threads");
    let spec = env.spec().clone();
    let mut out = StepBuffer::new(&spec, num_envs);
    env.reset(&Seeds::Base(first), None, &ResetOptions::default(), out.data()).expect("reset");
    let (d, k) = (spec.observation.size(), out.terms.len() / num_envs);
    let mut found = Vec::new();
    for step in 0..25u64 {
        let action = |i: usize| {
            let seed = 1000 * step + first + i as u64;
            rodgym_core::seed::Stream::new(seed).uniform(-1.0, 1.0) as f32
        };
        let actions: Vec<f32> = (0..num_envs).map(action).collect();
        env.step(&actions, out.data()).expect("finite actions");
        found.push(out.reward[watch].to_bits());
        found.extend(out.terms[watch * k..(watch + 1) * k].iter().map(|x| x.to_bits()));
        let seen = &out.observation[watch * d..(watch + 1) * d];
        found.extend(seen.iter().map(|x| u64::from(x.to_bits())));
    }
    found
}

/// Environment 61 of 72, on one thread or two, gives the bits of that environment alone.
#[test]
fn a_fin_gives_the_same_bits_in_any_batch() {
    for id in IDS {
        let alone = bits(id, 1, 1, 61, 0);
        assert_eq!(bits(id, 72, 1, 0, 61), alone, "{id}: in a batch");
        assert_eq!(bits(id, 72, 2, 0, 61), alone, "{id}: on two threads");
        assert_eq!(bits(id, 5, 1, 59, 2), alone, "{id}: in a small batch");
    }
}
