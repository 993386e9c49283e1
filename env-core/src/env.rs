//! What every batch of environments offers, whatever machine is inside: the face that the Python
//! bindings and the network server talk to.

use crate::error::Result;
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

/// A physical parameter: name, unit, default and allowed range. Its name is the same word everywhere: keyword,
/// `info["parameters"]`, report column.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Keyword.
    pub name: &'static str,
    /// SI unit, empty where there is none.
    pub unit: &'static str,
    /// Default value.
    pub default: f64,
    /// Smallest allowed value.
    pub low: f64,
    /// Largest allowed value.
    pub high: f64,
    /// What it is, in one sentence.
    pub doc: &'static str,
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
    /// Every keyword with its value as resolved (defaults filled in).
    pub config: Map<String, Value>,
    /// Steps after which an episode is cut, unless asked otherwise.
    pub default_max_episode_steps: u32,
    /// Duration of a step \[s\].
    pub control_dt: f64,
    /// Duration of a physics step \[s\].
    pub physics_dt: f64,
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

/// Row-major results of a step or reset for `n` environments; the caller owns the memory.
///
/// Sizes: d = observation, k = reward terms + metrics, p = parameters.
pub struct StepData<'a> {
    /// (n, d) observations.
    pub observation: &'a mut [f32],
    /// (n) rewards.
    pub reward: &'a mut [f64],
    /// (n) episode ended by the task.
    pub terminated: &'a mut [bool],
    /// (n) episode cut by the time limit or by a solver failure.
    pub truncated: &'a mut [bool],
    /// (n, d) last observations, written only where an episode ended in `SameStep` mode.
    pub final_observation: &'a mut [f32],
    /// (n, k) reward terms, then metrics; written where a step was taken.
    pub terms: &'a mut [f64],
    /// (n, p) parameters of the episode; written where an episode began.
    pub parameters: &'a mut [f64],
    /// (n) set where a step was taken.
    pub stepped: &'a mut [bool],
    /// (n) set where an episode began.
    pub began: &'a mut [bool],
    /// (n) set where the solver gave up.
    pub solver_failure: &'a mut [bool],
}

/// The same results, owning their memory.
#[derive(Clone, Debug, Default)]
#[allow(missing_docs, reason = "fields are those of StepData")]
pub struct StepBuffer {
    pub observation: Vec<f32>,
    pub reward: Vec<f64>,
    pub terminated: Vec<bool>,
    pub truncated: Vec<bool>,
    pub final_observation: Vec<f32>,
    pub terms: Vec<f64>,
    pub parameters: Vec<f64>,
    pub stepped: Vec<bool>,
    pub began: Vec<bool>,
    pub solver_failure: Vec<bool>,
}

impl StepBuffer {
    /// Memory for `n` environments of this kind.
    pub fn new(spec: &Spec, n: usize) -> Self {
        let d = spec.observation.size();
        let k = spec.reward_terms.len() + spec.metrics.len();
        StepBuffer {
            observation: vec![0.0; n * d],
            reward: vec![0.0; n],
            terminated: vec![false; n],
            truncated: vec![false; n],
            final_observation: vec![0.0; n * d],
            terms: vec![0.0; n * k],
            parameters: vec![0.0; n * spec.parameters.len()],
            stepped: vec![false; n],
            began: vec![false; n],
            solver_failure: vec![false; n],
        }
    }

    /// Borrows all of it for a step.
    pub fn data(&mut self) -> StepData<'_> {
        StepData {
            observation: &mut self.observation,
            reward: &mut self.reward,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            final_observation: &mut self.final_observation,
            terms: &mut self.terms,
            parameters: &mut self.parameters,
            stepped: &mut self.stepped,
            began: &mut self.began,
            solver_failure: &mut self.solver_failure,
        }
    }
}

/// What there is to draw of one environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// `pendulum` or `fin`.
    pub machine: String,
    /// Simulated time since the episode began \[s\].
    pub time: f64,
    /// Steps since the episode began.
    pub steps: u32,
    /// Node positions \[m\].
    pub nodes: Vec<[f64; 2]>,
    /// Thickness at the nodes \[m\].
    pub thickness: Vec<f64>,
    /// Signed curvature kappa at the nodes (0 at both ends, integrated: no unit).
    pub curvature: Vec<f64>,
    /// The last action, after clipping.
    pub action: Vec<f64>,
    /// Reward of the last step.
    pub reward: f64,
    /// Sum of rewards since the episode began.
    pub episode_return: f64,
    /// Named numbers that the picture may use: `torque` \[N m\], `torque_limit`, `length`, `thrust` \[N\],
    /// `pitch`, `flow_speed`, `hull_position`, ...
    pub values: Map<String, Value>,
    /// Named vectors that start at nodes, such as `fluid_force` \[N\]; one (x, y) a node.
    pub arrows: Map<String, Value>,
}

/// Positions \[m\] and velocities \[m/s\] of the nodes of one rod, (x, y) a node.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NodeState {
    /// Positions \[m\].
    pub positions: Vec<[f64; 2]>,
    /// Velocities \[m/s\].
    pub velocities: Vec<[f64; 2]>,
}

/// Many environments stepped together. Object safe: made by `catalog::make`.
pub trait VectorEnv: Send {
    /// What kind of environment this is.
    fn spec(&self) -> &Spec;
    /// How many there are.
    fn num_envs(&self) -> usize;
    /// When episodes restart.
    fn autoreset_mode(&self) -> AutoresetMode;
    /// Steps after which an episode is cut; `None`: never.
    fn max_episode_steps(&self) -> Option<u32>;
    /// Number of threads that a step uses.
    fn num_threads(&self) -> usize;
    /// Changes the number of threads; results do not depend on it.
    fn set_num_threads(&mut self, threads: usize) -> Result<()>;

    /// Starts episodes, in all environments or where `mask` is set; elsewhere the observation is
    /// that of the last step or reset.
    ///
    /// # Errors
    /// Wrong length of mask or seeds, parameters or states that are not allowed; nothing changes then.
    fn reset(
        &mut self,
        seeds: &Seeds,
        mask: Option<&[bool]>,
        options: &ResetOptions,
        out: StepData<'_>,
    ) -> Result<()>;

    /// One control step of every environment. `actions` is row-major (n, a), clipped to the space.
    ///
    /// # Errors
    /// Wrong length, an action that is not finite, a needed reset; nothing changes then.
    fn step(&mut self, actions: &[f32], out: StepData<'_>) -> Result<()>;

    /// Everything about environment `index`: physics, random stream, clock, as versioned bytes.
    fn get_state(&self, index: usize) -> Result<Vec<u8>>;
    /// Puts a snapshot of the same kind of environment in place of environment `index`; its
    /// observation is returned by the next step (or by `observe`).
    fn set_state(&mut self, index: usize, bytes: &[u8]) -> Result<()>;
    /// The last observation of environment `index`, as its step or reset returned it.
    fn observe(&self, index: usize, out: &mut [f32]) -> Result<()>;
    /// What there is to draw of environment `index`.
    fn scene(&self, index: usize) -> Result<Scene>;
    /// Physical parameters in force in environment `index`, in the order of the spec.
    fn parameters(&self, index: usize) -> Result<Vec<f64>>;
    /// Positions and velocities of the nodes of environment `index`, (x, y) a node \[m, m/s\].
    fn nodes(&self, index: usize) -> Result<NodeState>;
}
