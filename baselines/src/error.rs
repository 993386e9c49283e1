//! The error type of this crate: a sentence with the offending value for each case.

use thiserror::Error;

/// Shorthand for results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// What can be refused.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Error {
    /// A matrix equation without the solution that was asked for.
    #[error("the {equation} has no stabilising solution: {reason}")]
    NoSolution {
        /// Which equation.
        equation: &'static str,
        /// What went wrong, with numbers.
        reason: String,
    },
    /// A matrix equation whose solution rounding has spoilt; there may well be one.
    #[error("the {equation} cannot be solved accurately: {reason}")]
    Inaccurate {
        /// Which equation.
        equation: &'static str,
        /// What is left, with numbers.
        reason: String,
    },
    /// A parameter outside its range.
    #[error("{name} = {value} is not allowed: it must be {allowed}")]
    Parameter {
        /// Keyword, in the words that users type.
        name: String,
        /// The value as given.
        value: String,
        /// What would be allowed.
        allowed: String,
    },
    /// An array of the wrong shape.
    #[error("{name} has shape {got}, but {expected} is needed")]
    Shape {
        /// Which array.
        name: String,
        /// Its shape.
        got: String,
        /// The shape that is needed.
        expected: String,
    },
    /// An environment that this controller cannot play.
    #[error("{controller} cannot control this environment: {reason}")]
    Unsuitable {
        /// Name of the controller.
        controller: &'static str,
        /// What is missing.
        reason: String,
    },
    /// Bytes that are no saved controller, or a controller that cannot be saved.
    #[error("not the file of a controller: {reason}")]
    Saved {
        /// What is wrong.
        reason: String,
    },
    /// Refused by the core.
    #[error(transparent)]
    Core(#[from] rodgym_core::Error),
}

/// Builds an [`Error::Parameter`].
pub(crate) fn parameter(name: &str, value: impl ToString, allowed: &str) -> Error {
    let value = rodgym_core::error::shown(value.to_string());
    Error::Parameter { name: name.into(), value, allowed: allowed.into() }
}

/// Builds an [`Error::Shape`].
pub(crate) fn shape(name: &str, got: impl ToString, expected: impl ToString) -> Error {
    Error::Shape { name: name.into(), got: got.to_string(), expected: expected.to_string() }
}

/// Builds an [`Error::Saved`].
pub(crate) fn unsaved(reason: impl ToString) -> Error {
    Error::Saved { reason: reason.to_string() }
}
