//! Derivatives of a control step of a fin environment, low-pass, servo, sensors and reward included, are those of small
//! differences of what the environment does.

mod differences;

use differences::{column, distance, slope};
use rodgym_core::batch::{Batch, BatchOptions, Machine, Task};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};
use rodgym_core::fin::tasks::{Efficiency, Swim, Thrust};
use rodgym_core::fin::{Fin, Parameters, Plant};
use rodgym_core::lane::Lanewise;
use rodgym_core::seed::Stream;
use rodgym_core::snapshot::Snapshot;
use rodgym_core::vec2::Vec2;
use rodgym_core::watch::Watch;
use serde_json::{Map, Value, json};

const ACTION: f32 = 0.25;
const INDEX: usize = 1;

/// Three environments that beat, and what the second one is: its plant and its random stream.
fn beating<T: Task<Machine = Fin>>(
    task: &T,
    given: &Map<String, Value>,
) -> (Batch<Fin, f64>, Fin, Plant<f64>, Stream) {
    let options = BatchOptions {
        num_envs: 3,
        autoreset_mode: AutoresetMode::Disabled,
        max_episode_steps: None,
        num_threads: 1,
    };
    let mut env =
        Batch::<Fin, f64>::new("rodgym/Fin", task, given, &options).expect("keywords are allowed");
    let mut buffer = StepBuffer::new(env.spec(), 3);
    env.reset(&Seeds::Base(7), None, &ResetOptions::default(), buffer.data()).expect("it begins");
    for step in 0..12 {
        let action = (0.55 * step as f32).sin() * 0.9;
        env.step(&[action; 3], buffer.data()).expect("it steps");
    }
    let machine = Fin::new(&task.setup(), given).expect("allowed");
    let saved = env.get_state(INDEX).expect("it has one");
    let saved = Snapshot::decode(&saved, env.spec()).expect("it is its own");
    let mut plant = machine.new_plant::<f64>();
    let mut numbers = saved.numbers.iter();
    plant.visit_mut(&mut |x| *x = *numbers.next().expect("they fit"));
    (env, machine, plant, saved.stream)
}

/// Puts a state vector into a plant.
fn place(plant: &mut Plant<f64>, vector: &[f64]) {
    let mut rest = vector.iter().copied();
    let mut next = || rest.next().expect("it has this size");
    let (design, nodes) = (plant.body.design.clone(), plant.body.nodes());
    let mut motion = || {
        let mut x = vec![Vec2::zero(); nodes];
        for (i, x) in x.iter_mut().enumerate() {
            if i != design.geometry.pivot {
                *x = Vec2::new(next(), next());
            } else if design.free_swimming {
                x.x = next();
            }
        }
        let v: Vec<_> = (0..nodes).map(|_| Vec2::new(next(), next())).collect();
        (x, v)
    };
    let (now, before) = (motion(), motion());
    let known = next();
    plant.servo.visit_mut(&mut |x| *x = next());
    let late = rest.len() - 1;
    plant.commands[..late].copy_from_slice(&vector[vector.len() - late - 1..vector.len() - 1]);
    plant.smooth_thrust = vector[vector.len() - 1];
    let pitch = plant.servo.angle;
    // (A motion that is placed has the water's momentum with it.)
    plant.body.set_motion(0, &before.0, &before.1, pitch);
    let earlier = plant.body.now.clone();
    plant.body.set_motion(0, &now.0, &now.1, pitch);
    (plant.body.past.before, plant.body.past.known) = (earlier, known);
}

/// State vector, observation and reward after a control step.
fn after<T: Task<Machine = Fin>>(
    machine: &Fin,
    task: &T,
    mut plant: Plant<f64>,
    stream: &Stream,
    action: f64,
) -> [Vec<f64>; 3] {
    let mut streams = [stream.clone()];
    assert!(machine.step(&mut plant, &[action], true, &mut streams, Watch::nobody()));
    let mut seen = vec![0.0; machine.observation().size()];
    machine.observe(&plant, true, &mut streams, &mut seen);
    let mut more = vec![0.0; T::OBSERVATION.len()];
    task.observe(&plant, &mut more);
    seen.extend(more);
    let mut terms = [0.0; 2];
    task.score(machine, &plant, &mut terms);
    [machine.vector(&plant).expect("it has one"), seen, vec![terms.iter().sum()]]
}

fn check<T: Task<Machine = Fin>>(task: &T, more: &Value) {
    let given = more.as_object().cloned().expect("an object");
    let (env, machine, plant, stream) = beating(task, &given);
    let names: Vec<String> = Parameters::table().iter().map(|row| row.name.into()).collect();
    let found = env.step_jacobian(INDEX, &[ACTION], &names).expect("it steps");
    let state = machine.vector(&plant).expect("it has one");
    let go = |plant: Plant<f64>, action| after(&machine, task, plant, &stream, action);
    let swims = usize::from(machine.config().design.free_swimming);
    let (places, motion) = (14 + swims, 30 + swims);
    // Each of state, observation and reward by one direction. Differences over too long a way go over kinks (of drag, where
    // an edge comes to rest; of the power that is paid), over too short a way they lose digits: the best of five.
    let check = |what: String, kind: usize, j: usize, h: f64, at: &dyn Fn(f64) -> [Vec<f64>; 3]| {
        for part in 0..3 {
            let matrix = &found[3 * part + kind];
            let exact = if part < 2 { column(matrix, j) } else { vec![matrix.values[j]] };
            let size = exact.iter().fold(1e-300f64, |most, x| most.max(x.abs()));
            let off = [0.001, 0.01, 0.05, 0.2, 1.0].map(|share| {
                let other = slope(share * h, &|h| at(h)[part].clone());
                distance(&exact, &other) * size
            });
            let off = off.into_iter().fold(f64::INFINITY, f64::min);
            // (What is lost in the last digits of a reward of about 1 is no error.)
            let most = 1e-7 * size + 1e-11;
            assert!(
                off < most,
                "{}, {more}: part {part} by {what}: {off:.1e}, {size:.1e}",
                T::NAME
            );
        }
    };
    for j in 0..state.len() {
        if j == 2 * motion {
            continue;
        }
        let h = match j {
            j if j < 2 * motion && j % motion < places => 4e-4,
            j if j < 2 * motion => 0.1,
            _ => 0.02,
        };
        check(format!("state {j}"), 0, j, h, &|h| {
            let (mut plant, mut state) = (plant.clone(), state.clone());
            state[j] += h;
            place(&mut plant, &state);
            go(plant, f64::from(ACTION))
        });
    }
    check("action".into(), 1, 0, 0.1, &|h| go(plant.clone(), f64::from(ACTION) + h));
    for (j, name) in names.iter().enumerate() {
        if swims == 1 && name == "flow_speed" {
            continue;
        }
        let value = plant.body.parameters.get(j);
        let h = if value > 0.0 { 0.1 * value } else { 0.01 };
        check(name.clone(), 2, j, h, &|h| {
            let mut plant = plant.clone();
            let mut parameters = plant.body.parameters;
            let mut at = 0;
            parameters.visit_mut(&mut |x: &mut f64| {
                *x += if at == j { h } else { 0.0 };
                at += 1;
            });
            plant.body.set_parameters(0, &parameters);
            // The water's momentum is that of the new water.
            let state = machine.vector(&plant).expect("it has one");
            place(&mut plant, &state);
            go(plant, f64::from(ACTION))
        });
    }
}

#[test]
fn every_column_is_that_of_small_differences() {
    check(&Thrust, &json!({"youngs_modulus": 2.5e5, "damping": 0.05, "actuator_delay": 0.012}));
    check(&Efficiency, &json!({"command_disturbance": 0.02, "sensor_noise": {"angle": 0.01}}));
    check(&Swim, &json!({"observation": "camera", "command_cutoff": null}));
}
