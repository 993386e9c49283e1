//! `serve`: the network server inside a wheel, the same code as the program `rodgym-server`.

#[cfg(not(feature = "server"))]
use crate::errors::raise;
use pyo3::prelude::*;
use rodgym_caught::caught;
use std::ffi::OsString;

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(serve, module)?)
}

/// Runs `rodgym-server` with these arguments and returns its exit code. Blocks until SIGTERM or
/// SIGINT, which are the server's own while it runs; other threads go on.
#[cfg(feature = "server")]
#[caught]
#[pyfunction]
fn serve(py: Python<'_>, arguments: Vec<OsString>) -> PyResult<u8> {
    Ok(py.detach(|| rodgym_server::net::cli::main(arguments)))
}

/// This build has no server: it explains the options, and says how to get one.
#[cfg(not(feature = "server"))]
#[caught]
#[pyfunction]
fn serve(arguments: Vec<OsString>) -> PyResult<u8> {
    const HELP: &str = include_str!("../../env-server/src/net/help.txt");
    const MISSING: &str = "this build of rodgym has no network server. Wheels have it; in a clone, `make server` adds it (some minutes, once)";
    if arguments.iter().any(|word| word == "-h" || word == "--help") {
        print!("{HELP}\nBut {MISSING}.\n");
        return Ok(0);
    }
    Err(raise("RodgymError", MISSING))
}
