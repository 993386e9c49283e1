//! Derivatives of a control step of an environment, delayed motor, sensors and reward included, are those of small
//! differences of what the environment does.

use rodgym_core::batch::{Batch, BatchOptions, Machine, Task};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};
use rodgym_core::lane::Lanewise;
use rodgym_core::pendulum::tasks::SwingUp;
use rodgym_core::pendulum::{Config, PARAMETERS, Pendulum, Plant, Sensors};
use rodgym_core::seed::Stream;
use rodgym_core::simulation::Named;
use rodgym_core::snapshot::Snapshot;
use rodgym_core::watch::Watch;
use serde_json::{Map, Value, json};

const ACTION: f32 = 0.25;
const INDEX: usize = 1;

fn keywords(more: &Value) -> Map<String, Value> {
    let mut given = json!({
        "nodes": 4,
        "stepper": "verlet",
        "physics_dt": 2e-4,
        "youngs_modulus": 1e5,
        "width": 0.02,
        "damping": 0.05,
        "bending_damping": 0.05,
        "torque_limit": 1.0,
    });
    let map = given.as_object_mut().expect("an object");
    map.extend(more.as_object().cloned().expect("an object"));
    map.clone()
}

/// Three environments in motion.
fn moving(task: &SwingUp, given: &Map<String, Value>) -> Batch<Pendulum, f64> {
    let options = BatchOptions {
        num_envs: 3,
        autoreset_mode: AutoresetMode::Disabled,
        max_episode_steps: None,
        num_threads: 1,
    };
    let id = "rodgym/PendulumSwingUp-v0";
    let mut env =
        Batch::<Pendulum, f64>::new(id, task, given, &options).expect("keywords are allowed");
    let mut buffer = StepBuffer::new(env.spec(), 3);
    // Far from hanging, where the height is clipped.
    let state = json!({"angles": [1.5, 1.6, 1.8], "rates": [1.0, -1.0, 2.0]});
    let options = ResetOptions { state: Some(state), ..ResetOptions::default() };
    env.reset(&Seeds::Base(7), None, &options, buffer.data()).expect("it begins");
    for action in [0.9, -0.4, 0.7, 0.1] {
        env.step(&[action; 3], buffer.data()).expect("it steps");
    }
    env
}

/// What one environment is: its plant and its random stream.
fn inside(env: &Batch<Pendulum, f64>, machine: &Pendulum) -> (Plant<f64>, Stream) {
    let saved = env.get_state(INDEX).expect("it has one");
    let saved = Snapshot::decode(&saved, env.spec()).expect("it is its own");
    let mut plant = machine.new_plant::<f64>();
    let mut numbers = saved.numbers.iter();
    plant.visit_mut(&mut |x| *x = *numbers.next().expect("they fit"));
    (plant, saved.stream)
}

fn on_their_way(config: &Config) -> usize {
    config.delay.div_ceil(config.substeps)
}

/// A number of the state vector, to be changed.
fn number(plant: &mut Plant<f64>, j: usize) -> &mut f64 {
    let nodes = plant.motion.x.len() - 1;
    let (list, rest) = (j / (2 * nodes), j % (2 * nodes));
    let list = match list {
        0 => &mut plant.motion.x,
        1 => &mut plant.motion.v,
        2 => &mut plant.motion.a,
        _ => return &mut plant.commands[j - 6 * nodes],
    };
    let p = &mut list[1 + rest / 2];
    if rest % 2 == 0 { &mut p.x } else { &mut p.y }
}

/// State vector, observation and reward after a control step.
fn after(
    machine: &Pendulum,
    task: &SwingUp,
    mut plant: Plant<f64>,
    stream: &Stream,
    action: f64,
) -> Vec<f64> {
    let mut streams = [stream.clone()];
    assert!(machine.step(&mut plant, &[action], true, &mut streams, Watch::nobody()));
    let states = 6 * (plant.motion.x.len() - 1) + on_their_way(machine.config());
    let mut all: Vec<f64> = (0..states).map(|j| *number(&mut plant, j)).collect();
    let mut seen = vec![0.0; machine.observation().size()];
    machine.observe(&plant, true, &mut streams, &mut seen);
    let mut terms = [0.0; 3];
    task.score(machine, &plant, &mut terms);
    all.extend(seen);
    all.push(terms.iter().sum());
    all
}

/// By central differences, the errors of second and fourth order removed.
fn slope(h: f64, at: &dyn Fn(f64) -> Vec<f64>) -> Vec<f64> {
    let central = |h: f64| -> Vec<f64> {
        at(h).iter().zip(at(-h)).map(|(up, down)| (up - down) / (2.0 * h)).collect()
    };
    let better = |fine: &[f64], coarse: &[f64], factor: f64| -> Vec<f64> {
        fine.iter().zip(coarse).map(|(f, c)| f + (f - c) / (factor - 1.0)).collect()
    };
    let table = [central(h), central(h / 2.0), central(h / 4.0)];
    let (first, second) = (better(&table[1], &table[0], 4.0), better(&table[2], &table[1], 4.0));
    better(&second, &first, 16.0)
}

/// Column `j` of three matrices, one over the other.
fn column(parts: [&Named; 3], j: usize) -> Vec<f64> {
    let columns = *parts[0].shape.last().expect("it has columns");
    let of = |part: &Named| -> Vec<f64> {
        part.values.iter().skip(j).step_by(columns).copied().collect()
    };
    parts.into_iter().flat_map(of).collect()
}

fn compare(what: &str, sizes: [usize; 3], exact: &[f64], other: &[f64]) {
    let mut first = 0;
    for (part, size) in ["state", "observation", "reward"].iter().zip(sizes) {
        let range = first..first + size;
        first += size;
        let largest = |list: &mut dyn Iterator<Item = f64>| list.fold(0.0, f64::max);
        let scale = largest(&mut exact[range.clone()].iter().map(|x| x.abs()));
        let pairs = exact[range.clone()].iter().zip(&other[range]);
        let off = largest(&mut pairs.map(|(a, b)| (a - b).abs()));
        assert!(off <= 1e-8 * scale + 1e-12, "{part} by {what}: {:.1e}", off / scale);
    }
}

#[test]
fn every_column_is_that_of_small_differences() {
    let late = json!({"actuator_delay": 0.013});
    let noisy = json!({
        "sensor_noise": {"angle": 0.01, "rate": 0.1},
        "torque_disturbance": 0.05,
        "observation": "tip",
    });
    for (more, sensors) in
        [(json!({}), Sensors::Full), (late, Sensors::Base), (noisy, Sensors::Tip)]
    {
        let (task, given) = (SwingUp { sensors }, keywords(&more));
        let env = moving(&task, &given);
        let machine = Pendulum::new(&task.setup(), &given).expect("allowed");
        let (plant, stream) = inside(&env, &machine);
        let names: Vec<String> = PARAMETERS.iter().map(|row| row.name.into()).collect();
        let found = env.step_jacobian(INDEX, &[ACTION], &names).expect("it steps");
        let [a, b, p, c, d, q, reward_state, reward_action, reward_parameters] = &found[..] else {
            panic!("nine arrays")
        };
        let states = a.shape[0];
        assert_eq!(states, 18 + on_their_way(machine.config()));
        let sizes = [states, c.shape[0], 1];
        let value = f64::from(ACTION);
        let go = |plant: Plant<f64>, action: f64| after(&machine, &task, plant, &stream, action);
        for j in 0..states {
            let h = if j < 6 {
                2e-4
            } else if j < 12 {
                0.05
            } else if j < 18 {
                5.0
            } else {
                0.2
            };
            let other = slope(h, &|h| {
                let mut plant = plant.clone();
                *number(&mut plant, j) += h;
                go(plant, value)
            });
            compare(&format!("state {j}"), sizes, &column([a, c, reward_state], j), &other);
        }
        let other = slope(0.2, &|h| go(plant.clone(), value + h));
        compare("action", sizes, &column([b, d, reward_action], 0), &other);
        for (j, row) in PARAMETERS.iter().enumerate() {
            let other = slope(0.02 * plant.parameters[j], &|h| {
                let mut plant = plant.clone();
                plant.parameters[j] += h;
                let rod = rodgym_core::pendulum::config::uniform(4, &plant.parameters);
                rod.shape(&mut plant.rod);
                go(plant, value)
            });
            let exact = column([p, q, reward_parameters], j);
            compare(row.name, sizes, &exact, &other);
        }
    }
}

#[test]
fn an_action_that_is_clipped_has_no_slope() {
    let task = SwingUp { sensors: Sensors::Full };
    let env = moving(&task, &keywords(&json!({})));
    for (action, moves) in [(-1.0, true), (1.0, true), (1.5, false), (-3.0, false)] {
        let found = env.step_jacobian(0, &[action], &[]).expect("it steps");
        assert_eq!(found[1].values.iter().any(|x| *x != 0.0), moves, "{action}");
    }
    assert!(env.step_jacobian(0, &[f32::NAN], &[]).is_err());
    let error = env.step_jacobian(0, &[0.0], &["colour".into()]).expect_err("no such parameter");
    assert!(error.to_string().contains("'colour'") && error.to_string().contains("width"));
}

#[test]
fn the_gradient_of_an_episode_is_that_of_small_differences() {
    let late = json!({"actuator_delay": 0.013, "torque_disturbance": 0.05});
    for more in [json!({}), late, json!({"stepper": "esdirk3", "physics_dt": 2e-3})] {
        let (task, given) = (SwingUp { sensors: Sensors::Full }, keywords(&more));
        let env = moving(&task, &given);
        let machine = Pendulum::new(&task.setup(), &given).expect("allowed");
        let (plant, stream) = inside(&env, &machine);
        // (So weak that the rate term stays away from where it is full.)
        let actions: Vec<f32> = (0..12).map(|t| 0.3 * (t as f32 * 0.7).sin()).collect();
        let names = ["width".into(), "torque_limit".into()];
        let found = env.rollout_gradient(INDEX, &actions, &names).expect("it steps");
        let [rewards, by_actions, by_state, by_parameters] = &found[..] else {
            panic!("four arrays")
        };
        let actions: Vec<f64> = actions.iter().map(|&a| f64::from(a)).collect();
        let total = |mut plant: Plant<f64>, actions: &[f64]| -> Vec<f64> {
            let (mut streams, mut sum) = ([stream.clone()], 0.0);
            for action in actions {
                assert!(machine.step(&mut plant, &[*action], true, &mut streams, Watch::nobody()));
                let mut terms = [0.0; 3];
                task.score(&machine, &plant, &mut terms);
                sum += terms.iter().sum::<f64>();
            }
            vec![sum]
        };
        let sum: f64 = rewards.values.iter().sum();
        assert!((sum - total(plant.clone(), &actions)[0]).abs() < 1e-13);
        // (Newton's tolerance limits the differences of an implicit scheme.)
        let most = if more["stepper"] == "esdirk3" { 1e-5 } else { 1e-8 };
        let check = |what: String, list: &Named, j: usize, other: Vec<f64>| {
            let scale = list.values.iter().fold(0.0f64, |most, x| most.max(x.abs()));
            let off = (list.values[j] - other[0]).abs() / scale;
            assert!(off < most, "{more}: {what}: {} {} {off:.1e}", list.values[j], other[0]);
        };
        for t in 0..actions.len() {
            let other = slope(0.02, &|h| {
                let mut actions = actions.clone();
                actions[t] += h;
                total(plant.clone(), &actions)
            });
            check(format!("action {t}"), by_actions, t, other);
        }
        for j in (0..12).chain(18..by_state.values.len()) {
            let h = if j < 6 { 2e-4 } else { 0.05 };
            let other = slope(h, &|h| {
                let mut plant = plant.clone();
                *number(&mut plant, j) += h;
                total(plant, &actions)
            });
            check(format!("state {j}"), by_state, j, other);
        }
        for (j, place) in [0, 7].into_iter().enumerate() {
            let other = slope(0.004 * plant.parameters[place], &|h| {
                let mut plant = plant.clone();
                plant.parameters[place] += h;
                let rod = rodgym_core::pendulum::config::uniform(4, &plant.parameters);
                rod.shape(&mut plant.rod);
                total(plant, &actions)
            });
            check(format!("parameter {place}"), by_parameters, j, other);
        }
    }
}
