//! What every batch of environments offers, whatever machine is inside: the face that the Python
//! bindings and the network server talk to.

pub use crate::episodes::{AutoresetMode, ResetOptions, Seeds};
pub use crate::keywords::Parameter;
pub use crate::results::{StepBuffer, StepData};
pub use crate::scene::{NodeState, Scene};
pub use crate::settings::Settings;
pub use crate::spec::{Space, Spec};

use crate::batch::Rehearsal;
use crate::error::Result;
use crate::simulation::{Named, Simulation, no_derivatives};
use std::any::Any;
use std::ops::Range;
use std::sync::atomic::AtomicBool;

/// What `LongStep::save` gives.
pub type Saved = Box<dyn Any + Send>;

/// A batch whose step can be stopped, and is then as if it had never been made.
pub trait LongStep: Send {
    /// All that a step changes.
    fn save(&self) -> Saved;
    /// Puts back what `save` gave.
    fn restore(&mut self, saved: Saved);
    /// The same as `VectorEnv::step`. Once `stop` is set it ends soon, and what it has done means nothing: `restore`
    /// what was saved before.
    ///
    /// # Errors
    /// Those of `VectorEnv::step`.
    fn step_unless(&mut self, actions: &[f32], out: StepData<'_>, stop: &AtomicBool) -> Result<()>;
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

    /// Changes how the parameters of environments `range` are drawn, from the next episode of each; until then nothing
    /// changes. Snapshots keep it.
    ///
    /// # Errors
    /// Environments beyond the batch, names, values or ranges that are not allowed; nothing changes then.
    fn configure(&mut self, range: Range<usize>, settings: &Settings) -> Result<()>;

    /// How to take the next step where it may take so long that somebody could want to stop it; `None`: by `step`.
    fn long_step(&mut self) -> Option<&mut dyn LongStep> {
        None
    }

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
    /// Derivatives of the control step that environment `index` would take next under `action`, autoreset left out; the
    /// environment stays where it is. Of the plant's whole state as one vector (s): `A` (s, s) by that vector, `B`
    /// (s, a) by the action, `P` (s, p) by the parameters of these names; of the observation `C`, `D`, `Q`; of the
    /// reward `reward_state` (s), `reward_action` (a), `reward_parameters` (p).
    ///
    /// # Errors
    /// An action that is not finite or of the wrong length, an unknown name, an environment that was never reset, a step
    /// in which the solver gives up, a machine without derivatives.
    fn step_jacobian(
        &self,
        _index: usize,
        _action: &[f32],
        _parameters: &[String],
    ) -> Result<Vec<Named>> {
        Err(no_derivatives(self.spec().machine))
    }
    /// Gradients of the sum of rewards that environment `index` would get for `actions` (t, a), from where it is to the
    /// last of them or to the end of the episode by the task: by `actions` (t, a), by the plant's `state` (s) and by
    /// `parameters` (p); and the `rewards` (t) themselves, 0 after the end. The environment stays where it is.
    ///
    /// # Errors
    /// Those of `step_jacobian`.
    fn rollout_gradient(
        &self,
        _index: usize,
        _actions: &[f32],
        _parameters: &[String],
    ) -> Result<Vec<Named>> {
        Err(no_derivatives(self.spec().machine))
    }
    /// `step_jacobian` of every environment under its own row of `actions` (n, a): the same arrays with a first axis of n.
    /// To the same bits, whatever the threads.
    ///
    /// # Errors
    /// Those of `step_jacobian`, of the first environment that has one.
    fn step_jacobians(&mut self, actions: &[f32], parameters: &[String]) -> Result<Vec<Named>> {
        let rows = rows(actions, self.num_envs());
        let each = rows.map(|(i, row)| self.step_jacobian(i, row, parameters));
        Ok(Named::stack(each.collect::<Result<_>>()?))
    }
    /// `rollout_gradient` of every environment for its own `actions` (n, t, a): the same arrays with a first axis of n.
    /// To the same bits, whatever the threads.
    ///
    /// # Errors
    /// Those of `rollout_gradient`, of the first environment that has one.
    fn rollout_gradients(&mut self, actions: &[f32], parameters: &[String]) -> Result<Vec<Named>> {
        let rows = rows(actions, self.num_envs());
        let each = rows.map(|(i, row)| self.rollout_gradient(i, row, parameters));
        Ok(Named::stack(each.collect::<Result<_>>()?))
    }
    /// A copy of environment `index` to try actions on, which leaves the environment alone.
    ///
    /// # Errors
    /// An environment that was never reset, a machine without derivatives.
    fn rehearsal(&self, _index: usize) -> Result<Box<dyn Rehearsal>> {
        Err(no_derivatives(self.spec().machine))
    }
    /// An exact copy of what runs in environment `index`: stepping it leaves the environment alone, and the next
    /// step of both has the same bits.
    fn simulation(&self, index: usize) -> Result<Box<dyn Simulation>>;
}

/// As many rows as there are environments, with their numbers.
pub(crate) fn rows(actions: &[f32], num_envs: usize) -> impl Iterator<Item = (usize, &[f32])> {
    let size = actions.len() / num_envs;
    (0..num_envs).map(move |i| (i, &actions[i * size..(i + 1) * size]))
}
