//! What `make` promises to the ledger suffices: no batch of ours takes more, however long its rods are.

use rodgym_core::catalog::{self, MakeOptions};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer};
use rodgym_core::fin::Geometry;
use rodgym_server::server::Factory;
use rodgym_server::size::Size;
use serde_json::{Value, json};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// The system's allocator, with its bytes counted.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: everything is handed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Relaxed) + layout.size();
        PEAK.fetch_max(held, Relaxed);
        // SAFETY: the caller's promise is the system's.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise is the system's.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The fin of 197 nodes.
fn long_fin() -> Value {
    let fin = Geometry::thesis().refined(28).expect("28 is more than 0");
    json!({
        "geometry": {
            "edge_length": fin.edge_length, "height": fin.height, "pivot": fin.pivot,
            "widths": fin.widths, "areas": fin.areas,
        },
        "stiffness_profile": fin.stiffness,
    })
}

#[test]
fn a_batch_takes_no_more_than_was_promised_for_it() {
    let factory: Factory = Arc::new(catalog::make);
    for catalog::Entry { id, machine, .. } in catalog::entries() {
        let longest = match machine {
            "fin" => long_fin(),
            _ => json!({"nodes": 1001, "physics_dt": 0.01}),
        };
        for (kwargs, envs) in [(json!({}), 1), (json!({}), 256), (longest, 5)] {
            let mut options = MakeOptions {
                id: (*id).into(),
                num_envs: envs,
                kwargs: kwargs.as_object().expect("a map").clone(),
                autoreset_mode: AutoresetMode::SameStep,
                max_episode_steps: Some(2),
                num_threads: 1,
            };
            let size = Size::of(&factory, &mut options, false).expect("it can be made");
            let before = HELD.load(Relaxed);
            PEAK.store(before, Relaxed);
            let mut env = factory(&options).expect("it can be made");
            let mut buffer = StepBuffer::new(env.spec(), envs);
            let actions = vec![0.5; envs * env.spec().action.size()];
            env.reset(&Seeds::Base(0), None, &ResetOptions::default(), buffer.data())
                .expect("it can be reset");
            for _ in 0..3 {
                env.step(&actions, buffer.data()).expect("it can be stepped");
            }
            let (took, promised) = (PEAK.load(Relaxed) - before, size.memory(1));
            println!("{id}, {envs}: {took} of {promised}");
            assert!(took <= promised, "{id}, {envs}: {took} of {promised}");
        }
    }
}
