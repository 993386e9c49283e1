//! The promise under test: a step allocates no memory, on one thread or two, through ends of episodes,
//! random draws and solver steps of every kind. (The first step with threads builds the pool.)
//!
//! A program without the usual harness: the counter below sees every thread, and the harness has one
//! of its own that takes memory when it likes.

use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer};
use rodgym_core::registry::{MakeOptions, make};
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

/// Keywords that bring every stepper and every random draw into play.
fn variants() -> [Value; 3] {
    [
        json!({"randomize": {"width": [0.006, 0.009]}, "sensor_noise": {"angle": 1e-3, "rate": 1e-2},
               "torque_disturbance": 0.01, "actuator_delay": 0.012}),
        json!({"thesis": true}),
        json!({"stepper": "implicit", "physics_dt": 1e-3, "nodes": 13}),
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

fn main() {
    for kwargs in variants() {
        for mode in [AutoresetMode::NextStep, AutoresetMode::SameStep] {
            for (n, threads) in [(1, 1), (70, 1), (70, 2)] {
                let id = "rodgym/PendulumSwingUp-v0";
                let count = allocations(id, &kwargs, mode, n, threads);
                assert_eq!(count, 0, "{kwargs} {mode:?}: {n} environments, {threads} threads");
            }
        }
    }
    println!("a step allocates nothing: ok");
}
