//! The catalogue: one row for every environment id, and the one function that makes a batch of them.
//!
//! Everybody asks the row what an id stands for; nobody reads it out of the id. Another crate adds its own
//! machines and tasks with `register`.

use crate::batch::{self, BatchOptions, Machine, Task};
use crate::env::{AutoresetMode, VectorEnv};
use crate::error::{Error, Result};
use crate::fin::tasks::{Efficiency, Swim, Thrust};
use crate::pendulum::Sensors;
use crate::pendulum::tasks::{Balance, SwingUp};
use crate::simulation::Simulation;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::sync::{Arc, PoisonError, RwLock};

/// Our own rows: a task is one line.
fn ours() -> Vec<Entry> {
    vec![
        Entry::new("rodgym/PendulumSwingUp-v0", SwingUp { sensors: Sensors::Full }),
        Entry::new("rodgym/PendulumBalance-v0", Balance),
        Entry::new("rodgym/PendulumSwingUpBase-v0", SwingUp { sensors: Sensors::Base }),
        Entry::new("rodgym/FinThrust-v0", Thrust),
        Entry::new("rodgym/FinEfficiency-v0", Efficiency),
        Entry::new("rodgym/FinSwim-v0", Swim),
    ]
}

/// What an id stands for.
#[derive(Clone, Serialize)]
pub struct Entry {
    /// Id, such as `rodgym/PendulumSwingUp-v0`.
    pub id: &'static str,
    /// The machine that is moved: `pendulum`, `fin`, ...
    pub machine: &'static str,
    /// What is asked of it: `swing_up`, `thrust`, ...
    pub task: &'static str,
    /// Steps after which an episode is cut, unless asked otherwise.
    pub max_episode_steps: u32,
    /// Return at which the task counts as solved; `None` where no single number says so.
    pub reward_threshold: Option<f64>,
    #[serde(skip)]
    build: Arc<Build>,
    #[serde(skip)]
    bare: Bare,
}

/// Makes a bare machine from its keywords.
type Bare = fn(&Map<String, Value>) -> Result<Box<dyn Simulation>>;

/// Makes a batch of a row's environments from the user's keywords.
type Build = dyn Fn(&Map<String, Value>, &BatchOptions) -> Result<Box<dyn VectorEnv>> + Send + Sync;

impl Entry {
    /// The row of a task under an id.
    pub fn new<T: Task>(id: &'static str, task: T) -> Self {
        Entry {
            id,
            machine: T::Machine::NAME,
            task: T::NAME,
            max_episode_steps: T::MAX_EPISODE_STEPS,
            reward_threshold: T::REWARD_THRESHOLD,
            build: Arc::new(move |given, options| batch::make(id, &task, given, options)),
            bare: T::Machine::bare,
        }
    }
}

/// Rows that other crates added.
static ADDED: RwLock<Vec<Entry>> = RwLock::new(Vec::new());

/// Every row, ours first.
pub fn entries() -> Vec<Entry> {
    let added = ADDED.read().unwrap_or_else(PoisonError::into_inner);
    ours().into_iter().chain(added.iter().cloned()).collect()
}

/// The row of an id.
///
/// # Errors
/// An id that no row has.
pub fn entry(id: &str) -> Result<Entry> {
    let all = entries();
    all.iter().find(|entry| entry.id == id).cloned().ok_or_else(|| {
        let known: Vec<&str> = all.iter().map(|entry| entry.id).collect();
        Error::UnknownEnv { id: id.into(), known: known.join(", ") }
    })
}

/// Adds a row, so that `make`, the server and the bindings know its id.
///
/// # Errors
/// An id that is there already.
pub fn register(entry: Entry) -> Result<()> {
    if entries().iter().any(|known| known.id == entry.id) {
        return Err(Error::parameter("id", entry.id, "an id that is not in the catalogue yet"));
    }
    ADDED.write().unwrap_or_else(PoisonError::into_inner).push(entry);
    Ok(())
}

/// What to make: id, keywords and how the batch runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MakeOptions {
    /// Id, such as `rodgym/PendulumSwingUp-v0`.
    pub id: String,
    /// Number of environments, 1 or more.
    pub num_envs: usize,
    /// Keywords of the environment, see its documentation page.
    #[serde(default)]
    pub kwargs: Map<String, Value>,
    /// When episodes restart.
    pub autoreset_mode: AutoresetMode,
    /// Steps after which an episode is cut; `None`: never.
    pub max_episode_steps: Option<u32>,
    /// Threads of a step; 1 computes in the calling thread.
    pub num_threads: usize,
}

/// Makes a batch of environments.
///
/// # Errors
/// Unknown id or keyword, a value outside its range, no environments or no threads.
pub fn make(options: &MakeOptions) -> Result<Box<dyn VectorEnv>> {
    let entry = entry(&options.id)?;
    let batch_options = BatchOptions {
        num_envs: options.num_envs,
        autoreset_mode: options.autoreset_mode,
        max_episode_steps: options.max_episode_steps,
        num_threads: options.num_threads,
    };
    (entry.build)(&options.kwargs, &batch_options)
}

/// Makes a bare machine by the word that it is looked up by.
///
/// # Errors
/// A machine that no row has, an unknown keyword, a value outside its range.
pub fn simulation(machine: &str, given: &Map<String, Value>) -> Result<Box<dyn Simulation>> {
    let all = entries();
    let Some(entry) = all.iter().find(|entry| entry.machine == machine) else {
        let mut known: Vec<&str> = all.iter().map(|entry| entry.machine).collect();
        known.dedup();
        return Err(Error::parameter("machine", machine, format!("one of {}", known.join(", "))));
    };
    (entry.bare)(given)
}
