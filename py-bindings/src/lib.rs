//! `rodgym._native`: the Rust core as a Python extension module.
//!
//! One file a subject; each has a `register` that adds its classes and functions to the module. The
//! Python package around it (`python/rodgym`) gives them Gymnasium's and Stable-Baselines3's faces.
//!
//! Whatever Python can call stands under `#[caught]` (`faults`), and takes its arrays through `arrays`.

mod analysis;
mod arguments;
mod arrays;
mod baselines;
mod batch;
mod convert;
mod errors;
mod faults;
mod infos;
mod interrupt;
mod lock;
mod machine;
mod render;
mod riccati;
mod search;
mod serve;
mod sim;
mod thesis;

use pyo3::prelude::*;

/// The Rust core of rodgym. Use the package `rodgym`; this module is its engine.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    register(module)
}

/// Adds everything of rodgym to a module: what an extension of one's own calls after it has added to the
/// catalogue (`examples/own-task/wheel`).
///
/// # Errors
/// Python is out of memory, or the module has something of that name.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    analysis::register(module)?;
    baselines::register(module)?;
    convert::register(module)?;
    batch::register(module)?;
    infos::register(module)?;
    lock::register(module)?;
    machine::register(module)?;
    render::register(module)?;
    riccati::register(module)?;
    search::register(module)?;
    serve::register(module)?;
    sim::register(module)?;
    thesis::register(module)?;
    Ok(())
}
