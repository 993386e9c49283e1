//! What a controller is designed for.

use rodgym_core::env::{Space, Spec};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// What a controller is told of its environment: the part of its spec that a design depends on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// The environment's id.
    pub id: String,
    /// The machine that is moved.
    pub machine: String,
    /// Every keyword with its value.
    pub config: Map<String, Value>,
    /// An observation.
    pub observation: Space,
    /// An action.
    #[serde(default)]
    pub action: Space,
    /// The physical parameters among the keywords.
    #[serde(default)]
    pub parameters: Vec<Named>,
}

/// A parameter's name, of all that a spec says of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// Its keyword.
    pub name: String,
}

impl From<&Spec> for Target {
    fn from(spec: &Spec) -> Self {
        Target {
            id: spec.id.clone(),
            machine: spec.machine.into(),
            config: spec.config.clone(),
            observation: spec.observation.clone(),
            action: spec.action.clone(),
            parameters: spec.parameters.iter().map(|one| Named { name: one.name.into() }).collect(),
        }
    }
}
