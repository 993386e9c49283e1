//! A few threads that belong to one batch.
//!
//! Threads sleep on a condition variable between jobs. The pool is built at first use, never at import, and notices
//! when the process was forked: threads do not survive a fork, so the child builds its own.

use crate::fault::{Fault, caught};
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long a caller that has nothing left to do looks for the others before it sleeps.
const PATIENCE: Duration = Duration::from_micros(50);

/// Work of thread i, the caller's thread being 0.
type Work = dyn Fn(usize) + Sync;

/// A borrowed piece of work whose lifetime was erased.
#[derive(Clone, Copy)]
struct Job(*const Work);
// SAFETY: `Pool::run` returns only after every thread is done with the work, and the work is `Sync`.
unsafe impl Send for Job {}

#[derive(Default)]
struct State {
    job: Option<Job>,
    generation: u64,
    fault: Option<Fault>,
    stop: bool,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    wake: Condvar,
    done: Condvar,
    /// Helpers that have not finished the job.
    running: AtomicUsize,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic is carried to the caller by hand, so a poisoned lock guards nothing broken.
        self.state.lock().unwrap_or_else(|poison| poison.into_inner())
    }

    /// Waits until the helpers have finished.
    fn wait(&self) -> MutexGuard<'_, State> {
        // The others are at their last item: to fall asleep and be woken would take longer than that.
        let start = Instant::now();
        while self.running.load(Ordering::Acquire) > 0 && start.elapsed() < PATIENCE {
            std::hint::spin_loop();
        }
        let mut state = self.lock();
        while self.running.load(Ordering::Acquire) > 0 {
            state = self.done.wait(state).unwrap_or_else(|poison| poison.into_inner());
        }
        state
    }
}

/// Threads beside the caller's.
pub struct Pool {
    shared: Arc<Shared>,
    helpers: Vec<JoinHandle<()>>,
    /// The next item of each thread's range.
    next: Vec<Counter>,
    process: u32,
}

/// A counter that shares its cache line with no other.
#[derive(Default)]
#[repr(align(128))]
struct Counter(AtomicUsize);

impl Pool {
    /// A pool in which `threads` threads work, the caller's among them.
    pub fn new(threads: usize) -> std::io::Result<Pool> {
        let shared = Arc::new(Shared::default());
        let next = (0..threads).map(|_| Counter::default()).collect();
        let mut pool = Pool { shared, helpers: vec![], next, process: std::process::id() };
        for i in 1..threads {
            let shared = pool.shared.clone();
            let name = format!("rodgym-{i}");
            pool.helpers
                .push(std::thread::Builder::new().name(name).spawn(move || help(&shared, i))?);
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
    fn run(&self, work: &(dyn Fn(usize) + Sync)) {
        // SAFETY: only the lifetime changes; no thread touches the work after this function returns.
        let job =
            Job(unsafe { std::mem::transmute::<&(dyn Fn(usize) + Sync), &'static Work>(work) });
        {
            let mut state = self.shared.lock();
            state.job = Some(job);
            state.generation += 1;
            self.shared.running.store(self.helpers.len(), Ordering::Relaxed);
        }
        self.shared.wake.notify_all();
        let own = caught(|| work(0)).err();
        let mut state = self.shared.wait();
        state.job = None;
        let fault = own.or(state.fault.take());
        drop(state);
        if let Some(fault) = fault {
            resume_unwind(Box::new(fault));
        }
    }
}

/// A pointer to the first of many items, shared among threads.
struct Items<T>(*mut T);
// SAFETY: `Pool::share` gives each item to one thread only, and `T: Send` may be handed over.
unsafe impl<T: Send> Sync for Items<T> {}

impl Pool {
    /// Calls `work` once for every item, each item in one thread.
    ///
    /// Thread i takes the items of its own range one by one, and then what the others have left: so an item
    /// is mostly in the same core's cache at every call, and a thread that the system holds up keeps nobody.
    pub fn share<T: Send>(&mut self, items: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
        let (total, threads) = (items.len(), self.threads());
        let end = |range: usize| (range + 1) * total / threads;
        for (range, next) in self.next.iter().enumerate() {
            next.0.store(range * total / threads, Ordering::Relaxed);
        }
        let items = &Items(items.as_mut_ptr());
        self.run(&|thread| {
            for range in (thread..threads).chain(0..thread) {
                loop {
                    let i = self.next[range].0.fetch_add(1, Ordering::Relaxed);
                    if i >= end(range) {
                        break;
                    }
                    // SAFETY: the counters hand out each index once, and all are below the length.
                    work(i, unsafe { &mut *items.0.add(i) });
                }
            }
        });
    }
}

/// The life of a helping thread.
fn help(shared: &Shared, thread: usize) {
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
        if let Err(fault) = caught(|| work(thread)) {
            shared.lock().fault = Some(fault);
        }
        if shared.running.fetch_sub(1, Ordering::AcqRel) == 1 {
            // Under the lock, lest the caller falls asleep between its look at `running` and this.
            let _state = shared.lock();
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
            // A helper cannot have panicked: its work runs under `caught`.
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
            pool.run(&|_| {
                calls.fetch_add(1, Ordering::Relaxed);
            });
        }
        assert_eq!(calls.load(Ordering::Relaxed), 300);
    }

    #[test]
    fn a_panic_reaches_the_caller_and_the_pool_lives_on() {
        let pool = Pool::new(2).unwrap();
        // Whichever thread it was: what happened and where is not lost on the way.
        let only = |thread| {
            let work = move |this| assert!(this != thread, "on purpose");
            caught(|| pool.run(&work)).unwrap_err()
        };
        for fault in [only(0), only(1)] {
            assert_eq!(fault.what, "on purpose");
            assert!(fault.place.starts_with(file!()), "{fault}");
        }
        let calls = AtomicUsize::new(0);
        pool.run(&|_| {
            calls.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!(calls.load(Ordering::Relaxed), 2);
    }

    #[test]
    fn every_item_is_worked_on_once() {
        for threads in [2, 3, 7] {
            let mut pool = Pool::new(threads).unwrap();
            for total in [0, 1, threads, 100] {
                let mut calls = vec![0; total];
                pool.share(&mut calls, |i, call| *call += 1 + i);
                let expected: Vec<_> = (1..=total).collect();
                assert_eq!(calls, expected);
            }
        }
    }

    #[test]
    fn a_thread_that_is_held_up_leaves_its_items_to_others() {
        let mut pool = Pool::new(2).unwrap();
        let mut items = [(); 8];
        let done = AtomicUsize::new(0);
        pool.share(&mut items, |i, ()| {
            // The first item of the second range lasts until all others are done.
            let start = Instant::now();
            while i == 4 && done.load(Ordering::Relaxed) < 7 {
                assert!(start.elapsed() < Duration::from_secs(60), "nobody took the others");
                std::thread::yield_now();
            }
            done.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!(done.load(Ordering::Relaxed), 8);
    }
}
