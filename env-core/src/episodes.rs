//! When episodes begin, and what with.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// When an environment of a batch starts its next episode (Gymnasium's `AutoresetMode`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum AutoresetMode {
    /// The step after the end ignores the action and returns the reset observation, reward 0.
    #[serde(rename = "NextStep")]
    NextStep,
    /// The ending step itself returns the reset observation; the last one is in `final_obs`.
    #[serde(rename = "SameStep")]
    SameStep,
    /// Nothing starts by itself; stepping an ended environment is an error.
    #[serde(rename = "Disabled")]
    Disabled,
    /// A single environment: nothing starts by itself, stepping goes on after the end.
    #[serde(rename = "Single")]
    Single,
}

/// What a reset may set beside the seed. Empty means: draw as configured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ResetOptions {
    /// Exact parameter values, by name; for a batch, the same for every environment that is reset.
    pub parameters: Map<String, Value>,
    /// Exact start: `{"positions": [[x, y], ...], "velocities": [[x, y], ...]}` or, for the pendulum,
    /// `{"angles": [...], "rates": [...]}`.
    pub state: Option<Value>,
}

/// Where a reset takes its seeds from.
#[derive(Clone, Debug, PartialEq)]
pub enum Seeds {
    /// Continue every random stream.
    Continue,
    /// Environment i gets seed + i.
    Base(u64),
    /// One seed an environment; `None` continues its stream.
    Each(Vec<Option<u64>>),
}
