//! `own_task._extension`: everything of `rodgym._native`, and the task of this crate in its catalogue.

use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;

/// The core of rodgym with one more task.
#[pymodule]
fn _extension(module: &Bound<'_, PyModule>) -> PyResult<()> {
    own_task::register().map_err(|error| PyImportError::new_err(error.to_string()))?;
    rodgym_bindings::register(module)
}
