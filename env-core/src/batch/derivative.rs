//! Derivatives of a control step of one environment of a block: of the plant's state, of what its sensors show and of
//! what its task pays.

use super::block::{Block, Environment};
use super::machine::{Differentiated, Machine};
use super::task::Outcome;
use crate::error::{Error, Result};
use crate::lane::{DIRECTIONS, Dual, Lanewise, Real};
use crate::seed::Stream;
use crate::simulation::Named;
use crate::spec::Spec;

impl<M: Machine, R: Real> Block<M, R> {
    /// See `VectorEnv::step_jacobian`.
    pub fn jacobian(
        &self,
        env: &Environment<M, R>,
        lane: usize,
        action: &[f32],
        chosen: &[usize],
    ) -> Result<Vec<Named>> {
        let Environment { machine, task_of_slopes: task, spec, .. } = env;
        let (plant, mut stream) = self.one(machine, lane)?;
        let action: Vec<f64> = action.iter().map(|&a| a as f64).collect();
        let moved = machine.differentiate(&plant, &action, chosen, &mut stream)?;
        let Differentiated { next, plants } = moved.ok_or_else(|| self.failed(spec, lane, 0))?;
        let mut outcome = Outcome::new(self.outcome.terms.len());
        let mut seen = vec![vec![Dual::default(); self.observation.len()]; plants.len()];
        let mut paid = vec![];
        for (plant, seen) in plants.iter().zip(&mut seen) {
            task.score(machine, plant, &mut outcome);
            paid.push([outcome.reward]);
            let size = seen.len() - task.observation_size();
            let (sensors, further) = seen.split_at_mut(size);
            let stream = &mut [stream.clone()];
            machine.observe(plant, true, stream, sensors);
            task.observe(plant, further);
        }
        let next: Vec<&[Dual]> = next.iter().map(Vec::as_slice).collect();
        let seen: Vec<&[Dual]> = seen.iter().map(Vec::as_slice).collect();
        let paid: Vec<&[Dual]> = paid.iter().map(|reward| &reward[..]).collect();
        let (s, a, p) = (next[0].len(), action.len(), chosen.len());
        let mut all = vec![];
        for (numbers, names) in [
            (next, ["A", "B", "P"]),
            (seen, ["C", "D", "Q"]),
            (paid, ["reward_state", "reward_action", "reward_parameters"]),
        ] {
            for (name, first, count) in [(names[0], 0, s), (names[1], s, a), (names[2], s + a, p)] {
                all.push(Named::slopes(name, &numbers, first, count));
            }
        }
        // The reward is one number.
        for row in &mut all[6..] {
            row.shape.remove(0);
        }
        Ok(all)
    }

    /// See `VectorEnv::rollout_gradient`.
    pub fn rollout_gradient(
        &self,
        env: &Environment<M, R>,
        lane: usize,
        actions: &[f32],
        chosen: &[usize],
    ) -> Result<Vec<Named>> {
        let Environment { machine, task_of_slopes: task, spec, .. } = env;
        let (mut plant, mut stream) = self.one(machine, lane)?;
        let size = spec.action.size();
        let actions: Vec<f64> = actions.iter().map(|&a| a as f64).collect();
        let mut outcome = Outcome::new(self.outcome.terms.len());
        let mut sensors = vec![0.0; machine.observation().size()];
        // Where each step begins, and what its reward depends on: the state after it, the action, parameters.
        let (mut steps, mut rewards, mut groups) = (vec![], vec![], vec![]);
        for (t, action) in actions.chunks(size).enumerate() {
            let start = (plant.clone(), stream.clone());
            if !machine.advance(&mut plant, action, &mut stream)? {
                return Err(self.failed(spec, lane, t));
            }
            if groups.is_empty() {
                groups = machine.variables(&plant, chosen)?;
            } else {
                machine.renew(&mut groups, &plant);
            }
            let mut slopes = Vec::with_capacity(groups.len() * DIRECTIONS);
            for group in &groups {
                task.score(machine, group, &mut outcome);
                slopes.extend(outcome.reward.slopes);
            }
            rewards.push(outcome.reward.value);
            steps.push((start, slopes));
            if outcome.terminated {
                break;
            }
            // (The noise of the sensors comes from the same stream.)
            machine.observe(&plant, true, std::slice::from_mut(&mut stream), &mut sensors);
        }
        let mut by_actions = vec![0.0; actions.len()];
        let mut by_parameters = vec![0.0; chosen.len()];
        let mut by_state = vec![0.0; machine.vector(&plant)?.len()];
        for (t, ((plant, mut stream), slopes)) in steps.into_iter().enumerate().rev() {
            let action = &actions[t * size..(t + 1) * size];
            let s = by_state.len() + machine.measured();
            let mut gradient = by_state;
            gradient.resize(s, 0.0);
            gradient.iter_mut().zip(&slopes).for_each(|(to, slope)| *to += slope);
            let pulled = machine.pull_back(&plant, action, chosen, &mut stream, &gradient)?;
            let pulled = pulled.ok_or_else(|| self.failed(spec, lane, t))?;
            for (j, by) in pulled.action.iter().enumerate() {
                let inside = (spec.action.low[j]..=spec.action.high[j]).contains(&action[j]);
                let own = if inside { slopes[s + j] } else { 0.0 };
                by_actions[t * size + j] = by + own;
            }
            for (j, by) in by_parameters.iter_mut().enumerate() {
                *by += pulled.parameters[j] + slopes[s + size + j];
            }
            by_state = pulled.state;
        }
        rewards.resize(actions.len() / size, 0.0);
        Ok(vec![
            Named::vector("rewards", rewards),
            Named { name: "actions", shape: vec![actions.len() / size, size], values: by_actions },
            Named::vector("state", by_state),
            Named::vector("parameters", by_parameters),
        ])
    }

    /// The plant and the random stream of one environment.
    pub(super) fn one(&self, machine: &M, lane: usize) -> Result<(M::Plant<f64>, Stream)> {
        if !self.clocks[lane].begun {
            return Err(Error::NotReset);
        }
        let (mut plant, mut numbers) = (machine.new_plant::<f64>(), vec![]);
        self.plant.visit(&mut |x| numbers.push(x.get(lane)));
        let mut next = numbers.iter();
        plant.visit_mut(&mut |x| *x = *next.next().expect("both have the same shape"));
        Ok((plant, self.streams[lane].clone()))
    }

    /// The solver gave up `steps` steps from now.
    fn failed(&self, spec: &Spec, lane: usize, steps: usize) -> Error {
        let time = (f64::from(self.clocks[lane].steps) + steps as f64) * spec.control_dt;
        Error::Solver { time, reason: "the step did not converge in its smallest parts".into() }
    }
}
