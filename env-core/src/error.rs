//! The one error type of the core: a sentence with the offending value for each case.

use thiserror::Error;

/// Shorthand for results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// What can be refused. Whatever is refused leaves the state as it was.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Error {
    /// No environment of that id.
    #[error("unknown environment '{id}'; known ids: {known}")]
    UnknownEnv {
        /// The id as given.
        id: String,
        /// All ids, separated by commas.
        known: String,
    },
    /// A keyword that the environment does not have, in the words of Python.
    #[error("got an unexpected keyword argument '{name}'; known parameters: {known}")]
    UnknownKeyword {
        /// The keyword as given.
        name: String,
        /// All keywords, separated by commas.
        known: String,
    },
    /// A name, within a value, that nothing has.
    #[error("unknown parameter '{name}'; known parameters: {known}")]
    UnknownParameter {
        /// The name as given.
        name: String,
        /// All names, separated by commas.
        known: String,
    },
    /// A parameter outside its range or of the wrong kind.
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
    /// A NaN or infinity among the actions.
    #[error("the action of environment {index} is {value}; actions must be finite")]
    Action {
        /// Environment number in the batch.
        index: usize,
        /// The value as given.
        value: f64,
    },
    /// A step of an environment whose episode has ended while autoreset is off.
    #[error(
        "environment {index} has ended its episode; reset it (options={{'reset_mask': ...}}) before stepping, since autoreset is disabled"
    )]
    NeedsReset {
        /// Environment number in the batch.
        index: usize,
    },
    /// A step before the first reset.
    #[error("reset() must be called before the first step()")]
    NotReset,
    /// An environment number beyond the batch.
    #[error("environment {index} does not exist: the batch has {num_envs}")]
    Index {
        /// Number as given.
        index: usize,
        /// Size of the batch.
        num_envs: usize,
    },
    /// A snapshot that cannot be read or belongs elsewhere.
    #[error("the snapshot is refused: {reason}")]
    Snapshot {
        /// Why.
        reason: String,
    },
    /// The solver could not take a step, even in the smallest parts.
    #[error("the solver failed at t = {time} s: {reason}")]
    Solver {
        /// Simulated time of the failure \[s\].
        time: f64,
        /// What happened.
        reason: String,
    },
}

/// Most characters of a number that is written out.
const LONGEST: usize = 24;

/// A value as text; a number that would fill a line, such as 1e300, with its power of ten.
pub fn shown(value: impl std::fmt::Display) -> String {
    let text = value.to_string();
    match text.parse::<f64>() {
        Ok(number) if text.len() > LONGEST => format!("{number:e}"),
        _ => text,
    }
}

impl Error {
    /// A parameter error; `value` is shown with its `Display` form, numbers of many digits by [`shown`].
    pub fn parameter(
        name: impl Into<String>,
        value: impl std::fmt::Display,
        allowed: impl Into<String>,
    ) -> Self {
        Error::Parameter { name: name.into(), value: shown(value), allowed: allowed.into() }
    }

    /// A snapshot error.
    pub fn snapshot(reason: impl Into<String>) -> Self {
        Error::Snapshot { reason: reason.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::shown;

    #[test]
    fn numbers_are_written_out_unless_they_would_fill_the_line() {
        assert_eq!(shown(1e300), "1e300");
        assert_eq!(shown(-1e-300), "-1e-300");
        assert_eq!(shown(0.30000000000000004), "0.30000000000000004");
        assert_eq!(shown(u64::MAX), "18446744073709551615");
        assert_eq!(
            shown("a text that is longer than any number of a message"),
            "a text that is longer than any number of a message"
        );
    }
}
