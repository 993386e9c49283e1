//! What a batch does for whoever holds it as a `VectorEnv`.

use super::block::ResetRows;
use super::make::{MAX_THREADS, check_count};
use super::{Batch, Machine, Rehearsal};
use crate::draw::Draw;
use crate::env::{
    AutoresetMode, LongStep, NodeState, ResetOptions, Saved, Scene, Seeds, Settings, Spec,
    StepData, VectorEnv,
};
use crate::error::{Error, Result};
use crate::lane::Real;
use crate::results::{Rows, Widths, check_length};
use crate::simulation::{Named, Simulation};
use crate::snapshot::Snapshot;
use crate::watch::Watch;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Work of a step that may be long, for all that is known before the first: some 2 ms in eight lanes, 100 ms in one.
const GUESSED: f64 = 4e6;
/// A step that takes longer is one that somebody may want to stop.
const LONG: Duration = Duration::from_millis(50);

impl<M: Machine, R: Real> VectorEnv for Batch<M, R> {
    fn spec(&self) -> &Spec {
        &self.env.spec
    }

    fn num_envs(&self) -> usize {
        self.num_envs
    }

    fn autoreset_mode(&self) -> AutoresetMode {
        self.env.rules.mode
    }

    fn max_episode_steps(&self) -> Option<u32> {
        self.env.rules.max_episode_steps
    }

    fn num_threads(&self) -> usize {
        self.threads
    }

    fn set_num_threads(&mut self, threads: usize) -> Result<()> {
        check_count("num_threads", threads, MAX_THREADS)?;
        self.threads = threads;
        Ok(())
    }

    fn reset(
        &mut self,
        seeds: &Seeds,
        mask: Option<&[bool]>,
        options: &ResetOptions,
        mut out: StepData<'_>,
    ) -> Result<()> {
        let widths = Widths::of(&self.env.spec);
        out.check(widths, self.num_envs)?;
        if let Some(mask) = mask {
            check_length("reset_mask", mask.len(), self.num_envs)?;
        }
        if let Seeds::Each(each) = seeds {
            check_length("seed", each.len(), self.num_envs)?;
        }
        let start = self.check_options(options, mask)?;
        let seed = |index: usize| match seeds {
            Seeds::Continue => None,
            Seeds::Base(base) => Some(base.wrapping_add(index as u64)),
            Seeds::Each(each) => each[index],
        };
        let rows = Rows::new(widths, &mut out);
        for (b, block) in self.blocks.iter_mut().enumerate() {
            let first = b * R::LANES;
            // SAFETY: `out` is borrowed for as long as `rows` is used, one block at a time.
            let mut mine = unsafe { rows.of(first, block.used()) };
            let place = ResetRows { first, mask };
            block.reset(&self.env, &place, seed, &start, &mut mine);
        }
        Ok(())
    }

    fn step(&mut self, actions: &[f32], out: StepData<'_>) -> Result<()> {
        self.step_watched(actions, out, Watch::nobody())
    }

    fn configure(&mut self, range: Range<usize>, settings: &Settings) -> Result<()> {
        if range.is_empty() || range.end > self.num_envs {
            let index = range.end.saturating_sub(1).max(range.start);
            return Err(Error::Index { index, num_envs: self.num_envs });
        }
        let machine = &self.env.machine;
        let changes = settings.read(machine.parameter_table(), range.len())?;
        let mut changed: Vec<Option<Arc<[Draw]>>> = Vec::with_capacity(range.len());
        for (k, index) in range.clone().enumerate() {
            let mut draws = self.draws_of(index).to_vec();
            changes.make(k, &mut draws);
            Draw::check_together(&draws, machine.parameter_table())?;
            // Neighbours are often alike.
            changed.push(match changed.last() {
                Some(Some(last)) if **last == *draws => Some(last.clone()),
                _ if draws == machine.draws() => None,
                _ => {
                    machine.check_draws(&draws)?;
                    Some(draws.into())
                }
            });
        }
        for (index, draws) in range.zip(changed) {
            self.blocks[index / R::LANES].set_draws(index % R::LANES, draws);
        }
        Ok(())
    }

    fn long_step(&mut self) -> Option<&mut dyn LongStep> {
        let long = self.took.map_or(self.work > GUESSED, |took| took > LONG);
        if long { Some(self) } else { None }
    }

    fn get_state(&self, index: usize) -> Result<Vec<u8>> {
        let (block, lane) = self.place(index)?;
        Ok(self.blocks[block].snapshot(lane).encode(self.spec()))
    }

    fn set_state(&mut self, index: usize, bytes: &[u8]) -> Result<()> {
        let (block, lane) = self.place(index)?;
        let saved = Snapshot::decode(bytes, self.spec())?;
        self.blocks[block].restore(&self.env, lane, &saved)
    }

    fn observe(&self, index: usize, out: &mut [f32]) -> Result<()> {
        let (block, lane) = self.place(index)?;
        check_length("observation", out.len(), self.spec().observation.size())?;
        out.copy_from_slice(self.blocks[block].returned(lane));
        Ok(())
    }

    fn scene(&self, index: usize) -> Result<Scene> {
        let (block, lane) = self.place(index)?;
        Ok(self.blocks[block].scene(&self.env, lane))
    }

    fn parameters(&self, index: usize) -> Result<Vec<f64>> {
        let (block, lane) = self.place(index)?;
        let mut values = vec![0.0; self.spec().parameters.len()];
        self.env.machine.parameters(self.blocks[block].plant(), lane, &mut values);
        Ok(values)
    }

    fn nodes(&self, index: usize) -> Result<NodeState> {
        let (block, lane) = self.place(index)?;
        Ok(self.env.machine.nodes(self.blocks[block].plant(), lane))
    }

    fn step_jacobian(
        &self,
        index: usize,
        action: &[f32],
        parameters: &[String],
    ) -> Result<Vec<Named>> {
        let (block, lane) = self.place(index)?;
        check_length("action", action.len(), self.env.spec.action.size())?;
        let chosen = self.check_derivative(index, action, parameters)?;
        self.blocks[block].jacobian(&self.env, lane, action, &chosen)
    }

    fn rollout_gradient(
        &self,
        index: usize,
        actions: &[f32],
        parameters: &[String],
    ) -> Result<Vec<Named>> {
        let (block, lane) = self.place(index)?;
        let size = self.env.spec.action.size();
        check_length("actions", actions.len(), actions.len().div_ceil(size) * size)?;
        let chosen = self.check_derivative(index, actions, parameters)?;
        self.blocks[block].rollout_gradient(&self.env, lane, actions, &chosen)
    }

    fn step_jacobians(&mut self, actions: &[f32], parameters: &[String]) -> Result<Vec<Named>> {
        check_length("actions", actions.len(), self.num_envs * self.env.spec.action.size())?;
        self.over_threads(actions, |batch, index, row| batch.step_jacobian(index, row, parameters))
    }

    fn rollout_gradients(&mut self, actions: &[f32], parameters: &[String]) -> Result<Vec<Named>> {
        let row = self.num_envs * self.env.spec.action.size();
        check_length("actions", actions.len(), actions.len().div_ceil(row) * row)?;
        self.over_threads(actions, |batch, index, row| {
            batch.rollout_gradient(index, row, parameters)
        })
    }

    fn rehearsal(&self, index: usize) -> Result<Box<dyn Rehearsal>> {
        let (block, lane) = self.place(index)?;
        self.blocks[block].rehearsal(&self.env, lane)
    }

    fn simulation(&self, index: usize) -> Result<Box<dyn Simulation>> {
        let (block, lane) = self.place(index)?;
        Ok(self.env.machine.simulation(self.blocks[block].plant(), lane))
    }
}

impl<M: Machine, R: Real> LongStep for Batch<M, R> {
    fn save(&self) -> Saved {
        Box::new(self.blocks.clone())
    }

    fn restore(&mut self, saved: Saved) {
        self.blocks = *saved.downcast().expect("it was saved by this batch");
    }

    fn step_unless(&mut self, actions: &[f32], out: StepData<'_>, stop: &AtomicBool) -> Result<()> {
        self.step_watched(actions, out, Watch::new(stop))
    }
}
