//! Environment steps a second: bare physics in lanes, and the batch around it, one thread.
//!
//! `cargo bench -p rodgym-core`. `rodgym bench` measures the same through Python, beside other simulators.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rodgym_core::batch::Machine;
use rodgym_core::catalog::{MakeOptions, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer};
use rodgym_core::isa::{ForLanes, Isa, with_lanes};
use rodgym_core::lane::{Kernel, Real};
use rodgym_core::pendulum::{Pendulum, Plant, Setup};
use rodgym_core::watch::Watch;
use serde_json::{Map, Value, json};
use std::hint::black_box;

const ID: &str = "rodgym/PendulumSwingUp-v0";
const ENVS: usize = 1024;

fn variants() -> [(&'static str, Value); 4] {
    [
        ("verlet", json!({})),
        ("implicit", json!({"stepper": "implicit", "physics_dt": 1e-3})),
        ("thesis", json!({"thesis": true})),
        ("31 nodes", json!({"nodes": 31})),
    ]
}

fn map(value: &Value) -> Map<String, Value> {
    value.as_object().expect("a dictionary").clone()
}

/// A control step of a block of plants without observation, reward, clock or reset.
struct Bare<'a, R: Real>(&'a mut Plant<R>, &'a Pendulum);

impl<R: Real> Kernel for Bare<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let action = R::from_fn(|lane| [0.1, -0.3, 0.5, -0.7, 0.9, -0.2, 0.4, 0.0][lane]);
        black_box(self.0.control_step(self.1.config(), action, R::zero(), Watch::nobody()));
    }
}

/// Plants in blocks of lanes, as a function that steps them all once.
struct Blocks(Pendulum);

impl ForLanes for Blocks {
    type Output = Box<dyn FnMut()>;
    fn make<R: Real>(self) -> Self::Output {
        let Blocks(machine) = self;
        let mut plants = vec![machine.new_plant::<R>(); ENVS / R::LANES];
        Box::new(move || plants.iter_mut().for_each(|p| R::run(Bare(p, &machine))))
    }
}

fn physics(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("physics");
    group.throughput(Throughput::Elements(ENVS as u64)).sample_size(10);
    for (name, kwargs) in variants() {
        let machine = Pendulum::new(&Setup::default(), &map(&kwargs)).unwrap();
        let mut step = with_lanes(Isa::current().unwrap(), Blocks(machine));
        group.bench_function(name, |b| b.iter(&mut step));
    }
}

fn batch(criterion: &mut Criterion) {
    let pendulums = variants().map(|(name, kwargs)| (name, ID, kwargs));
    let fins =
        [("fin", "rodgym/FinThrust-v0", json!({})), ("swimmer", "rodgym/FinSwim-v0", json!({}))];
    let mut group = criterion.benchmark_group("batch");
    group.throughput(Throughput::Elements(ENVS as u64)).sample_size(10);
    for (name, id, kwargs) in pendulums.into_iter().chain(fins) {
        let mut env = make(&MakeOptions {
            id: id.into(),
            num_envs: ENVS,
            kwargs: map(&kwargs),
            autoreset_mode: AutoresetMode::NextStep,
            max_episode_steps: Some(500),
            num_threads: 1,
        })
        .unwrap();
        let mut buffer = StepBuffer::new(&env.spec().clone(), ENVS);
        env.reset(&Seeds::Base(0), None, &ResetOptions::default(), buffer.data()).unwrap();
        let actions: Vec<f32> = (0..ENVS).map(|i| (i as f32 / 512.0) - 1.0).collect();
        group.bench_function(name, |b| b.iter(|| env.step(&actions, buffer.data()).unwrap()));
    }
}

criterion_group!(benches, physics, batch);
criterion_main!(benches);
