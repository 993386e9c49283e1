//! Promise: a rehearsal of an environment has the environment's bits and leaves it alone; its derivatives, by fewer numbers,
//! say the same as those by the whole state.

use rodgym_core::catalog::{MakeOptions, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};
use rodgym_core::simulation::Named;
use serde_json::{Value, json};

fn environment(id: &str, kwargs: Value) -> (Box<dyn VectorEnv>, StepBuffer) {
    let mut env = make(&MakeOptions {
        id: id.into(),
        num_envs: 1,
        kwargs: kwargs.as_object().unwrap().clone(),
        autoreset_mode: AutoresetMode::Disabled,
        max_episode_steps: None,
        num_threads: 1,
    })
    .unwrap();
    let mut buffer = StepBuffer::new(env.spec(), 1);
    env.reset(&Seeds::Base(5), None, &ResetOptions::default(), buffer.data()).unwrap();
    (env, buffer)
}

/// Actions that bend the rod well.
fn action(t: usize) -> f32 {
    if t % 9 < 4 { 0.9 } else { -0.7 }
}

#[test]
fn it_has_the_bits_of_the_environment_and_leaves_it_alone() {
    for kwargs in [
        json!({}),
        json!({"stepper": "esdirk3"}),
        json!({"actuator_delay": 0.015, "torque_disturbance": 0.01, "sensor_noise": {"angle": 0.1}}),
    ] {
        let (mut env, mut buffer) = environment("rodgym/PendulumSwingUp-v0", kwargs);
        let before = env.get_state(0).unwrap();
        let mut rehearsal = env.rehearsal(0).unwrap();
        let rewards: Vec<f64> =
            (0..50).map(|t| rehearsal.step(f64::from(action(t))).unwrap()).collect();
        assert!(env.get_state(0).unwrap() == before);
        for (t, reward) in rewards.into_iter().enumerate() {
            env.step(&[action(t)], buffer.data()).unwrap();
            assert_eq!(buffer.data().reward[0].to_bits(), reward.to_bits(), "step {t}");
        }
    }
}

fn named<'a>(all: &'a [Named], name: &str) -> &'a [f64] {
    &all.iter().find(|row| row.name == name).unwrap().values
}

/// Rows times columns.
fn product(a: &[f64], b: &[f64], inner: usize) -> Vec<f64> {
    let columns = b.len() / inner;
    let entry =
        |i: usize, j: usize| (0..inner).map(|k| a[i * inner + k] * b[k * columns + j]).sum();
    (0..a.len() / inner)
        .flat_map(|i| (0..columns).map(move |j| (i, j)))
        .map(|(i, j)| entry(i, j))
        .collect()
}

#[test]
fn derivatives_by_fewer_numbers_say_the_same_as_those_by_the_whole_state() {
    for kwargs in [
        json!({}),
        json!({"nodes": 4, "physics_dt": 2e-4, "actuator_delay": 0.015}),
        json!({"stepper": "backward_euler", "nodes": 5}),
    ] {
        let (mut env, mut buffer) = environment("rodgym/PendulumSwingUp-v0", kwargs.clone());
        for t in 0..20 {
            env.step(&[action(t)], buffer.data()).unwrap();
        }
        let all = env.step_jacobian(0, &[0.3], &[]).unwrap();
        let full = named(&all, "reward_state").len();
        let rehearsal = env.rehearsal(0).unwrap();
        let few = rehearsal.expand(f64::from(0.3_f32)).unwrap();
        let n = few.reward_slopes.len() - 1;
        assert_eq!(rehearsal.state().unwrap().len(), n);
        // The map from the whole state to the few numbers: x, v + a dt/2, torques on their way.
        let list = 2 * (env.spec().config["nodes"].as_u64().unwrap() as usize - 1);
        let merged = full - n;
        assert_eq!(merged, if env.spec().config["stepper"] == "verlet" { list } else { 0 });
        let mut map = vec![0.0; n * full];
        for i in 0..n {
            let from = if i < 2 * list { i } else { i + merged };
            map[i * full + from] = 1.0;
            if merged > 0 && (list..2 * list).contains(&i) {
                map[i * full + i + list] = 0.5 * env.spec().physics_dt;
            }
        }
        let strip = |rows: &[f64]| -> (Vec<f64>, Vec<f64>) {
            let rows = rows.chunks(n + 1);
            (
                rows.clone().flat_map(|row| row[..n].to_vec()).collect(),
                rows.map(|row| row[n]).collect(),
            )
        };
        let (a, b) = strip(&few.next);
        let (reward, paid) = strip(&few.reward_slopes);
        for (ours, theirs) in [
            (product(&a, &map, n), product(&map, named(&all, "A"), full)),
            (b, product(&map, named(&all, "B"), full)),
            (product(&reward, &map, n), named(&all, "reward_state").to_vec()),
            (paid, named(&all, "reward_action").to_vec()),
        ] {
            assert_eq!(ours.len(), theirs.len());
            let size = theirs.iter().fold(0.0, |size: f64, x| size.max(x.abs()));
            for (ours, theirs) in ours.iter().zip(&theirs) {
                assert!((ours - theirs).abs() <= 1e-12 * size, "{kwargs}: {ours} {theirs}");
            }
        }
        // Positions and velocities are the first numbers of the state.
        assert_eq!(few.coordinates.len(), 2 * list);
        assert_eq!(&few.coordinates_slopes[..(n + 1) * list], &few.next[..(n + 1) * list]);
    }
}

#[test]
fn residuals_have_the_slope_of_the_reward_and_what_has_none_says_so() {
    // About up next to nothing is lost, so that squares of residuals have nearly all of the curvature.
    let up = std::f64::consts::PI;
    let keywords = json!({"start_angle": [up, up]});
    let (mut env, mut buffer) = environment("rodgym/PendulumSwingUp-v0", keywords);
    env.step(&[0.0], buffer.data()).unwrap();
    // Two expansions that differ by the action alone: the change of the slope is the residuals' curvature.
    let expand = |action: f64| env.rehearsal(0).unwrap().expand(action).unwrap();
    let (h, middle) = (1e-4, expand(0.01));
    let (plus, minus) = (expand(0.01 + h), expand(0.01 - h));
    let n = middle.reward_slopes.len() - 1;
    let loss = |e: &rodgym_core::batch::Expansion| -e.reward_slopes[n];
    let curvature = (loss(&plus) - loss(&minus)) / (2.0 * h);
    let gauss: f64 = middle.residuals.chunks(n + 1).map(|row| row[n] * row[n]).sum();
    assert!((curvature - gauss).abs() < 0.05 * gauss, "{curvature} {gauss}");
    let (balance, _) = environment("rodgym/PendulumBalance-v0", json!({}));
    assert!(balance.rehearsal(0).unwrap().expand(0.0).unwrap().residuals.is_empty());
}
