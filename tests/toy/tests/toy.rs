//! The promise under test: a machine, tasks, a drawing and a controller of another crate work like our own, by the
//! text of docs/extending.md and without touching a file of ours.

use rodgym_baselines::registry::{self, Target};
use rodgym_core::catalog::{self, MakeOptions};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};
use rodgym_render::{drawing, render};
use serde_json::{Map, Value, json};
use std::sync::Once;

const BEAD: &str = "toy/BeadRest-v0";
const SPIN: &str = "toy/PendulumSpin-v0";

fn registered() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| rodgym_toy::register().expect("new names"));
}

fn make(id: &str, n: usize, kwargs: Value) -> Box<dyn VectorEnv> {
    registered();
    catalog::make(&MakeOptions {
        id: id.into(),
        num_envs: n,
        kwargs: kwargs.as_object().expect("keywords").clone(),
        autoreset_mode: AutoresetMode::SameStep,
        max_episode_steps: Some(90),
        num_threads: 1,
    })
    .expect("it is in the catalogue")
}

fn reset(env: &mut dyn VectorEnv) -> StepBuffer {
    let mut out = StepBuffer::new(env.spec(), env.num_envs());
    env.reset(&Seeds::Base(5), None, &ResetOptions::default(), out.data()).unwrap();
    out
}

#[test]
fn the_catalogue_has_the_new_rows_after_ours() {
    registered();
    let ids: Vec<_> =
        catalog::entries().iter().map(|entry| (entry.id, entry.machine, entry.task)).collect();
    assert_eq!(ids[ids.len() - 2..], [(BEAD, "bead", "rest"), (SPIN, "pendulum", "spin")]);
    assert!(rodgym_toy::register().unwrap_err().to_string().contains(BEAD));
}

/// Eight in lanes have the bits of one alone; a spring without push has the period of its closed form.
#[test]
fn the_bead_swings_as_a_bead_and_has_the_same_bits_in_lanes() {
    let mut many = make(BEAD, 9, json!({"randomize": {"stiffness": [20.0, 60.0]}}));
    let mut single = make(BEAD, 1, json!({"randomize": {"stiffness": [20.0, 60.0]}}));
    let (mut all, mut one) = (reset(many.as_mut()), reset(single.as_mut()));
    for _ in 0..100 {
        assert_eq!(all.observation[..2], one.observation[..]);
        many.step(&[0.3; 9], all.data()).unwrap();
        single.step(&[0.3], one.data()).unwrap();
        assert_eq!(all.reward[0], one.reward[0]);
    }
    let mut bare = catalog::simulation("bead", &Map::new()).unwrap();
    bare.set_state(&[[-2.0, 0.0], [0.5, 0.0]], &[[0.0, 0.0]; 2]).unwrap();
    let period = std::f64::consts::TAU / 40f64.sqrt();
    bare.step(0.0, (period / bare.physics_dt()).round() as u64).unwrap();
    assert!((bare.state().positions[1][0] - 0.5).abs() < 1e-3);
}

#[test]
fn the_copy_of_a_bead_goes_on_with_its_bits() {
    let mut env = make(BEAD, 3, json!({}));
    let mut out = reset(env.as_mut());
    env.step(&[0.1, 0.2, 0.3], out.data()).unwrap();
    let mut copy = env.simulation(2).unwrap();
    env.step(&[0.0, 0.0, 0.5], out.data()).unwrap();
    copy.step(f64::from(0.5f32) * 10.0, 10).unwrap();
    assert_eq!(copy.state(), env.nodes(2).unwrap());
}

#[test]
fn its_controller_brakes_it_and_refuses_a_pendulum() {
    let mut env = make(BEAD, 1, json!({}));
    let law = registry::make("damper", &Target::from(env.spec())).unwrap();
    let mut out = reset(env.as_mut());
    let mut action = [0f32];
    for _ in 0..89 {
        law.act(&out.observation, &mut [], &mut action);
        env.step(&action, out.data()).unwrap();
    }
    // The damping ratio is 10 / (2 sqrt(40)) = 0.79: after 1.8 s the swing is gone.
    assert!(out.reward[0] > 0.999, "{}", out.reward[0]);
    let pendulum = make(SPIN, 1, json!({}));
    let refusal = registry::make("damper", &Target::from(pendulum.spec())).err().expect("refused");
    assert!(refusal.to_string().contains("'bead'"), "{refusal}");
    let refusal = registry::make("lqr", &Target::from(env.spec())).err().expect("refused");
    assert!(refusal.to_string().contains("damper"), "{refusal}");
}

#[test]
fn its_picture_shows_a_bead() {
    let mut env = make(BEAD, 1, json!({}));
    reset(env.as_mut());
    let scene = env.scene(0).unwrap();
    let size = drawing("bead").unwrap().size;
    let picture = render(&scene, size).unwrap();
    let colours: std::collections::HashSet<&[u8]> = picture.chunks(3).collect();
    assert!(colours.contains(&[0x9C, 0x2F, 0x73][..]), "the bead's colour");
}

#[test]
fn a_new_task_of_the_pendulum_scores_shows_and_reports() {
    let mut env = make(SPIN, 8, json!({}));
    let mut out = reset(env.as_mut());
    let spec = env.spec().clone();
    assert_eq!(spec.observation.size(), 19);
    assert_eq!(spec.metrics, ["tip_height", "upright_error", "torque", "base_rate"]);
    for _ in 0..5 {
        env.step(&[0.5; 8], out.data()).unwrap();
    }
    assert_eq!(out.observation[18], 0.5);
    let k = spec.reward_terms.len() + spec.metrics.len();
    assert_eq!(out.reward[0], out.terms[0]);
    assert!((out.terms[0] - (0.1 * out.terms[k - 1]).clamp(-1.0, 1.0)).abs() < 1e-15);
    assert!(out.reward[0] > 0.0);
}

/// The page is what was built: every block of it that names a file of this crate is that file.
#[test]
fn the_page_shows_the_files_of_this_crate() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/src");
    let page = std::fs::read_to_string(format!("{root}/../../../docs/extending.md")).unwrap();
    let mut shown = Vec::new();
    for block in page.split("```rust\n// ").skip(1) {
        let (name, text) = block.split_once('\n').expect("a first line with the name");
        let (text, _) = text.split_once("```").expect("an end");
        let file = std::fs::read_to_string(format!("{root}/{name}")).expect(name);
        assert_eq!(text, file, "{name}");
        shown.push(name.to_owned());
    }
    let mut files: Vec<String> = std::fs::read_dir(root)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    shown.sort();
    assert_eq!(shown, files);
}
