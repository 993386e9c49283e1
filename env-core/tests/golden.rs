//! The promise under test: behaviour under an id does not change. Seeded random episodes of every id, stepper, water
//! model and sensor set give today the bits that are kept in `tests/data/golden.json`.
//!
//! Where a change of behaviour is meant, `RODGYM_WRITE_GOLDEN=1 cargo test -p rodgym-core --test golden` writes
//! the file anew, and CHANGELOG.md says so.

use rodgym_core::catalog::{self, MakeOptions, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, Spec, StepBuffer, VectorEnv};
use rodgym_core::fin::BareFin;
use rodgym_core::pendulum::BarePendulum;
use rodgym_core::seed::Stream;
use rodgym_core::simulation::Simulation;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/golden.json");
/// Eleven environments: a full block of lanes, and one that is filled in part.
const ENVS: usize = 11;
const STEPS: usize = 50;

/// FNV-1a: sixty-four bits that depend on every byte and its place.
struct Hash(u64);

impl Hash {
    fn new() -> Self {
        Hash(0xcbf2_9ce4_8422_2325)
    }
    fn word(&mut self, word: u64) {
        for byte in word.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    fn numbers<'a>(&mut self, numbers: impl IntoIterator<Item = &'a f64>) {
        numbers.into_iter().for_each(|x| self.word(x.to_bits()));
    }
    fn pairs(&mut self, pairs: &[[f64; 2]]) {
        self.numbers(pairs.iter().flatten());
    }
    fn hex(&self) -> String {
        format!("{:016x}", self.0)
    }
}

fn map(value: &Value) -> Map<String, Value> {
    value.as_object().expect("a dictionary").clone()
}

/// What every id is run with, beside its defaults.
fn common() -> Vec<Value> {
    vec![
        json!({}),
        json!({"thesis": true, "control_dt": 0.01}),
        json!({"sensor_noise": {"angle": 1e-2, "rate": 1e-1}}),
        json!({"actuator_delay": 0.012, "physics_dt": 1e-3, "stepper": "backward_euler"}),
        json!({"randomize": {"density": [1000.0, 2000.0], "youngs_modulus": ["log_uniform", 2e5, 4e5]}}),
    ]
}

fn pendulums() -> Vec<Value> {
    vec![
        json!({"stepper": "implicit"}),
        json!({"stepper": "implicit", "nodes": 13, "physics_dt": 2e-3, "observation": "tip",
               "sensor_noise": {"angle": 1e-2, "rate": 1e-1}, "torque_disturbance": 0.01}),
        json!({"stepper": "bdf2", "nodes": 3}),
        json!({"stepper": "tr_bdf2", "physics_dt": 5e-4}),
        json!({"stepper": "esdirk3", "nodes": 13, "physics_dt": 5e-3, "actuator_delay": 0.015}),
        json!({"physics_dt": 2e-4}),
        json!({"physics_dt": 1e-3}),
        json!({"stepper": "verlet"}),
        json!({"stepper": "backward_euler", "physics_dt": 5e-4, "observation": "base",
               "sensor_noise": {"angle": 1e-3, "rate": 1e-2}}),
        json!({"nodes": 2, "torque_disturbance": 0.02}),
        json!({"nodes": 21, "damping": 0.01, "bending_damping": 1e-3, "actuator_delay": 0.0306,
               "physics_dt": 2e-4, "control_dt": 0.02}),
        json!({"youngs_modulus": 1e9, "width": 0.004, "observation": "base"}),
        json!({"randomize": {"width": [0.006, 0.009], "length": [0.25, 0.35],
               "torque_limit": ["log_uniform", 0.02, 0.1]}, "start_angle": [-3.0, 3.0],
               "start_bend": [-1.0, 1.0], "gravity": 1.6}),
        json!({"start_angle": [-3.0, 3.0], "start_rate": [-5.0, 5.0], "actuator_gain": 0.8,
               "push": {"torque": 0.1, "start": 0.055, "duration": 0.05}}),
    ]
}

fn fins() -> Vec<Value> {
    let mut all: Vec<Value> = ["lighthill", "morison", "resistive", "air"]
        .iter()
        .flat_map(|water| {
            ["bdf2", "backward_euler"]
                .map(|stepper| json!({"hydrodynamics": water, "stepper": stepper}))
        })
        .collect();
    all.extend([
        json!({"observation": "camera", "sensor_noise": {"angle": 1e-2, "rate": 1e-1}}),
        json!({"command_cutoff": null, "pitch_limit": 0.2, "youngs_modulus": 1e6}),
        json!({"command_cutoff": 5.0, "power_weight": 0.3, "start_pitch": [-0.3, 0.3], "demand": [0.05, 0.3],
               "actuator_delay": 0.05, "physics_dt": 2e-3}),
        json!({"geometry": {"edge_length": 0.025, "height": 0.08, "pivot": 1,
                            "widths": [0.01, 0.012, 0.012, 0.01, 0.006, 0.0]},
               "stiffness_profile": [1.0, 1.0, 2.0, 1.0, 0.5, 1.0], "bending_damping": 2e-3, "damping": 0.05}),
        json!({"actuator_gain": 1.2, "command_disturbance": 0.1}),
    ]);
    all
}

/// Adds all that is defined of a step's results.
fn record(hash: &mut Hash, buffer: &StepBuffer, spec: &Spec, mode: AutoresetMode) {
    let d = spec.observation.size();
    let k = spec.reward_terms.len() + spec.metrics.len();
    let p = spec.parameters.len();
    let floats =
        |hash: &mut Hash, x: &[f32]| x.iter().for_each(|x| hash.word(u64::from(x.to_bits())));
    floats(hash, &buffer.observation);
    hash.numbers(&buffer.reward);
    for i in 0..ENVS {
        let flags = [
            &buffer.terminated,
            &buffer.truncated,
            &buffer.stepped,
            &buffer.began,
            &buffer.solver_failure,
        ];
        flags.iter().for_each(|flag| hash.word(u64::from(flag[i])));
        if buffer.stepped[i] {
            hash.numbers(&buffer.terms[i * k..(i + 1) * k]);
        }
        if buffer.began[i] {
            hash.numbers(&buffer.parameters[i * p..(i + 1) * p]);
        }
        if mode == AutoresetMode::SameStep && (buffer.terminated[i] || buffer.truncated[i]) {
            floats(hash, &buffer.final_observation[i * d..(i + 1) * d]);
        }
    }
}

/// Random episodes, twenty steps long at most.
fn episodes(id: &str, kwargs: &Value, mode: AutoresetMode) -> String {
    let options = MakeOptions {
        id: id.into(),
        num_envs: ENVS,
        kwargs: map(kwargs),
        autoreset_mode: mode,
        max_episode_steps: Some(20),
        num_threads: 1,
    };
    let mut env = make(&options).unwrap_or_else(|error| panic!("{id} {kwargs}: {error}"));
    let spec = env.spec().clone();
    let mut buffer = StepBuffer::new(&spec, ENVS);
    let mut hash = Hash::new();
    env.reset(&Seeds::Base(7), None, &ResetOptions::default(), buffer.data()).unwrap();
    record(&mut hash, &buffer, &spec, mode);
    let mut draws = Stream::new(1);
    for step in 0..STEPS {
        let actions: Vec<f32> = (0..ENVS).map(|_| draws.uniform(-1.2, 1.2) as f32).collect();
        env.step(&actions, buffer.data()).unwrap();
        record(&mut hash, &buffer, &spec, mode);
        if mode == AutoresetMode::Disabled {
            let ended: Vec<bool> =
                (0..ENVS).map(|i| buffer.terminated[i] || buffer.truncated[i]).collect();
            if ended.iter().any(|&e| e) {
                env.reset(&Seeds::Continue, Some(&ended), &ResetOptions::default(), buffer.data())
                    .unwrap();
                record(&mut hash, &buffer, &spec, mode);
            }
        } else if step == 30 {
            exact_start(env.as_mut(), &spec, &mut buffer, &mut hash, mode);
        }
    }
    hash.hex()
}

/// An exact start of every third environment, at the parameters and places that the first has now.
fn exact_start(
    env: &mut dyn VectorEnv,
    spec: &Spec,
    buffer: &mut StepBuffer,
    hash: &mut Hash,
    mode: AutoresetMode,
) {
    let mask: Vec<bool> = (0..ENVS).map(|i| i % 3 == 0).collect();
    let nodes = env.nodes(0).unwrap();
    hash.pairs(&nodes.positions);
    hash.pairs(&nodes.velocities);
    let mut options = ResetOptions::from(nodes);
    let values = env.parameters(0).unwrap();
    for (row, value) in spec.parameters.iter().zip(values) {
        options.parameters.insert(row.name.into(), json!(value));
    }
    env.reset(
        &Seeds::Each((0..ENVS as u64).map(Some).collect()),
        Some(&mask),
        &options,
        buffer.data(),
    )
    .unwrap();
    record(hash, buffer, spec, mode);
}

fn bare_pendulum(kwargs: &Value, gain: f64) -> String {
    let mut sim = BarePendulum::new(&map(kwargs)).expect("allowed");
    let edges = sim.nodes() - 1;
    let angles: Vec<f64> = (0..edges).map(|k| 2.0 + 0.1 * k as f64).collect();
    sim.set_angles(&angles, &vec![0.5; edges]).unwrap();
    sim.step(0.01, 40).unwrap();
    if gain != 0.0 {
        sim.step_feedback(0.01, &vec![gain; 2 * edges], 20).unwrap();
    }
    sim.step(-0.02, 7).unwrap();
    let mut hash = Hash::new();
    let state = sim.state();
    hash.pairs(&state.positions);
    hash.pairs(&state.velocities);
    hash.numbers(&sim.angles());
    hash.numbers(&sim.rates());
    let energy = sim.energy();
    hash.numbers(&[energy.kinetic, energy.stretch, energy.bend, energy.gravity]);
    let linear = sim.linearize(0.01);
    hash.numbers(linear.a.iter().chain(&linear.b).chain(&linear.c));
    hash.hex()
}

fn bare_fin(kwargs: &Value) -> String {
    let mut fin = BareFin::from_keywords(&map(kwargs)).expect("allowed");
    let mut hash = Hash::new();
    for i in 0..40 {
        fin.step(0.2 * libm::sin(0.2 * f64::from(i)), 1).unwrap();
        hash.numbers(&[
            fin.loads().thrust,
            fin.loads().mount_thrust,
            fin.loads().power,
            fin.loads().torque,
        ]);
    }
    fin.drive(0.3, 30).unwrap();
    let (x, v) = (fin.positions(), fin.velocities());
    hash.pairs(&x);
    hash.pairs(&v);
    let forces = fin.forces(&x, &v).unwrap();
    for part in [
        forces.elastic,
        forces.fluid_momentum,
        forces.fluid_gradient,
        forces.tail_flux,
        forces.resistive,
    ] {
        hash.pairs(&part);
    }
    let energy = fin.energy();
    hash.numbers(&[
        forces.elastic_energy,
        forces.fluid_energy,
        energy.kinetic,
        energy.stretch,
        energy.bend,
        energy.fluid,
    ]);
    fin.set_state(&x, &v).unwrap();
    fin.step(fin.pitch(), 3).unwrap();
    hash.pairs(&fin.positions());
    hash.hex()
}

/// Every case by name, with its hash today.
fn today() -> BTreeMap<String, String> {
    let mut all = BTreeMap::new();
    let modes = [AutoresetMode::NextStep, AutoresetMode::SameStep, AutoresetMode::Disabled];
    for catalog::Entry { id, machine, .. } in catalog::entries() {
        let own = match machine {
            "pendulum" => pendulums(),
            "fin" => fins(),
            other => panic!("no cases for a {other}"),
        };
        for (i, kwargs) in common().iter().chain(&own).enumerate() {
            // Every keyword set in one mode, the defaults in all of them.
            for mode in if i == 0 { &modes[..] } else { &modes[i % 3..i % 3 + 1] } {
                all.insert(format!("{id} {kwargs} {mode:?}"), episodes(id, kwargs, *mode));
            }
        }
    }
    for (kwargs, gain) in [
        (json!({}), 0.0),
        (json!({"stepper": "implicit"}), 1e-3),
        (json!({"stepper": "backward_euler", "physics_dt": 5e-4}), 1e-3),
        (json!({"thesis": true, "nodes": 9}), 1e-3),
        (json!({"nodes": 31}), 0.0),
    ] {
        all.insert(format!("bare pendulum {kwargs} {gain}"), bare_pendulum(&kwargs, gain));
    }
    for water in ["lighthill", "morison", "resistive", "air"] {
        for (stepper, swims) in [("bdf2", false), ("backward_euler", false), ("bdf2", true)] {
            let kwargs = json!({"hydrodynamics": water, "stepper": stepper, "free_swimming": swims,
                                "physics_dt": 4e-3, "bending_damping": 1e-3});
            all.insert(format!("bare fin {kwargs}"), bare_fin(&kwargs));
        }
    }
    all
}

#[test]
fn every_machine_task_and_stepper_has_the_bits_that_are_kept() {
    let found = today();
    if std::env::var_os("RODGYM_WRITE_GOLDEN").is_some() {
        let text = serde_json::to_string_pretty(&found).unwrap() + "\n";
        std::fs::write(FILE, text).unwrap();
    }
    let text = std::fs::read_to_string(FILE).expect("tests/data/golden.json");
    let kept: BTreeMap<String, String> = serde_json::from_str(&text).expect("a map of hashes");
    let names = |all: &BTreeMap<String, String>| all.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&found), names(&kept), "the cases are those of the file");
    let changed: Vec<_> =
        found.iter().filter(|(name, hash)| kept[*name] != **hash).map(|(name, _)| name).collect();
    assert!(changed.is_empty(), "{} of {} changed: {changed:#?}", changed.len(), kept.len());
}
