//! One environment by itself, to try actions on: what an optimiser of trajectories drives.

use super::block::{Block, Environment};
use super::machine::{Differentiated, Machine};
use super::task::{Outcome, Scorer};
use crate::error::{Error, Result};
use crate::lane::{Dual, Real};
use crate::seed::Stream;
use std::sync::Arc;

/// A control step and its derivatives, by n numbers of state and then the action: rows of n + 1 numbers.
#[derive(Clone, Debug, Default)]
pub struct Expansion {
    /// Of the next state, n rows.
    pub next: Vec<f64>,
    /// The reward.
    pub reward: f64,
    /// Of the reward, one row.
    pub reward_slopes: Vec<f64>,
    /// See `Task::residuals`; the numbers themselves are not needed. A row each.
    pub residuals: Vec<f64>,
    /// Positions \[m\] and velocities \[m/s\] of the nodes that move, after the step.
    pub coordinates: Vec<f64>,
    /// A row for each of these.
    pub coordinates_slopes: Vec<f64>,
}

/// One environment by itself: no observation, no time limit, no autoreset. A task that ends the episode only stops paying
/// in the environment; here the motion goes on.
pub trait Rehearsal: Send {
    /// The state as the numbers that derivatives are by.
    ///
    /// # Errors
    /// A machine without derivatives.
    fn state(&self) -> Result<Vec<f64>>;
    /// Positions \[m\] and velocities \[m/s\] of the nodes that move.
    fn coordinates(&self) -> Vec<f64>;
    /// Takes a control step under an action within its bounds; returns the reward. The bits are those of the environment.
    ///
    /// # Errors
    /// The solver gives up; the state means nothing then.
    fn step(&mut self, action: f64) -> Result<f64>;
    /// Derivatives of that step, which is not taken.
    ///
    /// # Errors
    /// The solver gives up; a machine without derivatives.
    fn expand(&self, action: f64) -> Result<Expansion>;
    /// The same once more.
    fn copy(&self) -> Box<dyn Rehearsal>;
}

/// What all copies share.
struct Play<M: Machine> {
    machine: M,
    task: Arc<dyn Scorer<M, f64>>,
    task_of_slopes: Arc<dyn Scorer<M, Dual>>,
    /// Numbers that a step reports.
    terms: usize,
    /// Numbers that the sensors show.
    sensors: usize,
}

struct Solo<M: Machine> {
    play: Arc<Play<M>>,
    plant: M::Plant<f64>,
    stream: Stream,
    time: f64,
}

impl<M: Machine, R: Real> Block<M, R> {
    /// See `VectorEnv::rehearsal`.
    pub fn rehearsal(&self, env: &Environment<M, R>, lane: usize) -> Result<Box<dyn Rehearsal>> {
        let (plant, stream) = self.one(&env.machine, lane)?;
        let solo = Solo {
            play: Arc::new(Play {
                machine: env.machine.clone(),
                task: env.task_of_one.clone(),
                task_of_slopes: env.task_of_slopes.clone(),
                terms: self.outcome.terms.len(),
                sensors: env.machine.observation().size(),
            }),
            plant,
            stream,
            time: f64::from(self.clocks[lane].steps) * env.spec.control_dt,
        };
        solo.state()?;
        if env.spec.action.size() != 1 {
            let reason = "one number, for a trajectory to be optimised";
            return Err(Error::parameter("action", env.spec.action.size(), reason));
        }
        Ok(Box::new(solo))
    }
}

impl<M: Machine> Solo<M> {
    fn failed(&self) -> Error {
        let reason = "the step did not converge in its smallest parts".into();
        Error::Solver { time: self.time, reason }
    }
}

impl<M: Machine> Rehearsal for Solo<M> {
    fn state(&self) -> Result<Vec<f64>> {
        self.play.machine.essence(&self.plant)
    }

    fn coordinates(&self) -> Vec<f64> {
        self.play.machine.coordinates(&self.plant)
    }

    fn step(&mut self, action: f64) -> Result<f64> {
        let play = self.play.clone();
        if !play.machine.advance(&mut self.plant, &[action], &mut self.stream)? {
            return Err(self.failed());
        }
        let mut outcome = Outcome::new(play.terms);
        play.task.score(&play.machine, &self.plant, &mut outcome);
        // (The noise of the sensors comes from the same stream.)
        let mut sensors = vec![0.0; play.sensors];
        let stream = std::slice::from_mut(&mut self.stream);
        play.machine.observe(&self.plant, true, stream, &mut sensors);
        self.time += play.machine.control_dt();
        Ok(outcome.reward)
    }

    fn expand(&self, action: f64) -> Result<Expansion> {
        let Play { machine, task_of_slopes, terms, .. } = &*self.play;
        let mut stream = self.stream.clone();
        let moved = machine.differentiate_essence(&self.plant, &[action], &mut stream)?;
        let Differentiated { next, plants } = moved.ok_or_else(|| self.failed())?;
        let columns = next[0].len() + 1;
        let mut outcome = Outcome::new(*terms);
        let (mut paid, mut lost, mut placed) = (vec![], vec![], vec![]);
        for plant in &plants {
            task_of_slopes.score(machine, plant, &mut outcome);
            paid.push(vec![outcome.reward]);
            let mut residuals = vec![];
            task_of_slopes.residuals(machine, plant, &mut residuals);
            lost.push(residuals);
            placed.push(machine.coordinates(plant));
        }
        Ok(Expansion {
            next: rows(&next, columns),
            reward: outcome.reward.value,
            reward_slopes: rows(&paid, columns),
            residuals: rows(&lost, columns),
            coordinates: placed[0].iter().map(|x| x.value).collect(),
            coordinates_slopes: rows(&placed, columns),
        })
    }

    fn copy(&self) -> Box<dyn Rehearsal> {
        let Solo { play, plant, stream, time } = self;
        let (play, plant, stream) = (play.clone(), plant.clone(), stream.clone());
        Box::new(Solo { play, plant, stream, time: *time })
    }
}

/// Slopes of numbers in groups of directions, row-major.
fn rows(groups: &[Vec<Dual>], columns: usize) -> Vec<f64> {
    let mut all = Vec::with_capacity(groups[0].len() * columns);
    for i in 0..groups[0].len() {
        let slopes = groups.iter().flat_map(|group| group[i].slopes);
        all.extend(slopes.take(columns));
    }
    all
}
