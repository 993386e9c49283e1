//! The promise of the default steps, over a part of the grid of `docs/performance/accuracy.md`, and the orders of the
//! schemes behind it.

use rodgym_core::catalog::{MakeOptions, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer};
use rodgym_core::pendulum::accuracy::{CONTRACT, choose, error};
use rodgym_core::pendulum::{BarePendulum, Config, Setup};
use rodgym_core::seed::Stream;
use rodgym_core::simulation::Simulation;
use rodgym_core::solver::Scheme;
use serde_json::{Map, Value, json};

fn map(value: &Value) -> Map<String, Value> {
    value.as_object().expect("a dictionary").clone()
}

/// A rod at rest, horizontal.
fn horizontal(given: &Value) -> BarePendulum {
    let mut rod = BarePendulum::new(&map(given)).unwrap_or_else(|e| panic!("{given}: {e}"));
    let edges = rod.nodes() - 1;
    rod.set_angles(&vec![std::f64::consts::FRAC_PI_2; edges], &vec![0.0; edges]).unwrap();
    rod
}

fn swing(rod: &mut BarePendulum, seconds: f64) -> [f64; 2] {
    rod.step(0.0, (seconds / rod.physics_dt()).round() as u64).unwrap();
    *rod.state().positions.last().unwrap()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Where the tip is after 1 s of small steps: those of ESDIRK3, of third order.
fn converged(rod: &Value) -> [f64; 2] {
    let mut fine = map(rod);
    fine.insert("stepper".into(), json!("esdirk3"));
    fine.insert("physics_dt".into(), json!(1e-4));
    swing(&mut horizontal(&Value::Object(fine)), 1.0)
}

#[test]
fn default_steps_keep_the_promise() {
    let mut worst: f64 = 0.0;
    for nodes in [2, 7, 13, 31] {
        for (modulus, width, length) in [
            (1e7, 0.007, 0.3),
            (3e6, 0.011, 0.25),
            (1e8, 0.009, 0.3),
            (1e9, 0.007, 0.3),
            (1e9, 0.003, 0.6),
            (3e8, 0.02, 0.1),
            (2e11, 0.007, 0.3),
            (7e10, 0.004, 1.0),
        ] {
            for damping in [0.0, 5e-4] {
                let rod = json!({"nodes": nodes, "youngs_modulus": modulus, "width": width, "length": length,
                                 "bending_damping": damping});
                let off = distance(swing(&mut horizontal(&rod), 1.0), converged(&rod)) / length;
                assert!(off < CONTRACT, "{rod}: {off:.1e}");
                worst = worst.max(off);
            }
        }
    }
    // Steps are not smaller than they must be, either.
    assert!(worst > 0.3 * CONTRACT, "{worst:.1e}");
}

#[test]
fn default_steps_keep_the_energy() {
    for (modulus, width) in [(1e7, 0.007), (1e8, 0.004), (1e9, 0.007), (2e11, 0.007)] {
        let rod = json!({"youngs_modulus": modulus, "width": width, "bending_damping": 0.0});
        let mut rod = horizontal(&rod);
        swing(&mut rod, 10.0);
        let energy: f64 = rod.energies().iter().map(|(_, joule)| joule).sum();
        // At the start it is 0; hanging it is -m g L/2.
        let swing = 1500.0 * width * width * 0.3 * 9.81 * 0.15;
        assert!(energy.abs() < 0.01 * swing, "{modulus} {width}: {}", energy / swing);
    }
}

#[test]
fn schemes_have_their_orders() {
    let rod = json!({"bending_damping": 0.0});
    let end = converged(&rod);
    for (scheme, order, constant) in [("tr_bdf2", 4.0, 5e-6), ("esdirk3", 8.0, 1e-6)] {
        let off = |dt: f64| {
            let mut given = map(&rod);
            given.insert("stepper".into(), json!(scheme));
            given.insert("physics_dt".into(), json!(dt));
            distance(swing(&mut horizontal(&Value::Object(given)), 1.0), end)
        };
        let (long, short) = (off(1e-3), off(5e-4));
        assert!(long < constant, "{scheme}: {long:.1e} m at 1 ms");
        assert!((0.6..1.6).contains(&(long / short / order)), "{scheme}: {}", long / short);
    }
}

#[test]
fn a_torque_that_jumps_costs_no_accuracy() {
    // Stages that remember the torque before the jump would be off by half a step of it: 1e-3.
    let end = |stepper: &str, dt: f64| {
        let given = json!({"stepper": stepper, "physics_dt": dt, "youngs_modulus": 1e9});
        let mut rod = BarePendulum::new(&map(&given)).unwrap();
        for k in 0..50 {
            let torque = if k % 2 == 0 { 0.03 } else { -0.01 };
            rod.step(torque, (0.01 / dt).round() as u64).unwrap();
        }
        *rod.state().positions.last().unwrap()
    };
    let converged = end("esdirk3", 5e-5);
    for stepper in ["tr_bdf2", "esdirk3"] {
        let off = distance(end(stepper, 1e-3), converged);
        assert!(off < 3e-5, "{stepper}: {off:.1e} m");
    }
}

#[test]
fn feedback_within_a_step_is_that_of_smaller_steps() {
    let end = |stepper: &str, dt: f64| {
        let mut rod = horizontal(&json!({"stepper": stepper, "physics_dt": dt}));
        let mut gain = vec![0.0; 12];
        (gain[0], gain[6]) = (-0.02, -0.002);
        rod.step_feedback(0.01, &gain, (0.5 / dt).round() as u64).unwrap();
        *rod.state().positions.last().unwrap()
    };
    let converged = end("implicit", 5e-5);
    for stepper in ["bdf2", "tr_bdf2", "esdirk3"] {
        let off = distance(end(stepper, 5e-4), converged);
        assert!(off < 1e-5, "{stepper}: {off:.1e} m");
    }
}

#[test]
fn the_choice_is_as_documented() {
    let config = |given: Value| Config::new(&Setup::default(), &map(&given)).unwrap();
    let default = config(json!({}));
    assert_eq!((default.scheme, default.physics_dt), (Scheme::Verlet, 5e-4));
    assert!(default.error.unwrap() <= CONTRACT && default.warning().is_none());
    assert_eq!(config(json!({"youngs_modulus": 2e11})).scheme, Scheme::Esdirk3);
    assert_eq!(config(json!({"nodes": 101})).scheme, Scheme::Esdirk3);
    // A step that is asked for keeps the schemes that such steps have always had.
    assert_eq!(config(json!({"physics_dt": 2e-4})).scheme, Scheme::Verlet);
    assert_eq!(config(json!({"physics_dt": 1e-3})).scheme, Scheme::Implicit);
    // The worst rod of a range counts.
    let range = config(json!({"randomize": {"youngs_modulus": ["log_uniform", 1e7, 2e11]}}));
    assert_eq!(range.scheme, Scheme::Esdirk3);
    assert!(range.error.unwrap() <= CONTRACT);
    // A delay is a whole number of steps.
    let late = config(json!({"youngs_modulus": 2e11, "actuator_delay": 0.012}));
    assert_eq!(late.delay as f64 * late.physics_dt, 0.012);
    // A whip is out of reach, and the number says so.
    let whip = config(
        json!({"youngs_modulus": 1e5, "width": 0.002, "length": 1.0, "bending_damping": 0.0}),
    );
    assert!(whip.error.is_none_or(|error| error > CONTRACT));
    assert!(whip.warning().unwrap().contains("after 1 s of free swing"));
}

#[test]
fn the_estimate_goes_with_the_square_of_the_step() {
    let config = Config::new(&Setup::default(), &map(&json!({"youngs_modulus": 2e11}))).unwrap();
    let bounds: Vec<_> = config.draws.iter().map(|draw| draw.bounds()).collect();
    let of = |dt: f64| error(Scheme::Esdirk3, dt, config.nodes, &bounds).unwrap();
    assert!((of(2e-3) / of(1e-3) - 4.0).abs() < 1e-9);
    assert_eq!(error(Scheme::BackwardEuler, 1e-3, config.nodes, &bounds), None);
    for control_dt in [1e-3, 4e-3, 0.01, 0.02, 0.05] {
        let choice = choose(config.nodes, &bounds, 1e-9, control_dt);
        assert!(choice.error <= CONTRACT, "{control_dt}: {choice:?}");
    }
}

#[test]
fn a_verlet_that_is_not_stable_is_named() {
    let refused =
        |given: Value| Config::new(&Setup::default(), &map(&given)).unwrap_err().to_string();
    let text = refused(json!({"stepper": "verlet", "youngs_modulus": 1e9}));
    assert!(text.contains("stepper") && text.contains("a physics_dt of at most 6.1"), "{text}");
    let text = refused(json!({"stepper": "verlet", "physics_dt": 1e-3}));
    assert!(text.starts_with("physics_dt") || text.contains("physics_dt"), "{text}");
}

/// What random torques did to rods.
struct Shaken {
    /// Steps that the solver gave up.
    failures: usize,
    /// Mean mechanical energy above hanging, in the first and the second half of the time \[J\].
    energy: [f64; 2],
    /// The most that one rod had \[J\].
    most: f64,
}

/// Random torques at +-0.05 N m on sixty-four rods, in episodes of 5 s. (Nothing brakes a rod that turns as a whole: in
/// one long episode its energy grows without bound, as a walk at random does.)
fn shaken(kwargs: &Value, steps: usize) -> Shaken {
    const ENVS: usize = 64;
    let mut env = make(&MakeOptions {
        id: "rodgym/PendulumSwingUp-v0".into(),
        num_envs: ENVS,
        kwargs: map(kwargs),
        autoreset_mode: AutoresetMode::SameStep,
        max_episode_steps: Some(500),
        num_threads: 1,
    })
    .unwrap();
    let mut buffer = StepBuffer::new(&env.spec().clone(), ENVS);
    env.reset(&Seeds::Base(3), None, &ResetOptions::default(), buffer.data()).unwrap();
    let mut draws = Stream::new(5);
    let mut shaken = Shaken { failures: 0, energy: [0.0; 2], most: 0.0 };
    let rounds = steps / ENVS;
    let mut samples = [0.0; 2];
    for round in 0..rounds {
        let actions: Vec<f32> = (0..ENVS).map(|_| draws.uniform(-1.0, 1.0) as f32).collect();
        env.step(&actions, buffer.data()).unwrap();
        assert!(buffer.reward.iter().all(|x| x.is_finite()));
        assert!(buffer.observation.iter().all(|x| x.is_finite()));
        // What the solver gives up ends the episode.
        for i in 0..ENVS {
            assert!(buffer.truncated[i] || !buffer.solver_failure[i]);
        }
        shaken.failures += buffer.solver_failure.iter().filter(|&&failed| failed).count();
        if round % 20 == 0 {
            let half = usize::from(2 * round >= rounds);
            for i in 0..ENVS {
                let energy: f64 =
                    env.simulation(i).unwrap().energies().iter().map(|(_, joule)| joule).sum();
                let p = env.parameters(i).unwrap();
                let (width, length, density, gravity) = (p[0], p[1], p[2], p[6]);
                let energy = energy + 0.5 * density * width * width * length * length * gravity;
                shaken.energy[half] += energy;
                shaken.most = shaken.most.max(energy);
                samples[half] += 1.0;
            }
        }
    }
    (0..2).for_each(|half| shaken.energy[half] /= samples[half]);
    shaken
}

fn ordinary() -> Value {
    json!({"randomize": {"youngs_modulus": [5e6, 2e7], "width": [0.005, 0.009]}})
}

fn assert_calm(shaken: &Shaken) {
    assert_eq!(shaken.failures, 0);
    let [first, second] = shaken.energy;
    assert!(0.5 * first < second && second < 1.5 * first, "{:?}", shaken.energy);
    assert!(shaken.most < 3.0, "{}", shaken.most);
}

#[test]
fn random_torques_break_no_ordinary_rod() {
    assert_calm(&shaken(&ordinary(), 64_000));
}

/// `make soak-pendulum`. (Failures of whips are counted and told; that no number is wrong is asserted in `shaken`.)
#[test]
#[ignore = "long: a million steps of each"]
fn a_million_random_torques() {
    let tell = |what: &str, found: &Shaken| {
        let Shaken { failures, energy: [first, second], most } = found;
        println!(
            "{what} rods: {failures} failures; mean energy {first:.3} J, then {second:.3} J; at most {most:.2} J"
        );
    };
    let found = shaken(&ordinary(), 1_000_000);
    tell("ordinary", &found);
    assert_calm(&found);
    for (what, modulus, width) in [
        ("soft", [1e6, 5e6], [0.005, 0.009]),
        ("thin", [5e6, 2e7], [0.002, 0.005]),
        ("soft and thin", [1e5, 5e6], [0.002, 0.005]),
    ] {
        let rods = json!({"randomize": {"youngs_modulus": modulus, "width": width}});
        tell(what, &shaken(&rods, 1_000_000));
    }
}
