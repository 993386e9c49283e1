//! A lock that waits without the GIL and knows when it can never be had: after a fork.

use crate::errors::raise;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::PyDict;
use rodgym_caught::caught;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, TryLockError};

/// Forks between the process that imported the module first and this one.
static FORKS: AtomicU64 = AtomicU64::new(0);

/// Tells Python to count forks (Windows has none).
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    let Ok(register) = py.import("os")?.getattr("register_at_fork") else { return Ok(()) };
    let hook = PyDict::new(py);
    hook.set_item("after_in_child", wrap_pyfunction!(forked, module)?)?;
    register.call((), Some(&hook))?;
    Ok(())
}

#[caught]
#[pyfunction]
fn forked() -> PyResult<()> {
    FORKS.fetch_add(1, Ordering::Relaxed);
    Ok(())
}

/// A value that one thread uses at a time.
///
/// A fork copies the lock as it is, but only the thread that forks: what another thread held then stays
/// locked in the child for ever, and half changed. The child's first use of a lock happens under the GIL
/// before any other use in that process, so a lock that is taken at that moment is such a lock.
pub struct Lock<T> {
    inner: Mutex<T>,
    /// `FORKS` when this was last found free or made.
    seen: AtomicU64,
    /// What the value is, for messages.
    name: &'static str,
}

impl<T> Lock<T> {
    pub fn new(name: &'static str, value: T) -> Self {
        let seen = AtomicU64::new(FORKS.load(Ordering::Relaxed));
        Lock { inner: Mutex::new(value), seen, name }
    }

    /// The value, waiting without the GIL while another thread has it.
    pub fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, T>> {
        let forks = FORKS.load(Ordering::Relaxed);
        if self.seen.load(Ordering::Relaxed) != forks {
            if matches!(self.inner.try_lock(), Err(TryLockError::WouldBlock)) {
                return Err(self.unusable(
                    "another thread was using it when this process was forked; \
                     make another one here, or fork while no thread uses it",
                ));
            }
            self.seen.store(forks, Ordering::Relaxed);
        }
        let locked = self.inner.lock_py_attached(py);
        locked.map_err(|_| self.unusable("an earlier call ended in a panic"))
    }

    fn unusable(&self, why: &str) -> PyErr {
        raise("RodgymError", format!("this {} is not usable: {why}", self.name))
    }
}
