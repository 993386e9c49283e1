//! The promise under test: a step allocates no memory, on one thread or two, through ends of episodes,
//! random draws, solver steps of every kind and those that are taken again in smaller parts. (The first step with threads builds the pool.)
//!
//! A program without the usual harness: the counter below sees every thread, and the harness has one
//! of its own that takes memory when it likes.

use rodgym_core::catalog::{MakeOptions, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer};
use rodgym_core::seed::Stream;
use serde_json::{Value, json};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;
static COUNT: AtomicUsize = AtomicUsize::new(0);

// SAFETY: everything is handed on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }
    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.realloc(old, layout, size) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Keywords that bring every stepper, every random draw and steps in smaller parts into play.
fn variants() -> [(&'static str, Value); 7] {
    let (pendulum, fin) = ("rodgym/PendulumSwingUp-v0", "rodgym/FinThrust-v0");
    [
        (
            pendulum,
            json!({"randomize": {"width": [0.006, 0.009]}, "sensor_noise": {"angle": 1e-3, "rate": 1e-2},
                   "torque_disturbance": 0.01, "actuator_delay": 0.012}),
        ),
        (pendulum, json!({"thesis": true})),
        (pendulum, json!({"stepper": "implicit", "physics_dt": 1e-3, "nodes": 13})),
        (fin, json!({"randomize": {"flow_speed": [0.0, 0.3]}, "sensor_noise": {"angle": 1e-3}})),
        (fin, json!({"stepper": "backward_euler", "hydrodynamics": "morison"})),
        ("rodgym/FinEfficiency-v0", json!({})),
        ("rodgym/FinSwim-v0", json!({})),
    ]
}

/// Allocations during `steps` steps after the first ones.
fn allocations(id: &str, kwargs: &Value, mode: AutoresetMode, n: usize, threads: usize) -> usize {
    let mut env = make(&MakeOptions {
        id: id.into(),
        num_envs: n,
        kwargs: kwargs.as_object().expect("a dictionary").clone(),
        autoreset_mode: mode,
        max_episode_steps: Some(4),
        num_threads: threads,
    })
    .unwrap();
    let mut buffer = StepBuffer::new(&env.spec().clone(), n);
    env.reset(&Seeds::Base(0), None, &ResetOptions::default(), buffer.data()).unwrap();
    let size = env.spec().action.size();
    let actions: Vec<f32> = (0..n * size).map(|i| [1.0, -1.0, 0.3][i % 3]).collect();
    env.step(&actions, buffer.data()).unwrap();
    let (before, mut ends) = (COUNT.load(Ordering::SeqCst), 0);
    for _ in 0..10 {
        env.step(&actions, buffer.data()).unwrap();
        ends += buffer.truncated.iter().filter(|&&cut| cut).count();
    }
    let count = COUNT.load(Ordering::SeqCst) - before;
    assert!(ends >= 2 * n, "episodes end while allocations are counted");
    count
}

/// Allocations of the first steps of machines whose nodes fly apart at random. Many of their implicit steps
/// are taken again in smaller parts: `smaller_parts.rs` shows that.
fn allocations_in_parts(id: &str, kwargs: &Value, straight: &[[f64; 2]], held: usize) -> usize {
    let mut env = make(&MakeOptions {
        id: id.into(),
        num_envs: 8,
        kwargs: kwargs.as_object().expect("a dictionary").clone(),
        autoreset_mode: AutoresetMode::NextStep,
        max_episode_steps: None,
        num_threads: 1,
    })
    .unwrap();
    let mut buffer = StepBuffer::new(&env.spec().clone(), 8);
    let (mut stream, mut count) = (Stream::new(0), 0);
    for _ in 0..20 {
        let mut fly = |i| {
            let v = [stream.uniform(-20.0, 20.0), stream.uniform(-20.0, 20.0)];
            if i < held { [0.0; 2] } else { v }
        };
        let velocities: Vec<_> = (0..straight.len()).map(&mut fly).collect();
        let state = Some(json!({"positions": straight, "velocities": velocities}));
        let options = ResetOptions { state, ..ResetOptions::default() };
        env.reset(&Seeds::Base(0), None, &options, buffer.data()).unwrap();
        let before = COUNT.load(Ordering::SeqCst);
        env.step(&[0.0; 8], buffer.data()).unwrap();
        count += COUNT.load(Ordering::SeqCst) - before;
    }
    count
}

fn main() {
    for (id, kwargs) in variants() {
        for mode in [AutoresetMode::NextStep, AutoresetMode::SameStep] {
            for (n, threads) in [(1, 1), (70, 1), (70, 2)] {
                let count = allocations(id, &kwargs, mode, n, threads);
                assert_eq!(count, 0, "{id} {kwargs} {mode:?}: {n} environments, {threads} threads");
            }
        }
    }
    let pendulum: Vec<_> = (0..7).map(|i| [0.0, -0.05 * f64::from(i)]).collect();
    let fin: Vec<_> = (0..8).map(|i| [0.02 * f64::from(i - 2), 0.0]).collect();
    for stepper in ["implicit", "backward_euler", "bdf2"] {
        let (id, physics_dt, straight, held) = match stepper {
            "bdf2" => ("rodgym/FinThrust-v0", 4e-3, &fin, 4),
            _ => ("rodgym/PendulumSwingUp-v0", 5e-3, &pendulum, 1),
        };
        let kwargs = json!({"stepper": stepper, "physics_dt": physics_dt});
        assert_eq!(allocations_in_parts(id, &kwargs, straight, held), 0, "{stepper}");
    }
    println!("a step allocates nothing: ok");
}
