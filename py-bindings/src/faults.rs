//! No panic crosses the border: what stands under `#[caught]` (crate rodgym-caught) is called through here.

use crate::errors::raise;
use pyo3::prelude::*;
use rodgym_core::fault;

/// What the work returns; a panic in it as a `RodgymError` that says what happened and where.
pub fn caught<T>(work: impl FnOnce() -> PyResult<T>) -> PyResult<T> {
    fault::caught(work).unwrap_or_else(|fault| {
        let text = format!(
            "a fault of rodgym {} itself: {fault}. Nothing that you call may do this: please report it, with this \
             message and the call",
            env!("CARGO_PKG_VERSION")
        );
        Err(raise("RodgymError", text))
    })
}
