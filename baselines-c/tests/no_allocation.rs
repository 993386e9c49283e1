//! A controller at work takes no memory, nor does a refusal.

use rodgym_controllers::{Handle, Quantity, Status};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ffi::{CString, c_char};
use std::ptr::{null, null_mut};

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

// What the header declares: C sees a controller as a pointer alone, and never what is in it.
#[allow(improper_ctypes, reason = "a handle is only passed on")]
unsafe extern "C" {
    fn rodgym_design(
        name: *const c_char,
        id: *const c_char,
        keywords: *const c_char,
        controller: *mut *mut Handle,
    ) -> Status;
    fn rodgym_state_size(controller: *const Handle) -> usize;
    fn rodgym_observation_size(controller: *const Handle) -> usize;
    fn rodgym_observe(
        angles: *const f64,
        rates: *const f64,
        edges: usize,
        observation: *mut f32,
        observation_size: usize,
    ) -> Status;
    fn rodgym_start(
        controller: *const Handle,
        observation: *const f32,
        observation_size: usize,
        state: *mut f64,
        state_size: usize,
    ) -> Status;
    fn rodgym_step(
        controller: *const Handle,
        observation: *const f32,
        observation_size: usize,
        state: *mut f64,
        state_size: usize,
        action: *mut f32,
        action_size: usize,
    ) -> Status;
    fn rodgym_estimate(
        controller: *const Handle,
        state: *const f64,
        state_size: usize,
        index: usize,
        quantity: *mut Quantity,
        name: *mut c_char,
        unit: *mut c_char,
        text_size: usize,
    ) -> Status;
    fn rodgym_free(controller: *mut Handle);
}

#[test]
fn a_controller_takes_no_memory_while_it_acts() {
    let base = "rodgym/PendulumSwingUpBase-v0";
    let full = "rodgym/PendulumSwingUp-v0";
    for (name, id, edges) in [
        ("lqr", full, 6),
        ("lqr-hybrid", full, 6),
        ("lqg", base, 1),
        ("lqg-adaptive", base, 1),
        ("thesis-lqr", full, 6),
        ("thesis-lqg", base, 1),
    ] {
        let [name, id] = [name, id].map(|text| CString::new(text).unwrap());
        let mut law = null_mut();
        // SAFETY: the pointers are those of live texts and of a live place.
        let made = unsafe { rodgym_design(name.as_ptr(), id.as_ptr(), null(), &mut law) };
        assert_eq!(made, Status::Ok);
        // SAFETY: `law` was made above.
        let (n, d) = unsafe { (rodgym_state_size(law), rodgym_observation_size(law)) };
        assert_eq!(d, 3 * edges);
        let (mut state, mut observation, mut action) = (vec![0.0; n], vec![0.0_f32; d], [0.0_f32]);
        let (angles, rates) = (vec![2.6; edges], vec![0.3; edges]);
        let mut found = Quantity { value: 0.0, low: 0.0, high: 0.0 };
        let before = TAKEN.get();
        // SAFETY: every array is as long as is said, and no two overlap.
        unsafe {
            let (x, s) = (observation.as_mut_ptr(), state.as_mut_ptr());
            assert_eq!(rodgym_observe(angles.as_ptr(), rates.as_ptr(), edges, x, d), Status::Ok);
            assert_eq!(rodgym_start(law, x, d, s, n), Status::Ok);
            for _ in 0..50 {
                assert_eq!(rodgym_step(law, x, d, s, n, action.as_mut_ptr(), 1), Status::Ok);
                assert_eq!(rodgym_step(law, x, d, s, n, action.as_mut_ptr(), 2), Status::Size);
            }
            let (name, unit) = (null_mut(), null_mut());
            let told = rodgym_estimate(law, s, n, 0, &mut found, name, unit, 0);
            assert_eq!(told == Status::Ok, found.value > 0.0);
            observation[0] = f32::INFINITY;
            let x = observation.as_ptr();
            let refused = rodgym_step(law, x, d, s, n, action.as_mut_ptr(), 1);
            assert_eq!(refused, Status::Observation);
        }
        assert_eq!(TAKEN.get(), before, "{name:?}");
        assert!(action[0] != 0.0 && action[0].abs() <= 1.0);
        // SAFETY: `law` was made above, and is used no more.
        unsafe { rodgym_free(law) };
    }
}
