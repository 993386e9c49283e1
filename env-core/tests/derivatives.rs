//! Derivatives of steps are those of small differences of the steps themselves, for every scheme, every number of the
//! state, the torque and every parameter.

mod differences;

use differences::{column, distance, slope};
use rodgym_core::pendulum::BarePendulum;
use rodgym_core::seed::Stream;
use rodgym_core::simulation::Simulation;
use rodgym_core::solver::Move;
use rodgym_core::watch::Watch;
use serde_json::{Map, Value, json};

const STEPPERS: [&str; 6] = ["verlet", "backward_euler", "implicit", "bdf2", "tr_bdf2", "esdirk3"];
const PARAMETERS: [&str; 7] =
    ["width", "length", "density", "youngs_modulus", "damping", "bending_damping", "gravity"];
const TORQUE: f64 = 0.03;

fn keywords(stepper: &str, nodes: usize, dt: f64) -> Map<String, Value> {
    // (A soft, thick rod with much damping: of a stiff one differences are lost in the last digits of the stretching.)
    let given = json!({
        "stepper": stepper,
        "nodes": nodes,
        "physics_dt": dt,
        "youngs_modulus": 1e5,
        "width": 0.02,
        "damping": 0.1,
        "bending_damping": 0.1,
    });
    given.as_object().cloned().expect("an object")
}

/// Steps whose Newton iteration goes on to the last digits, so that differences of them mean something.
fn sharp(given: &Map<String, Value>) -> BarePendulum {
    let mut rod = BarePendulum::new(given).expect("keywords are allowed");
    rod.sharpen(1e-6);
    rod
}

/// A bent rod in fast motion, some steps after its start.
fn moving(given: &Map<String, Value>, seed: u64) -> BarePendulum {
    let (mut rod, mut stream) = (sharp(given), Stream::new(seed));
    let edges = rod.nodes() - 1;
    let angle = stream.uniform(-3.0, 3.0);
    let angles: Vec<f64> = (0..edges).map(|_| angle + stream.uniform(-0.3, 0.3)).collect();
    let rates: Vec<f64> = (0..edges).map(|_| stream.uniform(-10.0, 10.0)).collect();
    rod.set_angles(&angles, &rates).expect("it has these edges");
    rod.step(-0.02, 3).expect("it steps");
    rod
}

/// Checks all columns; returns the largest distance.
fn check(given: &Map<String, Value>, rod: &BarePendulum, n: u64) -> f64 {
    let names: Vec<String> = PARAMETERS.map(String::from).to_vec();
    let all = rod.jacobian(TORQUE, n, &names, Watch::nobody()).expect("it steps");
    let [a, b, p] = &all[..] else { panic!("three matrices") };
    let state = rod.vector().expect("it has one");
    let nodes = rod.nodes() - 1;
    let after = |mut rod: BarePendulum, state: &[f64], torque: f64| {
        rod.set_vector(state).expect("it is a state");
        rod.step(torque, n).expect("it steps");
        rod.vector().expect("it has one")
    };
    let mut worst = 0.0f64;
    // Differences over too long a way miss what is curved, over too short a way they are lost in the last digits: the
    // best of four.
    let mut note = |what: String, exact: Vec<f64>, h: f64, at: &dyn Fn(f64) -> Vec<f64>| {
        let off = [0.04, 0.2, 1.0, 4.5].map(|share| distance(&exact, &slope(share * h, at)));
        let off = off.into_iter().fold(f64::INFINITY, f64::min);
        assert!(off < 1e-8, "{given:?}: {what} is off by {off:.1e}");
        worst = worst.max(off);
    };
    let looks_back = given["stepper"] == "bdf2";
    for j in 0..state.len() - usize::from(looks_back) {
        // Positions, velocities, then accelerations or what was a step before.
        let h = match (j / (2 * nodes), looks_back) {
            (0, _) | (2, true) => 4e-4,
            (1, _) | (3, true) => 0.5,
            _ => 100.0,
        };
        note(format!("column {j} of A"), column(a, j), h, &|h| {
            let mut state = state.clone();
            state[j] += h;
            after(rod.clone(), &state, TORQUE)
        });
    }
    note("B".into(), column(b, 0), 0.1, &|h| after(rod.clone(), &state, TORQUE + h));
    let values = rod.parameters();
    for (j, name) in PARAMETERS.iter().enumerate() {
        let value = values[j].1;
        assert_eq!(values[j].0, *name);
        // (Forces are linear in the last three.)
        let share = if j < 4 { 0.06 } else { 0.2 };
        note(name.to_string(), column(p, j), share * value, &|h| {
            let mut given = given.clone();
            given.insert((*name).into(), json!(value + h));
            after(sharp(&given), &state, TORQUE)
        });
    }
    worst
}

/// More steps than a tape holds at once are as good as few: the chain rule over two halves.
#[test]
fn many_steps_are_those_of_their_parts() {
    for stepper in STEPPERS {
        let given = keywords(stepper, 4, 1e-4);
        let mut rod = moving(&given, 5);
        let names = ["youngs_modulus".into()];
        let go = |rod: &BarePendulum, n| rod.jacobian(TORQUE, n, &names, Watch::nobody());
        let whole = go(&rod, 150).expect("it steps");
        let first = go(&rod, 60).expect("it steps");
        rod.step(TORQUE, 60).expect("it steps");
        let second = go(&rod, 90).expect("it steps");
        let s = first[0].shape[0];
        for k in 0..3 {
            let columns = whole[k].shape[1];
            for j in 0..columns {
                let (own, through) = (column(&second[k], j), column(&first[k], j));
                let chained: Vec<f64> = (0..s)
                    .map(|i| {
                        let row = &second[0].values[i * s..(i + 1) * s];
                        let carried: f64 = row.iter().zip(&through).map(|(a, b)| a * b).sum();
                        carried + if k == 0 { 0.0 } else { own[i] }
                    })
                    .collect();
                let off = distance(&column(&whole[k], j), &chained);
                assert!(off < 1e-9, "{stepper}, matrix {k}, column {j}: {off:.1e}");
            }
        }
    }
}

/// Backwards and forwards are one matrix: `<v, J u> = <J' v, u>`.
#[test]
fn the_way_back_is_the_transpose() {
    for stepper in STEPPERS {
        for (nodes, n) in [(2, 3), (7, 8), (12, 130)] {
            let dt = if stepper == "verlet" { 1e-5 } else { 1e-3 };
            let given = keywords(stepper, nodes, dt);
            let rod = moving(&given, 11);
            let names: Vec<String> = PARAMETERS.map(String::from).to_vec();
            let there = rod.jacobian(TORQUE, n, &names, Watch::nobody()).expect("it steps");
            let (s, mut stream) = (there[0].shape[0], Stream::new(2));
            let v: Vec<f64> = (0..s).map(|_| stream.uniform(-1.0, 1.0)).collect();
            let back = rod.pull_back(TORQUE, n, &names, &v).expect("it steps");
            for (matrix, row) in there.iter().zip(&back) {
                let (mut forwards, mut backwards, mut size) = (0.0, 0.0, 0.0);
                for (j, found) in row.values.iter().enumerate() {
                    let u = stream.uniform(-1.0, 1.0);
                    for (a, v) in column(matrix, j).into_iter().zip(&v) {
                        forwards += v * a * u;
                        size += (v * a * u).abs();
                    }
                    backwards += found * u;
                }
                let off = (forwards - backwards).abs() / size;
                assert!(off <= 1e-12, "{stepper}, {nodes} nodes: {} {off:.1e}", matrix.name);
            }
        }
    }
}

/// Derivatives are those of the way that was taken, also where a step is taken in smaller parts.
#[test]
fn smaller_parts_have_derivatives_too() {
    for (stepper, dt) in [
        ("backward_euler", 0.02),
        ("implicit", 0.02),
        ("bdf2", 0.02),
        ("tr_bdf2", 0.02),
        ("esdirk3", 0.02),
    ] {
        let given = keywords(stepper, 5, dt);
        let (mut stream, mut in_parts) = (Stream::new(3), 0);
        for _ in 0..60 {
            let mut rod = sharp(&given);
            let angles: Vec<f64> = (0..4).map(|_| stream.uniform(-1.0, 1.0)).collect();
            let rates: Vec<f64> = (0..4).map(|_| stream.uniform(-500.0, 500.0)).collect();
            rod.set_angles(&angles, &rates).expect("it has these edges");
            let Ok(all) = rod.jacobian(TORQUE, 1, &[], Watch::nobody()) else { continue };
            let state = rod.vector().expect("it has one");
            let at = |h: f64| {
                let mut rod = rod.clone();
                rod.set_vector(&state).expect("it is a state");
                rod.step(TORQUE + h, 1).expect("it steps");
                rod.vector().expect("it has one")
            };
            let (wide, narrow) = (slope(1e-4, &at), slope(2e-5, &at));
            // Whether parts are needed is no smooth function: nothing is to be compared where that changes.
            if distance(&narrow, &wide) > 1e-5 {
                continue;
            }
            in_parts += usize::from(takes_parts(&rod));
            let off = distance(&column(&all[1], 0), &narrow);
            assert!(off < 1e-5, "{stepper}: off by {off:.1e}");
        }
        assert!(in_parts > 0, "{stepper}: none of 60 in parts");
        println!("{stepper}: {in_parts} of 60 in parts");
    }
}

/// Whether the next step is taken in smaller parts: the moments of its tape say how large they are.
fn takes_parts(rod: &BarePendulum) -> bool {
    let dt = rod.physics_dt();
    let tape = rod.tape(TORQUE, 1).expect("it steps");
    tape.moves().iter().any(|way| match way {
        Move::Verlet(size) => *size < dt,
        Move::Stage { stage, .. } => stage.dt < dt,
    })
}

#[test]
fn straight_rods_at_rest_have_finite_derivatives() {
    for stepper in STEPPERS {
        for angle in [0.0, std::f64::consts::PI, std::f64::consts::FRAC_PI_2] {
            let given = json!({"stepper": stepper, "physics_dt": 2e-4});
            let mut rod = BarePendulum::new(given.as_object().expect("one")).expect("allowed");
            rod.set_angles(&[angle; 6], &[0.0; 6]).expect("it has these edges");
            let names: Vec<String> = PARAMETERS.map(String::from).to_vec();
            for matrix in rod.jacobian(0.0, 5, &names, Watch::nobody()).expect("it steps") {
                assert!(matrix.values.iter().all(|x| x.is_finite()), "{stepper}, {angle}");
            }
        }
    }
}

#[test]
fn a_vector_is_the_whole_state() {
    for stepper in STEPPERS {
        let given = keywords(stepper, 4, 1e-3);
        let rod = moving(&given, 1);
        let vector = rod.vector().expect("it has one");
        let mut twin = BarePendulum::new(&given).expect("allowed");
        twin.set_vector(&vector).expect("it is a state");
        assert_eq!(twin.vector().expect("it has one"), vector, "{stepper}");
        let mut other = rod.clone();
        for rod in [&mut twin, &mut other] {
            rod.sharpen(1e-6);
            rod.step(TORQUE, 5).expect("it steps");
        }
        let off = distance(&other.vector().expect("one"), &twin.vector().expect("one"));
        assert!(off < 1e-9, "{stepper}: {off:.1e}");
        for (bad, words) in [(vec![0.0; 3], "(3,)"), (vec![0.0; vector.len()], "neighbouring")] {
            let error = twin.set_vector(&bad).expect_err("no state").to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}

#[test]
fn all_columns_of_many_nodes() {
    for stepper in STEPPERS {
        for (nodes, seed) in [(16, 1), (31, 2)] {
            let given = keywords(stepper, nodes, if stepper == "verlet" { 1e-6 } else { 2e-3 });
            let off = check(&given, &moving(&given, seed), 4);
            println!("{stepper}, {nodes} nodes: {off:.1e}");
        }
    }
}

#[test]
fn all_columns_are_those_of_small_differences() {
    for stepper in STEPPERS {
        for nodes in [2, 3, 7] {
            let dt = if stepper == "verlet" { 1e-4 } else { 4e-3 };
            let given = keywords(stepper, nodes, dt);
            let off = check(&given, &moving(&given, nodes as u64), 8);
            println!("{stepper}, {nodes} nodes: {off:.1e}");
        }
    }
}
