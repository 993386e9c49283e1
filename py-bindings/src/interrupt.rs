//! Ctrl-C during long work. Python sees signals in its main thread and under the GIL only; so the work goes to a thread
//! of its own, while the calling one waits and looks.

use pyo3::prelude::*;
use rodgym_core::fault::caught;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Duration;

/// Time between two looks at Ctrl-C.
pub const LOOK: Duration = Duration::from_millis(20);

/// Does the work without the GIL. Ctrl-C sets the flag that the work has: it should end soon then. Returns its result,
/// and the interrupt, if there was one.
///
/// # Panics
/// When the work does.
pub fn watched<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> T + Send,
) -> (T, Option<PyErr>) {
    let stop = AtomicBool::new(false);
    let (done, mut result) = sync_channel(1);
    let mut work = Some(work);
    let mut call = || {
        let work = work.take().expect("called once");
        caught(|| work(&stop))
    };
    let ended = thread::scope(|scope| {
        let send = || {
            // (The receiver waits for as long as this thread lives.)
            let _ = done.send(call());
        };
        let started = thread::Builder::new().name("rodgym-step".into()).spawn_scoped(scope, send);
        if started.is_err() {
            return None;
        }
        let mut interrupt = None;
        loop {
            let result = &mut result;
            match py.detach(move || result.recv_timeout(LOOK)) {
                Ok(ended) => return Some((ended, interrupt)),
                Err(RecvTimeoutError::Timeout) if interrupt.is_none() => {
                    interrupt = py.check_signals().err();
                    stop.store(interrupt.is_some(), Ordering::Relaxed);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => unreachable!("a panic is sent, too"),
            }
        }
    });
    // Without a thread to spare nobody can look.
    let (ended, interrupt) = ended.unwrap_or_else(|| (py.detach(call), None));
    match ended {
        Ok(result) => (result, interrupt),
        Err(fault) => resume_unwind(Box::new(fault)),
    }
}
