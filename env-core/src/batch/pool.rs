//! A few threads that belong to one batch.
//!
//! Idle threads sleep on a condition variable. The pool is built at first use, never at import, and notices
//! when the process was forked: threads do not survive a fork, so the child builds its own.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;

type Work = dyn Fn() + Sync;

/// A borrowed piece of work whose lifetime was erased.
#[derive(Clone, Copy)]
struct Job(*const Work);
// SAFETY: `Pool::run` returns only after every thread is done with the work, and the work is `Sync`.
unsafe impl Send for Job {}

#[derive(Default)]
struct State {
    job: Option<Job>,
    generation: u64,
    running: usize,
    panic: Option<Box<dyn std::any::Any + Send>>,
    stop: bool,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    wake: Condvar,
    done: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic is carried to the caller by hand, so a poisoned lock guards nothing broken.
        self.state.lock().unwrap_or_else(|poison| poison.into_inner())
    }
}

/// Threads beside the caller's.
pub struct Pool {
    shared: Arc<Shared>,
    helpers: Vec<JoinHandle<()>>,
    process: u32,
}

impl Pool {
    /// A pool in which `threads` threads work, the caller's among them.
    pub fn new(threads: usize) -> std::io::Result<Pool> {
        let shared = Arc::new(Shared::default());
        let mut pool = Pool { shared, helpers: vec![], process: std::process::id() };
        for i in 1..threads {
            let shared = pool.shared.clone();
            let name = format!("rodgym-{i}");
            pool.helpers.push(std::thread::Builder::new().name(name).spawn(move || help(&shared))?);
        }
        Ok(pool)
    }

    /// Whether the threads live in this process (they do not after a fork).
    pub fn is_alive(&self) -> bool {
        self.process == std::process::id()
    }

    /// Number of threads that work, the caller's among them.
    pub fn threads(&self) -> usize {
        self.helpers.len() + 1
    }

    /// Calls `work` once in every thread, the caller's among them, and waits for all.
    ///
    /// # Panics
    /// When `work` panicked anywhere.
    pub fn run(&self, work: &(dyn Fn() + Sync)) {
        // SAFETY: only the lifetime changes; no thread touches the work after this function returns.
        let job = Job(unsafe { std::mem::transmute::<&(dyn Fn() + Sync), &'static Work>(work) });
        {
            let mut state = self.shared.lock();
            state.job = Some(job);
            state.generation += 1;
            state.running = self.helpers.len();
        }
        self.shared.wake.notify_all();
        let own = catch_unwind(AssertUnwindSafe(work));
        let mut state = self.shared.lock();
        while state.running > 0 {
            state = self.shared.done.wait(state).unwrap_or_else(|poison| poison.into_inner());
        }
        state.job = None;
        let helpers = state.panic.take();
        drop(state);
        if let Err(panic) = own {
            resume_unwind(panic);
        }
        if let Some(panic) = helpers {
            resume_unwind(panic);
        }
    }
}

/// A pointer to the first of many items, shared among threads.
struct Items<T>(*mut T);
// SAFETY: `Pool::share` gives each item to one thread only, and `T: Send` may be handed over.
unsafe impl<T: Send> Sync for Items<T> {}

impl Pool {
    /// Calls `work` once for every item, each item in one thread.
    pub fn share<T: Send>(&self, items: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
        let total = items.len();
        // Small portions, so that a thread that the system holds up leaves its share to others.
        let portion = (total / (32 * self.threads())).max(1);
        let next = AtomicUsize::new(0);
        let items = &Items(items.as_mut_ptr());
        self.run(&|| {
            loop {
                let begin = next.fetch_add(portion, Ordering::Relaxed);
                if begin >= total {
                    return;
                }
                for i in begin..(begin + portion).min(total) {
                    // SAFETY: the counter hands out each index once, and all are below the length.
                    work(i, unsafe { &mut *items.0.add(i) });
                }
            }
        });
    }
}

/// The life of a helping thread.
fn help(shared: &Shared) {
    let mut seen = 0;
    loop {
        let job = {
            let mut state = shared.lock();
            loop {
                if state.stop {
                    return;
                }
                if state.generation != seen {
                    seen = state.generation;
                    break state.job.expect("a new generation comes with a job");
                }
                state = shared.wake.wait(state).unwrap_or_else(|poison| poison.into_inner());
            }
        };
        // SAFETY: `run` keeps the work alive until `running` is 0, which happens below.
        let work = unsafe { &*job.0 };
        let result = catch_unwind(AssertUnwindSafe(work));
        let mut state = shared.lock();
        if let Err(panic) = result {
            state.panic = Some(panic);
        }
        state.running -= 1;
        if state.running == 0 {
            shared.done.notify_one();
        }
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        if !self.is_alive() {
            // The threads are the parent's: there is nobody to wait for, and the lock may be held for ever.
            self.helpers.drain(..).for_each(std::mem::forget);
            std::mem::forget(self.shared.clone());
            return;
        }
        self.shared.lock().stop = true;
        self.shared.wake.notify_all();
        for helper in self.helpers.drain(..) {
            // A helper cannot have panicked: its work runs under catch_unwind.
            let _ = helper.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_thread_works_once_a_run() {
        let pool = Pool::new(3).unwrap();
        let calls = AtomicUsize::new(0);
        for _ in 0..100 {
            pool.run(&|| {
                calls.fetch_add(1, Ordering::Relaxed);
            });
        }
        assert_eq!(calls.load(Ordering::Relaxed), 300);
    }

    #[test]
    fn a_panic_reaches_the_caller_and_the_pool_lives_on() {
        let pool = Pool::new(2).unwrap();
        let result = catch_unwind(AssertUnwindSafe(|| pool.run(&|| panic!("on purpose"))));
        assert!(result.is_err());
        let calls = AtomicUsize::new(0);
        pool.run(&|| {
            calls.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!(calls.load(Ordering::Relaxed), 2);
    }
}
