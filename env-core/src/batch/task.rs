//! What is asked of a machine.

use super::machine::Machine;
use crate::lane::{Kernel, Mask, Real};
use crate::scene::Scene;

/// A task: what is paid, when the task itself ends an episode, what more is shown and reported.
///
/// Methods marked *hot* run inside a vector kernel: implement them `#[inline(always)]`.
pub trait Task: Clone + Send + Sync + 'static {
    /// The machine that it is asked of.
    type Machine: Machine;
    /// The word that it is looked up by.
    const NAME: &'static str;
    /// Steps after which an episode is cut, unless asked otherwise.
    const MAX_EPISODE_STEPS: u32;
    /// Return at which it counts as solved; `None` where no single number says so.
    const REWARD_THRESHOLD: Option<f64> = None;
    /// Names of the reward's terms; they add up to the reward.
    const TERMS: &'static [&'static str];
    /// Names of the numbers that it reports after the machine's own.
    const METRICS: &'static [&'static str] = &[];

    /// Names of the numbers that it shows after the machine's sensors, and their bound.
    const OBSERVATION: &'static [(&'static str, f64)] = &[];

    /// What it asks of the machine.
    fn setup(&self) -> <Self::Machine as Machine>::Setup;
    /// *Hot.* Writes the terms of the reward of the step just taken; returns where the episode ends.
    fn score<R: Real>(
        &self,
        machine: &Self::Machine,
        plant: &<Self::Machine as Machine>::Plant<R>,
        terms: &mut [R],
    ) -> R::Mask;
    /// Adds numbers of which half the squares' sum is what the step just taken has lost of the most that it could be
    /// paid, exactly or nearly: their slopes give the reward a curvature that is never of the wrong sign (Gauss and
    /// Newton). None where a reward has no such shape.
    fn residuals<R: Real>(
        &self,
        _machine: &Self::Machine,
        _plant: &<Self::Machine as Machine>::Plant<R>,
        _out: &mut Vec<R>,
    ) {
    }
    /// *Hot.* Writes its metrics.
    fn metrics<R: Real>(
        &self,
        _machine: &Self::Machine,
        _plant: &<Self::Machine as Machine>::Plant<R>,
        _metrics: &mut [R],
    ) {
    }
    /// *Hot.* Writes the numbers of `OBSERVATION`.
    fn observe<R: Real>(
        &self,
        _plant: &<Self::Machine as Machine>::Plant<R>,
        _observation: &mut [R],
    ) {
    }
    /// Adds what it gives to draw.
    fn scene<R: Real>(
        &self,
        _plant: &<Self::Machine as Machine>::Plant<R>,
        _lane: usize,
        _scene: &mut Scene,
    ) {
    }
}

/// What a step says beside the observation.
#[derive(Clone, Debug)]
pub struct Outcome<R: Real> {
    /// Reward.
    pub reward: R,
    /// Where the task ended the episode.
    pub terminated: R::Mask,
    /// Where the solver gave up.
    pub failed: R::Mask,
    /// Reward terms, then the machine's metrics, then the task's.
    pub terms: Vec<R>,
}

impl<R: Real> Outcome<R> {
    /// Memory for the given number of terms and metrics.
    pub fn new(terms: usize) -> Self {
        Outcome {
            reward: R::zero(),
            terminated: R::Mask::splat(false),
            failed: R::Mask::splat(false),
            terms: vec![R::zero(); terms],
        }
    }
}

/// A task as a batch of machine `M` in numbers `R` calls it. The long kernels of a machine are compiled once for
/// all of its tasks; only what a task itself does is compiled for each.
pub trait Scorer<M: Machine, R: Real>: Send + Sync {
    /// Reward, end and metrics of the step just taken.
    fn score(&self, machine: &M, plant: &M::Plant<R>, out: &mut Outcome<R>);
    /// How many numbers of the observation are the task's.
    fn observation_size(&self) -> usize;
    /// Writes the numbers of the observation that are the task's.
    fn observe(&self, plant: &M::Plant<R>, observation: &mut [R]);
    /// See `Task::residuals`.
    fn residuals(&self, machine: &M, plant: &M::Plant<R>, out: &mut Vec<R>);
    /// See `Task::scene`.
    fn scene(&self, plant: &M::Plant<R>, lane: usize, scene: &mut Scene);
}

impl<T: Task, R: Real> Scorer<T::Machine, R> for T {
    fn score(
        &self,
        machine: &T::Machine,
        plant: &<T::Machine as Machine>::Plant<R>,
        out: &mut Outcome<R>,
    ) {
        R::run(Score { task: self, machine, plant, out });
    }

    fn observation_size(&self) -> usize {
        T::OBSERVATION.len()
    }

    fn observe(&self, plant: &<T::Machine as Machine>::Plant<R>, observation: &mut [R]) {
        if !observation.is_empty() {
            R::run(Observe { task: self, plant, observation });
        }
    }

    fn residuals(
        &self,
        machine: &T::Machine,
        plant: &<T::Machine as Machine>::Plant<R>,
        out: &mut Vec<R>,
    ) {
        Task::residuals(self, machine, plant, out);
    }

    fn scene(&self, plant: &<T::Machine as Machine>::Plant<R>, lane: usize, scene: &mut Scene) {
        Task::scene(self, plant, lane, scene);
    }
}

struct Score<'a, T: Task, R: Real> {
    task: &'a T,
    machine: &'a T::Machine,
    plant: &'a <T::Machine as Machine>::Plant<R>,
    out: &'a mut Outcome<R>,
}

impl<T: Task, R: Real> Kernel for Score<'_, T, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Score { task, machine, plant, out } = self;
        let (terms, metrics) = out.terms.split_at_mut(T::TERMS.len());
        let (own, further) = metrics.split_at_mut(<T::Machine as Machine>::METRICS.len());
        out.terminated = Task::score(task, machine, plant, terms);
        let mut reward = terms[0];
        for &term in &terms[1..] {
            reward += term;
        }
        out.reward = reward;
        machine.metrics(plant, own);
        Task::metrics(task, machine, plant, further);
    }
}

struct Observe<'a, T: Task, R: Real> {
    task: &'a T,
    plant: &'a <T::Machine as Machine>::Plant<R>,
    observation: &'a mut [R],
}

impl<T: Task, R: Real> Kernel for Observe<'_, T, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        Task::observe(self.task, self.plant, self.observation);
    }
}
