//! Promises of the fin environments: bounded rewards that nothing but swimming well can earn, the servo of the
//! reference, failures that never reach the agent as NaN.

use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};
use rodgym_core::registry::{MakeOptions, make};
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

/// Commands faster than 5 Hz earn nothing: alone they lose against the best slow sine, and a rapid chatter
/// on top of that sine only costs (in FinEfficiency it may bring the thrust to the demand).
#[test]
fn fast_commands_do_not_pay() {
    for id in IDS {
        // A larger demand than a gait gives, or a smaller one, is met by none of them.
        let kwargs =
            if id == "rodgym/FinEfficiency-v0" { json!({"demand": [0.1, 0.1]}) } else { json!({}) };
        let slow: Vec<Box<dyn Fn(usize) -> f64>> =
            [(0.4, 2.5), (0.3, 3.0), (0.3, 3.5), (0.25, 3.0)]
                .into_iter()
                .map(|(a, f)| Box::new(move |k: usize| sine(a, f, k)) as Box<dyn Fn(usize) -> f64>)
                .collect();
        let fast: Vec<Box<dyn Fn(usize) -> f64>> = [5.5, 6.25, 7.0, 8.33, 10.0, 12.5]
            .into_iter()
            .flat_map(|f| [0.1, 0.3, 1.0].into_iter().map(move |a| (a, f)))
            .map(|(a, f)| {
                // A quarter period off, so that 12.5 Hz is not sampled at its zeros.
                Box::new(move |k: usize| a * libm::cos(TAU * f * 0.04 * k as f64))
                    as Box<dyn Fn(usize) -> f64>
            })
            .collect();
        let best = |commands: &[Box<dyn Fn(usize) -> f64>]| {
            let list: Vec<&dyn Fn(usize) -> f64> = commands.iter().map(|c| c.as_ref()).collect();
            returns(id, kwargs.clone(), &list).into_iter().fold(f64::NEG_INFINITY, f64::max)
        };
        let (slow, fast) = (best(&slow), best(&fast));
        assert!(slow > fast, "{id}: slow {slow}, fast {fast}");
        if id == "rodgym/FinEfficiency-v0" {
            continue;
        }
        let chatter =
            |a: f64| move |k: usize| sine(0.3, 2.0, k) + if k.is_multiple_of(2) { a } else { -a };
        let (none, some, much) = (chatter(0.0), chatter(0.1), chatter(0.25));
        let r = returns(id, json!({}), &[&none, &some, &much]);
        assert!(r[0] > r[1] && r[1] > r[2], "{id}: chatter pays {r:?}");
    }
}

/// A kick every eighth step, whose power a tight bound would forgive, earns less than the sinusoid that gives
/// the same thrust.
#[test]
fn bursts_of_power_do_not_pay() {
    let kick = [0.072, 0.07, 0.104, -0.283, 0.402, 0.054, 0.07, 0.069];
    let kicks = move |k: usize| kick[k % 8];
    let steady = |k: usize| sine(0.115, 3.0, k);
    let kwargs = json!({"demand": [0.02, 0.02], "start_pitch": [0.0, 0.0]});
    let r = returns("rodgym/FinEfficiency-v0", kwargs, &[&kicks, &steady]);
    assert!(r[1] > r[0] + 50.0, "kicks earn {}, the sinusoid {}", r[0], r[1]);
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
