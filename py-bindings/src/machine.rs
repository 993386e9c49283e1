//! What the processor offers and what the lanes use of it.

use crate::errors::OrRaise;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use rodgym_caught::caught;
use rodgym_core::isa::Isa;

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let names = Isa::available().into_iter().map(Isa::name);
    module.add("INSTRUCTION_SETS", PyTuple::new(module.py(), names.collect::<Vec<_>>())?)?;
    module.add_function(wrap_pyfunction!(instruction_set, module)?)
}

/// The instruction set in use: the last of `INSTRUCTION_SETS`, or the one that the environment
/// variable `RODGYM_ISA` named when it was first asked for (an error where this machine has no set of that
/// name). Results do not depend on it.
#[caught]
#[pyfunction]
fn instruction_set() -> PyResult<&'static str> {
    Ok(Isa::current().or_raise()?.name())
}
