//! Episodes of an environment, played side by side while a gait is looked for.

use crate::error::Result;
use crate::target::Target;
use rodgym_core::catalog::{MakeOptions, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};

/// Steps of an episode.
pub const STEPS: usize = 200;

/// Episodes that have begun.
pub struct Episodes {
    env: Box<dyn VectorEnv>,
    out: StepBuffer,
    actions: Vec<f32>,
}

impl Episodes {
    /// One episode a seed.
    ///
    /// # Errors
    /// An environment that cannot be made again from its keywords.
    pub fn new(target: &Target, seeds: impl Iterator<Item = u64>) -> Result<Self> {
        let seeds: Vec<Option<u64>> = seeds.map(Some).collect();
        let n = seeds.len();
        let mut env = make(&MakeOptions {
            id: target.id.clone(),
            num_envs: n,
            kwargs: target.config.clone(),
            autoreset_mode: AutoresetMode::NextStep,
            max_episode_steps: None,
            num_threads: 1,
        })?;
        let mut out = StepBuffer::new(env.spec(), n);
        env.reset(&Seeds::Each(seeds), None, &ResetOptions::default(), out.data())?;
        Ok(Episodes { env, out, actions: vec![0.0; n] })
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.actions.len()
    }

    /// What an episode's agent sees.
    pub fn observation(&self, episode: usize) -> &[f32] {
        let d = self.env.spec().observation.size();
        &self.out.observation[episode * d..(episode + 1) * d]
    }

    /// A physical parameter of an episode; nothing where the machine has none of that name.
    pub fn parameter(&self, episode: usize, name: &str) -> Option<f64> {
        let table = &self.env.spec().parameters;
        let at = table.iter().position(|row| row.name == name)?;
        Some(self.out.parameters[episode * table.len() + at])
    }

    /// One step of all; `command` has an episode's number and observation, and writes its action.
    ///
    /// # Errors
    /// An action that is not finite.
    pub fn step(&mut self, mut command: impl FnMut(usize, &[f32], &mut [f32])) -> Result<&[f64]> {
        let mut actions = std::mem::take(&mut self.actions);
        for (i, action) in actions.iter_mut().enumerate() {
            command(i, self.observation(i), std::slice::from_mut(action));
        }
        let stepped = self.env.step(&actions, self.out.data());
        self.actions = actions;
        stepped?;
        Ok(&self.out.reward)
    }
}
