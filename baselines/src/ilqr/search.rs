//! The search for a trajectory: iterations over a horizon that grows in stages.
//!
//! A long horizon at once ends in poor places: a rod that swings freely is chaotic, and the first iterations see nothing
//! but that. So the first steps are made good by themselves, then some more are added, played by the feedback that the
//! steps before them have.

use super::{Cost, Model, Policy, sweep};
use crate::error::{Result, parameter};
use rodgym_core::batch::Rehearsal;

/// How to search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Control steps of the first stage.
    pub first: usize,
    /// Control steps that each stage adds.
    pub more: usize,
    /// An iteration that takes away less loss ends a stage.
    pub good: f64,
    /// The same of the last stage.
    pub best: f64,
    /// Most iterations of a stage that is not the last.
    pub patience: usize,
    /// Actions are multiples of one over this number where it is not 0, so that a table of whole numbers holds them;
    /// in single precision in any case.
    pub levels: u32,
}

impl Default for Options {
    fn default() -> Self {
        Options { first: 15, more: 20, good: 1e-2, best: 1e-6, patience: 40, levels: 0 }
    }
}

/// Where a search stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Status {
    /// Control steps of the present stage.
    pub horizon: usize,
    /// Iterations so far.
    pub iterations: usize,
    /// Loss of the present stage.
    pub loss: f64,
    /// Whether there is nothing left to do.
    pub done: bool,
}

/// A motion under actions, control step by control step.
#[derive(Default)]
struct Trajectory {
    actions: Vec<f64>,
    /// The start, and what came after each action.
    at: Vec<Box<dyn Rehearsal>>,
    /// Their states.
    states: Vec<Vec<f64>>,
    rewards: Vec<f64>,
    loss: f64,
}

/// Damping below which there is none, and above which there is no way on.
const DAMPING: (f64, f64) = (1e-6, 1e6);
/// Share of what is promised that an iteration must keep.
const KEPT: f64 = 1e-3;
/// How often the changes are halved.
const HALVINGS: u32 = 8;
/// Iterations in a row that take away less than `best` before the search ends.
const STILL: usize = 3;
/// Control steps before the end of a stage whose feedback plays the next stage's: later ones care for little.
const BEFORE_END: usize = 30;

/// A search under way.
pub struct Search {
    cost: Cost,
    options: Options,
    /// What to begin with, to its end.
    given: Vec<f64>,
    steps: usize,
    now: Trajectory,
    models: Vec<Model>,
    policy: Policy,
    damping: f64,
    /// How fast the damping changes (Tassa, Erez, Todorov 2012).
    pace: f64,
    stage: usize,
    still: usize,
    iterations: usize,
    done: bool,
}

impl Search {
    /// A search for the `steps` actions from where `start` is. The first are `actions`, if any are given: the first
    /// stage has as many.
    ///
    /// # Errors
    /// Options, actions or a cost that are not allowed; the solver gives up.
    pub fn new(
        start: Box<dyn Rehearsal>,
        cost: Cost,
        steps: usize,
        actions: &[f64],
        options: Options,
    ) -> Result<Self> {
        let count = "an integer of at least 1";
        for (name, value) in [("steps", steps), ("first", options.first), ("more", options.more)] {
            if value == 0 {
                return Err(parameter(name, value, count));
            }
        }
        if let Some(bad) = actions.iter().find(|a| !(-1.0..=1.0).contains(*a)) {
            return Err(parameter("actions", bad, "numbers from -1 to 1"));
        }
        if actions.len() > steps {
            return Err(parameter("actions", actions.len(), "no more than there are steps"));
        }
        cost.check(start.as_ref())?;
        let given =
            if actions.is_empty() { vec![0.0; options.first.min(steps)] } else { actions.to_vec() };
        let mut search = Search {
            cost,
            options,
            given,
            steps,
            now: Trajectory::default(),
            models: vec![],
            policy: Policy::default(),
            damping: 0.0,
            pace: 1.0,
            stage: 0,
            still: 0,
            iterations: 0,
            done: false,
        };
        let given = search.given.clone();
        search.now = search.play(start, given.len(), &mut |t, _| given[t])?;
        Ok(search)
    }

    /// Actions of the present stage, as single precision has them.
    pub fn actions(&self) -> &[f64] {
        &self.now.actions
    }

    /// Their rewards.
    pub fn rewards(&self) -> &[f64] {
        &self.now.rewards
    }

    /// Where the search stands.
    pub fn status(&self) -> Status {
        let Search { iterations, done, .. } = *self;
        Status { horizon: self.now.actions.len(), iterations, loss: self.now.loss, done }
    }

    /// An action as it can be given.
    fn rounded(&self, action: f64) -> f64 {
        let action = action.clamp(-1.0, 1.0);
        let levels = f64::from(self.options.levels);
        let action = if levels > 0.0 { libm::round(action * levels) / levels } else { action };
        f64::from(action as f32)
    }

    /// Plays `steps` control steps under a law of step and state.
    fn play(
        &self,
        start: Box<dyn Rehearsal>,
        steps: usize,
        law: &mut dyn FnMut(usize, &[f64]) -> f64,
    ) -> Result<Trajectory> {
        let mut trajectory =
            Trajectory { states: vec![start.state()?], at: vec![start], ..Default::default() };
        self.play_on(&mut trajectory, steps, law)?;
        Ok(trajectory)
    }

    fn play_on(
        &self,
        trajectory: &mut Trajectory,
        steps: usize,
        law: &mut dyn FnMut(usize, &[f64]) -> f64,
    ) -> Result<()> {
        let first = trajectory.actions.len();
        for t in first..first + steps {
            let action = self.rounded(law(t, &trajectory.states[t]));
            let mut at = trajectory.at[t].copy();
            let reward = at.step(action)?;
            trajectory.loss += self.cost.loss(at.as_ref(), action, reward, t + 1 == self.steps);
            trajectory.actions.push(action);
            trajectory.rewards.push(reward);
            trajectory.states.push(at.state()?);
            trajectory.at.push(at);
        }
        Ok(())
    }

    /// One iteration; where a stage is at its end, the next begins.
    ///
    /// # Errors
    /// The solver gives up on the way that was good before.
    pub fn iterate(&mut self) -> Result<Status> {
        if self.done {
            return Ok(self.status());
        }
        self.iterations += 1;
        self.stage += 1;
        self.expand()?;
        let better = self.improve();
        let last = self.now.actions.len() == self.steps;
        let gain = better.as_ref().map_or(0.0, |better| self.now.loss - better.loss);
        if let Some(better) = better {
            self.now = better;
        }
        let enough = if last { self.options.best } else { self.options.good };
        self.still = if gain < enough { self.still + 1 } else { 0 };
        let stuck = self.damping > DAMPING.1;
        if last {
            self.done = stuck || self.still >= STILL;
        } else if stuck || self.still > 0 || self.stage >= self.options.patience {
            self.grow()?;
        }
        Ok(self.status())
    }

    fn expand(&mut self) -> Result<()> {
        let count = self.now.actions.len();
        self.models.resize_with(count, Model::default);
        for t in 0..count {
            let action = self.now.actions[t];
            let expansion = self.now.at[t].expand(action)?;
            self.cost.model(&expansion, action, t + 1 == self.steps, &mut self.models[t]);
        }
        Ok(())
    }

    /// A better trajectory near the present one, if there is one.
    fn improve(&mut self) -> Option<Trajectory> {
        loop {
            let mut policy = std::mem::take(&mut self.policy);
            sweep(&self.models, &self.now.actions, self.damping, &mut policy);
            self.policy = policy;
            let mut alpha = 1.0;
            for _ in 0..HALVINGS {
                if let Some(better) = self.follow(alpha) {
                    let kept = self.now.loss - better.loss;
                    if kept > 0.0 && kept > KEPT * self.policy.promised(alpha) {
                        self.pace = (self.pace / 1.6).min(1.0 / 1.6);
                        let damping = self.damping * self.pace;
                        self.damping = if damping < DAMPING.0 { 0.0 } else { damping };
                        return Some(better);
                    }
                }
                alpha *= 0.5;
            }
            self.pace = (self.pace * 1.6).max(1.6);
            self.damping = (self.damping * self.pace).max(DAMPING.0);
            // Where nothing is promised, nothing is to be had.
            if self.damping > DAMPING.1 || self.policy.promised(1.0) < 1e-12 {
                return None;
            }
        }
    }

    /// The motion under a part of the changes; nothing where the solver gives up on it, or where it costs more on its way.
    fn follow(&self, alpha: f64) -> Option<Trajectory> {
        let Search { now, policy, .. } = self;
        let law = &mut |t: usize, state: &[f64]| {
            let n = state.len();
            let gains = &policy.feedback[t * n..(t + 1) * n];
            let off = state.iter().zip(&now.states[t]);
            let answer: f64 = gains.iter().zip(off).map(|(gain, (x, was))| gain * (x - was)).sum();
            now.actions[t] + alpha * policy.change[t] + answer
        };
        self.play(now.at[0].copy(), now.actions.len(), law).ok()
    }

    /// Adds the steps of the next stage.
    fn grow(&mut self) -> Result<()> {
        let horizon = self.now.actions.len();
        let more = self.options.more.min(self.steps - horizon);
        let from = horizon - BEFORE_END.min(horizon / 2) - 1;
        let (state, action) = (self.now.states[from].clone(), self.now.actions[from]);
        let n = state.len();
        let gains = self.policy.feedback[from * n..(from + 1) * n].to_vec();
        let mut longer = std::mem::take(&mut self.now);
        let answer = &mut |_: usize, x: &[f64]| {
            let off = x.iter().zip(&state);
            action + gains.iter().zip(off).map(|(gain, (x, was))| gain * (x - was)).sum::<f64>()
        };
        let played = self.play_on(&mut longer, more, answer);
        self.now = longer;
        played?;
        (self.stage, self.still, self.damping, self.pace) = (0, 0, 0.0, 1.0);
        Ok(())
    }
}
