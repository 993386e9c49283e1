//! A controller takes no memory while it acts: it may run where there is none to take.

use rodgym_baselines::registry::{Target, make};
use rodgym_core::catalog::{self, MakeOptions};
use rodgym_core::env::AutoresetMode;
use serde_json::json;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// The system's allocator, counted.
struct Counted;

thread_local! {
    /// What this thread took. (The harness has threads of its own, which take what they need.)
    static TAKEN: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: everything is passed on to the system's allocator.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        TAKEN.set(TAKEN.get() + 1);
        // SAFETY: as our caller promises.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as our caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

#[test]
fn output_feedback_takes_no_memory_while_it_acts() {
    // A weak motor pumps, a late one forecasts.
    let kwargs = json!({"width": 0.012, "actuator_delay": 0.015});
    let options = MakeOptions {
        id: "rodgym/PendulumSwingUpBase-v0".into(),
        num_envs: 1,
        kwargs: kwargs.as_object().unwrap().clone(),
        autoreset_mode: AutoresetMode::NextStep,
        max_episode_steps: None,
        num_threads: 1,
    };
    let env = catalog::make(&options).unwrap();
    for name in ["lqg", "lqg-adaptive"] {
        let law = make(name, &Target::from(env.spec())).unwrap();
        let mut state = vec![0.0; law.state_size()];
        let (observation, mut action) = ([-0.8, 0.6, 0.1], [0.0]);
        let before = TAKEN.get();
        law.predict(&observation, &mut state, &[true], &mut action).unwrap();
        for _ in 0..200 {
            law.predict(&observation, &mut state, &[false], &mut action).unwrap();
        }
        assert_eq!(TAKEN.get(), before, "{name}");
    }
}
