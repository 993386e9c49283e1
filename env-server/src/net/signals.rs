//! SIGTERM and SIGINT: the first asks to stop, the second stops at once.
//!
//! Handlers of our own, since under Python the interpreter's cannot run while Rust holds the thread;
//! what was there before comes back at the end.

use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

static COUNT: AtomicUsize = AtomicUsize::new(0);

/// Whether a stop was asked for.
pub fn stop_requested() -> bool {
    COUNT.load(SeqCst) > 0
}

#[cfg(unix)]
extern "C" fn count(signal: libc::c_int) {
    if COUNT.fetch_add(1, SeqCst) > 0 {
        // SAFETY: _exit may be called from a signal handler.
        unsafe { libc::_exit(128 + signal) };
    }
}

/// Our handlers, for as long as this lives.
pub struct Signals {
    #[cfg(unix)]
    before: Vec<(libc::c_int, libc::sigaction)>,
}

impl Signals {
    /// Takes the signals over.
    pub fn take() -> Self {
        COUNT.store(0, SeqCst);
        Signals {
            #[cfg(unix)]
            before: [libc::SIGTERM, libc::SIGINT].into_iter().map(|s| (s, replace(s))).collect(),
        }
    }
}

#[cfg(unix)]
fn replace(signal: libc::c_int) -> libc::sigaction {
    // SAFETY: zero is a valid sigaction; the handler only touches an atomic and _exit.
    unsafe {
        let mut ours: libc::sigaction = std::mem::zeroed();
        let mut before: libc::sigaction = std::mem::zeroed();
        ours.sa_sigaction = count as *const () as usize;
        libc::sigaction(signal, &raw const ours, &raw mut before);
        before
    }
}

#[cfg(unix)]
impl Drop for Signals {
    fn drop(&mut self) {
        for (signal, before) in &self.before {
            // SAFETY: `before` is what sigaction gave us for this signal.
            unsafe { libc::sigaction(*signal, before, std::ptr::null_mut()) };
        }
    }
}
