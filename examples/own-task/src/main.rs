//! `cargo run --release -p own-task`: 64 rods, a small controller, their mean reward.

use own_task::{LEVEL, register};
use rodgym_core::catalog::{self, MakeOptions};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer};
use rodgym_core::error::Result;

const RODS: usize = 64;
const STEPS: usize = 300;

fn main() -> Result<()> {
    register()?;
    let mut env = catalog::make(&MakeOptions {
        id: LEVEL.into(),
        num_envs: RODS,
        kwargs: Default::default(),
        autoreset_mode: AutoresetMode::SameStep,
        max_episode_steps: None,
        num_threads: 1,
    })?;
    let mut out = StepBuffer::new(env.spec(), RODS);
    let numbers = env.spec().observation.size();
    env.reset(&Seeds::Base(0), None, &ResetOptions::default(), out.data())?;
    let mut total = 0.0;
    for _ in 0..STEPS {
        // A spring and a damper on the first edge, about level to the right: its angle is a quarter turn there.
        let actions: Vec<f32> = out
            .observation
            .chunks(numbers)
            .map(|seen| {
                let angle = seen[numbers / 3].atan2(seen[0]);
                let rate = 10.0 * seen[2 * numbers / 3];
                3.0 * (std::f32::consts::FRAC_PI_2 - angle) - 0.2 * rate
            })
            .collect();
        env.step(&actions, out.data())?;
        total += out.reward.iter().sum::<f64>();
    }
    println!("mean reward of a step: {:.3}", total / (RODS * STEPS) as f64);
    Ok(())
}
