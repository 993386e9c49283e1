//! The catalogue: one row for every environment id, and the one function that makes a batch of them.
//!
//! Everybody asks the row what an id stands for; nobody reads it out of the id. Another crate adds its own
//! machines and tasks with `register`.

use crate::batch::{self, BatchOptions};
use crate::env::{AutoresetMode, VectorEnv};
use crate::error::{Error, Result};
use crate::fin::{self, FinTask};
use crate::pendulum::{Pendulum, Sensors, Task};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::sync::{PoisonError, RwLock};

/// What an id stands for.
#[derive(Clone, Copy, Debug, Serialize)]
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
    /// Makes a batch from the keywords.
    #[serde(skip)]
    pub build: Build,
}

/// Makes a batch of a row's environments from checked options and the user's keywords.
pub type Build = fn(&Entry, &Map<String, Value>, &BatchOptions) -> Result<Box<dyn VectorEnv>>;

/// Our own rows.
const OURS: &[Entry] = &[
    Entry {
        id: "rodgym/PendulumSwingUp-v0",
        machine: "pendulum",
        task: "swing_up",
        max_episode_steps: 500,
        reward_threshold: Some(400.0),
        build: |entry, given, options| {
            pendulum(entry, Task::SwingUp, Sensors::Full, given, options)
        },
    },
    Entry {
        id: "rodgym/PendulumBalance-v0",
        machine: "pendulum",
        task: "balance",
        max_episode_steps: 1000,
        reward_threshold: Some(950.0),
        build: |entry, given, options| {
            pendulum(entry, Task::Balance, Sensors::Full, given, options)
        },
    },
    Entry {
        id: "rodgym/PendulumSwingUpBase-v0",
        machine: "pendulum",
        task: "swing_up",
        max_episode_steps: 500,
        reward_threshold: Some(400.0),
        build: |entry, given, options| {
            pendulum(entry, Task::SwingUp, Sensors::Base, given, options)
        },
    },
    Entry {
        id: "rodgym/FinThrust-v0",
        machine: "fin",
        task: "thrust",
        max_episode_steps: 200,
        reward_threshold: None,
        build: |entry, given, options| fin(entry, fin::Task::Thrust, given, options),
    },
    Entry {
        id: "rodgym/FinEfficiency-v0",
        machine: "fin",
        task: "efficiency",
        max_episode_steps: 200,
        reward_threshold: None,
        build: |entry, given, options| fin(entry, fin::Task::Efficiency, given, options),
    },
    Entry {
        id: "rodgym/FinSwim-v0",
        machine: "fin",
        task: "swim",
        max_episode_steps: 250,
        reward_threshold: None,
        build: |entry, given, options| fin(entry, fin::Task::Swim, given, options),
    },
];

fn pendulum(
    entry: &Entry,
    task: Task,
    sensors: Sensors,
    given: &Map<String, Value>,
    options: &BatchOptions,
) -> Result<Box<dyn VectorEnv>> {
    batch::make(Pendulum::new(entry, task, sensors, given)?, options)
}

fn fin(
    entry: &Entry,
    task: fin::Task,
    given: &Map<String, Value>,
    options: &BatchOptions,
) -> Result<Box<dyn VectorEnv>> {
    batch::make(FinTask::new(entry, task, given)?, options)
}

/// Rows that other crates added.
static ADDED: RwLock<Vec<Entry>> = RwLock::new(Vec::new());

/// Every row, ours first.
pub fn entries() -> Vec<Entry> {
    let added = ADDED.read().unwrap_or_else(PoisonError::into_inner);
    OURS.iter().chain(added.iter()).copied().collect()
}

/// The row of an id.
///
/// # Errors
/// An id that no row has.
pub fn entry(id: &str) -> Result<Entry> {
    let all = entries();
    all.iter().find(|entry| entry.id == id).copied().ok_or_else(|| {
        let known: Vec<&str> = all.iter().map(|entry| entry.id).collect();
        Error::UnknownEnv { id: id.into(), known: known.join(", ") }
    })
}

/// Adds a row, so that `make`, the server and the bindings know its id.
///
/// # Errors
/// An id that is there already.
pub fn register(entry: Entry) -> Result<()> {
    let mut added = ADDED.write().unwrap_or_else(PoisonError::into_inner);
    if OURS.iter().chain(added.iter()).any(|known| known.id == entry.id) {
        return Err(Error::parameter("id", entry.id, "an id that is not in the catalogue yet"));
    }
    added.push(entry);
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
    (entry.build)(&entry, &options.kwargs, &batch_options)
}
