//! The promise under test: the example is an environment like ours. Its reward is what its documentation says, and a rod has
//! the same bits alone and among others.

use own_task::{LEVEL, register};
use rodgym_core::catalog::{self, MakeOptions};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};

fn begun(num_envs: usize) -> (Box<dyn VectorEnv>, StepBuffer) {
    let mut env = catalog::make(&MakeOptions {
        id: LEVEL.into(),
        num_envs,
        kwargs: Default::default(),
        autoreset_mode: AutoresetMode::SameStep,
        max_episode_steps: None,
        num_threads: 1,
    })
    .expect("it is in the catalogue");
    let mut out = StepBuffer::new(env.spec(), num_envs);
    env.reset(&Seeds::Base(1), None, &ResetOptions::default(), out.data()).unwrap();
    (env, out)
}

#[test]
fn the_reward_is_that_of_the_documentation_and_lanes_do_not_matter() {
    register().unwrap();
    let (mut alone, mut one) = begun(1);
    let (mut many, mut all) = begun(9);
    for step in 0..60 {
        let action = if step < 30 { 0.8f32 } else { -0.5 };
        alone.step(&[action], one.data()).unwrap();
        many.step(&[action; 9], all.data()).unwrap();
        assert_eq!(one.reward[0], all.reward[0]);
        let tip = *alone.nodes(0).unwrap().positions.last().unwrap();
        let level = (1.0 - tip[1].abs() / 0.3).clamp(0.0, 1.0);
        let expected = level - 0.02 * f64::from(action).powi(2);
        assert!((one.reward[0] - expected).abs() < 1e-12, "{} {expected}", one.reward[0]);
    }
    assert!(register().unwrap_err().to_string().contains(LEVEL));
}
