//! Making a batch: how many lanes, which instruction set, and all that users can ask of it.

use super::{Batch, Machine, Task};
use crate::env::{AutoresetMode, Spec, VectorEnv};
use crate::error::{Error, Result};
use crate::isa::{ForLanes, Isa, with_lanes};
use crate::lane::Real;
use serde_json::{Map, Value};

/// Most environments of one batch.
pub const MAX_ENVS: usize = 1 << 20;
/// Most threads of one batch.
pub const MAX_THREADS: usize = 256;

/// How to run a batch: see `catalog::MakeOptions`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields are those of MakeOptions")]
pub struct BatchOptions {
    pub num_envs: usize,
    pub autoreset_mode: AutoresetMode,
    pub max_episode_steps: Option<u32>,
    pub num_threads: usize,
}

/// Makes a batch of a task's environments with the number of lanes that suits its size and the processor.
///
/// # Errors
/// A keyword or an option that is refused.
pub fn make<T: Task>(
    id: &str,
    task: &T,
    given: &Map<String, Value>,
    options: &BatchOptions,
) -> Result<Box<dyn VectorEnv>> {
    check_count("num_envs", options.num_envs, MAX_ENVS)?;
    check_count("num_threads", options.num_threads, MAX_THREADS)?;
    if options.max_episode_steps == Some(0) {
        return Err(Error::parameter("max_episode_steps", 0, "at least 1"));
    }
    let isa = Isa::current()?;
    if options.num_envs == 1 {
        return Ok(Box::new(Batch::<T::Machine, f64>::new(id, task, given, options)?));
    }
    in_lanes(id, task, given, options, isa)
}

/// Makes a batch in eight lanes with the given instruction set; options are taken as checked.
///
/// # Errors
/// A keyword that is refused.
///
/// # Panics
/// When this machine lacks the instruction set.
pub fn in_lanes<T: Task>(
    id: &str,
    task: &T,
    given: &Map<String, Value>,
    options: &BatchOptions,
    isa: Isa,
) -> Result<Box<dyn VectorEnv>> {
    struct Make<'a, T>(&'a str, &'a T, &'a Map<String, Value>, &'a BatchOptions);
    impl<T: Task> ForLanes for Make<'_, T> {
        type Output = Result<Box<dyn VectorEnv>>;
        fn make<R: Real>(self) -> Self::Output {
            let Make(id, task, given, options) = self;
            Ok(Box::new(Batch::<T::Machine, R>::new(id, task, given, options)?))
        }
    }
    with_lanes(isa, Make(id, task, given, options))
}

/// All that users can ask of a task's environments.
pub(super) fn spec<T: Task>(id: &str, machine: &T::Machine) -> Spec {
    let mut observation = machine.observation();
    for &(name, bound) in T::OBSERVATION {
        observation.push(-bound, bound, name);
    }
    Spec {
        id: id.into(),
        machine: T::Machine::NAME,
        task: T::NAME,
        observation,
        action: machine.action(),
        reward_terms: T::TERMS.to_vec(),
        metrics: [T::Machine::METRICS, T::METRICS].concat(),
        parameters: machine.parameter_table().to_vec(),
        keywords: T::Machine::KEYWORDS.to_vec(),
        config: machine.resolved().clone(),
        default_max_episode_steps: T::MAX_EPISODE_STEPS,
        control_dt: machine.control_dt(),
        physics_dt: machine.physics_dt(),
        error: machine.error(),
        warning: machine.warning(),
    }
}

/// A whole number from 1 to `most`.
pub(super) fn check_count(name: &str, value: usize, most: usize) -> Result<()> {
    if (1..=most).contains(&value) {
        return Ok(());
    }
    Err(Error::parameter(name, value, format!("an integer from 1 to {most}")))
}
