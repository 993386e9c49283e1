//! Promise: a search finds actions that earn more than the regulator's, within bounds, and the environment pays what the
//! search says, to the last bit.

use rodgym_baselines::ilqr::{Cost, Options, Quadratic, Search};
use rodgym_baselines::registry::{Target, make as controller};
use rodgym_core::catalog::{MakeOptions, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};

fn environment(id: &str, seed: u64) -> (Box<dyn VectorEnv>, StepBuffer) {
    let mut env = make(&MakeOptions {
        id: id.into(),
        num_envs: 1,
        kwargs: Default::default(),
        autoreset_mode: AutoresetMode::Disabled,
        max_episode_steps: None,
        num_threads: 1,
    })
    .unwrap();
    let mut buffer = StepBuffer::new(env.spec(), 1);
    env.reset(&Seeds::Base(seed), None, &ResetOptions::default(), buffer.data()).unwrap();
    (env, buffer)
}

/// The return of `lqr`.
fn regulated(seed: u64, steps: usize) -> f64 {
    let (mut env, mut buffer) = environment("rodgym/PendulumSwingUp-v0", seed);
    let law = controller("lqr", &Target::from(env.spec())).unwrap();
    let (mut state, mut action) = (vec![0.0; law.state_size()], [0.0_f32]);
    let mut total = 0.0;
    for t in 0..steps {
        let mut seen = vec![0.0; 18];
        env.observe(0, &mut seen).unwrap();
        law.predict(&seen, &mut state, &[t == 0], &mut action).unwrap();
        env.step(&action, buffer.data()).unwrap();
        total += buffer.data().reward[0];
    }
    total
}

#[test]
fn it_earns_more_than_the_regulator_and_what_it_says() {
    const STEPS: usize = 100;
    for (seed, levels) in [(2000, 0), (2001, 32767)] {
        let (mut env, mut buffer) = environment("rodgym/PendulumSwingUp-v0", seed);
        let options = Options { levels, ..Options::default() };
        let start = env.rehearsal(0).unwrap();
        let mut search = Search::new(start, Cost::Own, STEPS, &[1.0; 15], options).unwrap();
        let mut loss = f64::INFINITY;
        for _ in 0..400 {
            let before = search.status().horizon;
            let status = search.iterate().unwrap();
            if status.horizon == before {
                assert!(status.loss <= loss);
            }
            loss = status.loss;
            if status.done {
                break;
            }
        }
        assert!(search.status().done && search.actions().len() == STEPS);
        let mut total = 0.0;
        for (&action, &reward) in search.actions().iter().zip(search.rewards()) {
            assert!((-1.0..=1.0).contains(&action) && f64::from(action as f32) == action);
            if levels > 0 {
                let whole = action * f64::from(levels);
                assert!((whole - whole.round()).abs() < 1e-2);
            }
            env.step(&[action as f32], buffer.data()).unwrap();
            assert_eq!(buffer.data().reward[0].to_bits(), reward.to_bits());
            total += reward;
        }
        let lqr = regulated(seed, STEPS);
        assert!(total > lqr + 3.0, "{total} is not much more than {lqr}");
    }
}

#[test]
fn a_quadratic_cost_holds_a_rod_where_its_reward_has_no_slope() {
    let (mut env, mut buffer) = environment("rodgym/PendulumBalance-v0", 7);
    let start = env.rehearsal(0).unwrap();
    let refused = Search::new(start.copy(), Cost::Own, 50, &[], Options::default());
    assert!(refused.is_err_and(|error| error.to_string().contains("give a quadratic cost")));
    let mut target = vec![0.0; 24];
    (0..6).for_each(|k| target[2 * k + 1] = 0.05 * (k + 1) as f64);
    let state: Vec<f64> = (0..24).map(|i| if i < 12 { 10.0 } else { 0.01 }).collect();
    let cost =
        Cost::Quadratic(Quadratic { target, state: state.clone(), action: 0.04, last: state });
    let mut search = Search::new(start, cost, 100, &[], Options::default()).unwrap();
    while !search.iterate().unwrap().done {}
    for &action in search.actions() {
        env.step(&[action as f32], buffer.data()).unwrap();
        assert!(!buffer.data().terminated[0]);
    }
    let tip = env.nodes(0).unwrap().positions[6];
    assert!(tip[0].abs() < 0.01 && tip[1] > 0.298, "{tip:?}");
}

#[test]
fn what_does_not_fit_is_refused() {
    let (env, _) = environment("rodgym/PendulumSwingUp-v0", 1);
    let search = |cost: Cost, steps, actions: &[f64]| {
        let start = env.rehearsal(0).unwrap();
        Search::new(start, cost, steps, actions, Options::default()).err().unwrap().to_string()
    };
    let quadratic = |change: &dyn Fn(&mut Quadratic)| {
        let mut cost = Quadratic {
            target: vec![0.0; 24],
            state: vec![1.0; 24],
            action: 1.0,
            last: vec![0.0; 24],
        };
        change(&mut cost);
        search(Cost::Quadratic(cost), 10, &[])
    };
    assert!(search(Cost::Own, 0, &[]).starts_with("steps = 0"));
    assert!(search(Cost::Own, 10, &[1.5]).starts_with("actions = 1.5"));
    assert!(search(Cost::Own, 1, &[0.0; 2]).starts_with("actions = 2"));
    assert!(quadratic(&|cost| cost.target.truncate(3)).starts_with("target has shape (3,)"));
    assert!(quadratic(&|cost| cost.state[4] = -1.0).starts_with("state = -1"));
    assert!(quadratic(&|cost| cost.last[4] = f64::NAN).starts_with("last = NaN"));
    assert!(quadratic(&|cost| cost.action = 0.0).starts_with("action = 0"));
    let lopsided = quadratic(&|cost| cost.state = (0..576).map(f64::from).collect());
    assert!(lopsided.contains("symmetric"));
}
