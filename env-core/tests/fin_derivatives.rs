//! Derivatives of a fin's steps are those of small differences of the steps themselves, for every scheme and every model of
//! the water, every number of the state, the pitch and every parameter.

mod differences;

use differences::{column, distance, slope};
use rodgym_core::fin::{BareFin, Parameters};
use rodgym_core::seed::Stream;
use rodgym_core::simulation::Simulation;
use rodgym_core::solver::Move;
use rodgym_core::watch::Watch;
use serde_json::{Map, Value, json};

const STEPPERS: [&str; 2] = ["bdf2", "backward_euler"];
const WATERS: [&str; 4] = ["lighthill", "morison", "resistive", "air"];
const PITCH: f64 = 0.12;
const DT: f64 = 4e-3;

fn names() -> Vec<String> {
    Parameters::table().iter().map(|row| row.name.into()).collect()
}

fn keywords(stepper: &str, water: &str, swims: bool) -> Map<String, Value> {
    let mut given = json!({
        "stepper": stepper,
        "hydrodynamics": water,
        "physics_dt": DT,
        "damping": 0.1,
        "bending_damping": 0.01,
        "free_swimming": swims,
    });
    if !swims {
        given["flow_speed"] = json!(0.3);
    }
    given.as_object().cloned().expect("an object")
}

/// Steps whose Newton iteration goes on to the last digits, so that differences of them mean something.
fn sharp(given: &Map<String, Value>) -> BareFin {
    let mut fin = BareFin::from_keywords(given).expect("keywords are allowed");
    fin.sharpen(1e-6);
    fin
}

/// A fin that beats, some steps after its start.
fn moving(given: &Map<String, Value>, seed: u64) -> BareFin {
    let (mut fin, mut stream) = (sharp(given), Stream::new(seed));
    for step in 0..12 {
        let pitch = 0.3 * (f64::from(step) * 0.35).sin() + stream.uniform(-0.01, 0.01);
        fin.step(pitch, 1).expect("it steps");
    }
    fin.drive(0.1, 3).expect("it steps");
    if given["free_swimming"] == true {
        // A hull at speed: one that has just begun to swim hardly feels its drag.
        let mut state = fin.vector().expect("it has one");
        for first in [PLACES + 1, 2 * (PLACES + 1) + SPEEDS].into_iter().take(backs(given)) {
            state[first..first + SPEEDS].iter_mut().step_by(2).for_each(|u| *u -= 0.15);
        }
        fin.set_vector(&state).expect("it is a state");
    }
    fin
}

/// Numbers of a held fin's motion: positions and velocities.
const PLACES: usize = 14;
const SPEEDS: usize = 16;

/// How many motions a state has: now, and a step before.
fn backs(given: &Map<String, Value>) -> usize {
    1 + usize::from(given["stepper"] == "bdf2")
}

/// Checks all columns; returns the largest distance.
fn check(given: &Map<String, Value>, fin: &BareFin, n: u64) -> f64 {
    let names = names();
    let all = fin.jacobian(PITCH, n, &names, Watch::nobody()).expect("it steps");
    let [a, b, p] = &all[..] else { panic!("three matrices") };
    let state = fin.vector().expect("it has one");
    let after = |mut fin: BareFin, state: &[f64], pitch: f64| {
        fin.set_vector(state).expect("it is a state");
        fin.step(pitch, n).expect("it steps");
        fin.vector().expect("it has one")
    };
    let mut worst = 0.0f64;
    // Differences over too long a way miss what is curved, over too short a way they are lost in the last digits: the
    // best of five.
    let mut note = |what: String, exact: Vec<f64>, h: f64, at: &dyn Fn(f64) -> Vec<f64>| {
        let off = [0.003, 0.02, 0.1, 0.4, 1.0].map(|share| distance(&exact, &slope(share * h, at)));
        let off = off.into_iter().fold(f64::INFINITY, f64::min);
        assert!(off < 1e-7, "{given:?}: {what} is off by {off:.1e}");
        worst = worst.max(off);
    };
    let swims = given["free_swimming"] == true;
    let (places, speeds) = (PLACES + usize::from(swims), SPEEDS);
    for j in 0..state.len() - 12 {
        let motion = places + speeds;
        if j == 2 * motion {
            // (Whether the step before is known is no smooth number.)
            continue;
        }
        let h = if j % motion < places { 1e-3 } else { 0.3 };
        note(format!("column {j} of A"), column(a, j), h, &|h| {
            let mut state = state.clone();
            state[j] += h;
            after(fin.clone(), &state, PITCH)
        });
    }
    note("B".into(), column(b, 0), 0.05, &|h| after(fin.clone(), &state, PITCH + h));
    for (j, (name, value)) in fin.parameters().into_iter().enumerate() {
        if swims && name == "flow_speed" {
            continue;
        }
        // (Forces are linear in all but the density of the fin and the speed of the water.)
        let share = if name == "density" || name == "flow_speed" { 0.06 } else { 0.4 };
        note(name.to_string(), column(p, j), share * value, &|h| {
            let mut given = given.clone();
            given.insert(name.into(), json!(value + h));
            after(sharp(&given), &state, PITCH)
        });
    }
    worst
}

#[test]
fn all_columns_are_those_of_small_differences() {
    for stepper in STEPPERS {
        for water in WATERS {
            for swims in [false, true] {
                let given = keywords(stepper, water, swims);
                let off = check(&given, &moving(&given, 3), 3);
                println!("{stepper}, {water}, swims {swims}: {off:.1e}");
            }
        }
    }
}

/// Backwards and forwards are one matrix: `<v, J u> = <J' v, u>`.
#[test]
fn the_way_back_is_the_transpose() {
    for stepper in STEPPERS {
        for water in WATERS {
            for (swims, n) in [(false, 1), (true, 5), (false, 130)] {
                let given = keywords(stepper, water, swims);
                let fin = moving(&given, 11);
                let there = fin.jacobian(PITCH, n, &names(), Watch::nobody()).expect("it steps");
                let (s, mut stream) = (there[0].shape[0], Stream::new(2));
                let v: Vec<f64> = (0..s).map(|_| stream.uniform(-1.0, 1.0)).collect();
                let back = fin.pull_back(PITCH, n, &names(), &v).expect("it steps");
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
                    assert!(off <= 1e-12, "{stepper}, {water}, {n}: {} {off:.1e}", matrix.name);
                }
            }
        }
    }
}

/// Derivatives are those of the way that was taken, also where a step is taken in smaller parts.
#[test]
fn smaller_parts_have_derivatives_too() {
    for stepper in STEPPERS {
        let mut given = keywords(stepper, "lighthill", false);
        given.insert("physics_dt".into(), json!(0.04));
        let (mut stream, mut in_parts) = (Stream::new(3), 0);
        for _ in 0..40 {
            let mut fin = sharp(&given);
            for _ in 0..2 {
                // (A wild start: steps of which not all can be solved.)
                let _ = fin.step(stream.uniform(-0.5, 0.5), 1);
            }
            let pitch = stream.uniform(-2.5, 2.5);
            let Ok(all) = fin.jacobian(pitch, 1, &[], Watch::nobody()) else { continue };
            let state = fin.vector().expect("it has one");
            let at = |h: f64| {
                let mut fin = fin.clone();
                fin.set_vector(&state).expect("it is a state");
                fin.step(pitch + h, 1).expect("it steps");
                fin.vector().expect("it has one")
            };
            let (wide, narrow) = (slope(1e-4, &at), slope(2e-5, &at));
            // Whether parts are needed is no smooth function: nothing is to be compared where that changes.
            if distance(&narrow, &wide) > 1e-6 {
                continue;
            }
            let tape = fin.tape(pitch, 1).expect("it steps");
            let parts = |way: &Move| matches!(way, Move::Stage { stage, .. } if stage.dt < 0.04);
            in_parts += usize::from(tape.moves().iter().any(parts));
            let off = distance(&column(&all[1], 0), &narrow);
            assert!(off < 1e-6, "{stepper}: off by {off:.1e}");
        }
        assert!(in_parts > 0, "{stepper}: none of 40 in parts");
        println!("{stepper}: {in_parts} of 40 in parts");
    }
}

#[test]
fn straight_fins_at_rest_have_finite_derivatives() {
    for stepper in STEPPERS {
        for water in WATERS {
            for swims in [false, true] {
                let mut given = keywords(stepper, water, swims);
                given.remove("flow_speed");
                given.remove("damping");
                let fin = BareFin::from_keywords(&given).expect("allowed");
                for pitch in [0.0, 0.1] {
                    let all = fin.jacobian(pitch, 5, &names(), Watch::nobody()).expect("it steps");
                    for matrix in all {
                        let finite = matrix.values.iter().all(|x| x.is_finite());
                        assert!(finite, "{stepper}, {water}, {swims}: {}", matrix.name);
                    }
                }
            }
        }
    }
}
