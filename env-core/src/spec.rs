//! What users can ask about an environment before stepping it.

use crate::keywords::{Keyword, Parameter};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Bounds and meaning of an observation or action vector.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Space {
    /// Lower bound of each component.
    pub low: Vec<f64>,
    /// Upper bound of each component.
    pub high: Vec<f64>,
    /// What each component is, with its unit, for documentation.
    pub names: Vec<String>,
}

impl Space {
    /// An empty space, to be filled with `push`.
    pub fn new() -> Self {
        Space { low: vec![], high: vec![], names: vec![] }
    }
    /// Adds a component.
    pub fn push(&mut self, low: f64, high: f64, name: impl Into<String>) {
        self.low.push(low);
        self.high.push(high);
        self.names.push(name.into());
    }
    /// Number of components.
    pub fn size(&self) -> usize {
        self.low.len()
    }
}

impl Default for Space {
    fn default() -> Self {
        Space::new()
    }
}

/// All that a user can ask about an environment before stepping it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spec {
    /// Id, such as `rodgym/PendulumSwingUp-v0`.
    pub id: String,
    /// The machine that is moved: the word that everything about it is looked up by.
    pub machine: &'static str,
    /// What is asked of it.
    pub task: &'static str,
    /// Observation of one environment (float32).
    pub observation: Space,
    /// Action of one environment (float32).
    pub action: Space,
    /// Names of the reward's terms; they add up to the reward.
    pub reward_terms: Vec<&'static str>,
    /// Names of further numbers reported at every step.
    pub metrics: Vec<&'static str>,
    /// Physical parameters of an episode, in the order of `StepData::parameters`.
    pub parameters: Vec<Parameter>,
    /// The other keywords, with what is allowed.
    pub keywords: Vec<Keyword>,
    /// Every keyword with its value as resolved (defaults filled in).
    pub config: Map<String, Value>,
    /// Steps after which an episode is cut, unless asked otherwise.
    pub default_max_episode_steps: u32,
    /// Duration of a step \[s\].
    pub control_dt: f64,
    /// Duration of a physics step \[s\].
    pub physics_dt: f64,
}
