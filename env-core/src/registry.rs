//! All environments by id, and the one function that makes a batch of them.

use crate::batch::{self, BatchOptions};
use crate::env::{AutoresetMode, VectorEnv};
use crate::error::{Error, Result};
use crate::fin::{self, FinTask};
use crate::pendulum::{Pendulum, Sensors, Task};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Ids that `make` knows.
pub const IDS: &[&str] = &[
    "rodgym/PendulumSwingUp-v0",
    "rodgym/PendulumBalance-v0",
    "rodgym/PendulumSwingUpBase-v0",
    "rodgym/FinThrust-v0",
    "rodgym/FinEfficiency-v0",
    "rodgym/FinSwim-v0",
];

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
    let batch_options = BatchOptions {
        num_envs: options.num_envs,
        autoreset_mode: options.autoreset_mode,
        max_episode_steps: options.max_episode_steps,
        num_threads: options.num_threads,
    };
    let pendulum = |task, sensors| {
        let machine = Pendulum::new(&options.id, task, sensors, &options.kwargs)?;
        batch::make(machine, &batch_options)
    };
    let fin = |task| batch::make(FinTask::new(&options.id, task, &options.kwargs)?, &batch_options);
    match options.id.as_str() {
        "rodgym/PendulumSwingUp-v0" => pendulum(Task::SwingUp, Sensors::Full),
        "rodgym/PendulumBalance-v0" => pendulum(Task::Balance, Sensors::Full),
        "rodgym/PendulumSwingUpBase-v0" => pendulum(Task::SwingUp, Sensors::Base),
        "rodgym/FinThrust-v0" => fin(fin::Task::Thrust),
        "rodgym/FinEfficiency-v0" => fin(fin::Task::Efficiency),
        "rodgym/FinSwim-v0" => fin(fin::Task::Swim),
        _ => Err(Error::UnknownEnv { id: options.id.clone(), known: IDS.join(", ") }),
    }
}
