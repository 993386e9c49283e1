//! Errors of the core as Python exceptions.
//!
//! The tree itself is Python (`rodgym.errors`), where users, documentation and type checkers read it.

use pyo3::prelude::*;
use rodgym_core::Error;

/// Name of the class in `rodgym.errors` that stands for an error of the core.
fn class_name(error: &Error) -> &'static str {
    match error {
        Error::UnknownEnv { .. } => "UnknownEnvError",
        Error::UnknownKeyword { .. } => "UnknownKeywordError",
        Error::UnknownParameter { .. } | Error::Parameter { .. } => "ParameterError",
        Error::Shape { .. } => "ShapeError",
        Error::Action { .. } => "ActionError",
        Error::NeedsReset { .. } | Error::NotReset => "ResetNeededError",
        Error::Index { .. } => "EnvIndexError",
        Error::Snapshot { .. } => "SnapshotError",
        Error::Solver { .. } => "SolverError",
    }
}

/// An exception of class `rodgym.errors.<class>` with this message.
pub fn raise(class: &str, message: impl Into<String>) -> PyErr {
    let message: String = message.into();
    Python::attach(|py| {
        let made = py.import("rodgym.errors").and_then(|m| m.getattr(class)?.call1((message,)));
        made.map_or_else(|error| error, PyErr::from_value)
    })
}

/// The core's error as a Python exception.
pub fn to_py(error: Error) -> PyErr {
    raise(class_name(&error), error.to_string())
}

/// Turns results of the core into results of Python functions.
pub trait OrRaise<T> {
    /// The value, or the error as a Python exception.
    fn or_raise(self) -> PyResult<T>;
}

impl<T> OrRaise<T> for rodgym_core::Result<T> {
    fn or_raise(self) -> PyResult<T> {
        self.map_err(to_py)
    }
}
