//! How large a batch will be and how long its steps will take, before it is made.

use crate::error::{Code, Refusal};
use crate::limits::Limits;
use crate::shared::Factory;
use rodgym_core::catalog::MakeOptions;
use rodgym_core::env::{ResetOptions, Seeds, Spec, StepBuffer};
use std::time::Duration;

/// Bytes of a session beside its environments.
const SESSION: usize = 64 << 10;
/// Bytes of an environment beside its nodes. `tests/memory.rs` measures that these suffice.
const ENV: usize = 2 << 10;
/// Bytes of a node.
const NODE: usize = 1536;
/// Longest time of one node in one physics step, of any machine and stepper.
const NODE_STEP: Duration = Duration::from_nanos(400);

/// What one environment of a batch is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    envs: usize,
    nodes: usize,
    /// Physics steps of a control step.
    substeps: u64,
    /// Bytes of a row of a step's largest reply.
    row: usize,
}

impl Size {
    /// Measures a batch of one environment. `limited`: the environment's own time limit is meant.
    ///
    /// # Errors
    /// What the environment refuses.
    pub fn of(
        factory: &Factory,
        options: &mut MakeOptions,
        limited: bool,
    ) -> Result<Size, Refusal> {
        let mut one = factory(&MakeOptions { num_envs: 1, num_threads: 1, ..options.clone() })?;
        if limited {
            options.max_episode_steps = Some(one.spec().default_max_episode_steps);
        }
        let mut buffer = StepBuffer::new(one.spec(), 1);
        one.reset(&Seeds::Base(0), None, &ResetOptions::default(), buffer.data())?;
        let nodes = one.nodes(0)?.positions.len().max(1);
        let spec = one.spec();
        let substeps = (spec.control_dt / spec.physics_dt).ceil().max(1.0) as u64;
        Ok(Size { envs: options.num_envs, nodes, substeps, row: row(spec) })
    }

    /// Whether a server grants it.
    ///
    /// # Errors
    /// `limit`, with the number.
    pub fn check(&self, options: &MakeOptions, limits: &Limits) -> Result<(), Refusal> {
        let (bytes, most) = (self.row.saturating_mul(self.envs), limits.message_bytes);
        if bytes > most {
            let text = format!("a step of this batch could need {bytes} bytes; {most} are allowed");
            return Err(Refusal::new(Code::Limit, text));
        }
        let (work, most) = (self.node_steps(), limits.node_steps);
        if work > most {
            let text = format!(
                "a control step of this batch is {work} node steps ({} environments x {} nodes x {} \
                 physics steps); {most} are allowed",
                options.num_envs, self.nodes, self.substeps
            );
            return Err(Refusal::new(Code::Limit, text));
        }
        Ok(())
    }

    /// Most bytes that a session of it takes, with the replies that it remembers.
    pub fn memory(&self, window: usize) -> usize {
        let env = ENV.saturating_add(NODE.saturating_mul(self.nodes));
        // The buffer of a step is as large as a reply, and one more is being written.
        let replies = self.row.saturating_mul(window.saturating_add(2));
        let one = env.saturating_add(replies);
        one.saturating_mul(self.envs).saturating_add(SESSION)
    }

    /// Work of a control step.
    pub fn node_steps(&self) -> u64 {
        (self.envs as u64).saturating_mul(self.nodes as u64).saturating_mul(self.substeps)
    }

    /// How long a step may take at most, before one has been timed.
    pub fn guess(&self) -> Duration {
        let nanos = self.node_steps().saturating_mul(NODE_STEP.as_nanos() as u64);
        Duration::from_nanos(nanos)
    }
}

/// Bytes of a row of the largest reply of a step.
fn row(spec: &Spec) -> usize {
    let terms = spec.reward_terms.len() + spec.metrics.len();
    8 * spec.observation.size() + 8 * (1 + terms + spec.parameters.len()) + 1
}
