//! The thesis' controllers to the letter, run inside the implicit step.

use crate::baselines::raise_baseline;
use crate::convert::keywords;
use crate::errors::{OrRaise, to_py};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rodgym_baselines::Error;
use rodgym_baselines::pendulum::{ProcessNoise, RodDesign, ThesisDesign, ThesisRun};
use rodgym_caught::caught;
use rodgym_core::pendulum::BarePendulum;
use rodgym_core::simulation::Simulation;
use serde_json::json;

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(thesis_run, module)?)
}

/// What a run leaves behind, one entry a sample.
#[derive(Default)]
struct Record {
    time: Vec<f64>,
    torque: Vec<f64>,
    linear: Vec<bool>,
    angles: Vec<f64>,
    rates: Vec<f64>,
    estimate: Vec<f64>,
    positions: Vec<f64>,
}

/// Runs thesis chapter 4 from hanging at rest: swing-up, switch at 60 degrees, linear law solved inside
/// the implicit step. `feedback` is "state" or "output"; `process_noise` is "torque" or "state", the
/// two readings of Q_n; an observer that `latches` stays on beyond 60 degrees. Samples every `every` steps.
///
/// Returns a dictionary of arrays with T samples: `time` [s], `torque` [N m], `linear` (the law
/// acted), `angles` and `rates` (T, edges), `estimate` of z (T, 2 edges; NaN while the observer is off),
/// `positions` (T, nodes, 2); and `lost`, whether the solver gave up before the end.
#[caught]
#[pyfunction]
#[pyo3(signature = (rod, feedback="state", duration=3.0, every=10, process_noise="torque", latches=false))]
fn thesis_run<'py>(
    py: Python<'py>,
    rod: &Bound<'py, PyAny>,
    feedback: &str,
    duration: f64,
    every: usize,
    process_noise: &str,
    latches: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let refuse = |name: &str, value: &str, allowed: &str| {
        Err(to_py(rodgym_core::Error::parameter(name, value, allowed)))
    };
    let observes = match feedback {
        "state" => false,
        "output" => true,
        _ => return refuse("feedback", &format!("'{feedback}'"), "'state' or 'output'"),
    };
    let noise = match process_noise {
        "torque" => ProcessNoise::Torque,
        "state" => ProcessNoise::State,
        _ => return refuse("process_noise", &format!("'{process_noise}'"), "'torque' or 'state'"),
    };
    if !(0.0..=600.0).contains(&duration) {
        return refuse("duration", &duration.to_string(), "from 0 to 600 s");
    }
    if every == 0 {
        return refuse("every", "0", "1 or more");
    }
    let mut keywords = keywords(rod)?;
    keywords.entry("thesis").or_insert(json!(true));
    let mut sim = BarePendulum::new(&keywords).or_raise()?;
    let design = RodDesign::from_config(&sim.resolved())
        .and_then(|rod| ThesisDesign::new(&rod, noise))
        .map_err(raise_baseline)?;
    let steps = (duration / sim.physics_dt()).round() as usize;
    let (record, lost) = py
        .detach(|| record(&mut sim, ThesisRun::new(design, observes, latches), steps, every))
        .map_err(raise_baseline)?;
    let (samples, nodes) = (record.time.len(), sim.nodes());
    let edges = nodes - 1;
    let out = PyDict::new(py);
    let matrix = |values: Vec<f64>, columns: usize| {
        PyArray1::from_vec(py, values).reshape([samples, columns])
    };
    out.set_item("time", PyArray1::from_vec(py, record.time))?;
    out.set_item("torque", PyArray1::from_vec(py, record.torque))?;
    out.set_item("linear", PyArray1::from_vec(py, record.linear))?;
    out.set_item("angles", matrix(record.angles, edges)?)?;
    out.set_item("rates", matrix(record.rates, edges)?)?;
    out.set_item("estimate", matrix(record.estimate, 2 * edges)?)?;
    let positions = PyArray1::from_vec(py, record.positions).reshape([samples, nodes, 2])?;
    out.set_item("positions", positions)?;
    out.set_item("lost", lost)?;
    Ok(out)
}

/// Steps until the end or until the solver gives up.
fn record(
    sim: &mut BarePendulum,
    mut run: ThesisRun,
    steps: usize,
    every: usize,
) -> rodgym_baselines::Result<(Record, bool)> {
    let mut record = Record::default();
    for k in 0..steps {
        let step = match run.step(sim) {
            Ok(step) => step,
            Err(Error::Core(rodgym_core::Error::Solver { .. })) => return Ok((record, true)),
            Err(error) => return Err(error),
        };
        if (k + 1) % every == 0 {
            let missing = vec![f64::NAN; 2 * (sim.nodes() - 1)];
            record.time.push(sim.time());
            record.torque.push(step.torque);
            record.linear.push(step.linear);
            record.angles.extend(sim.angles());
            record.rates.extend(sim.rates());
            record.estimate.extend(if step.estimate.is_empty() { missing } else { step.estimate });
            record.positions.extend(sim.state().positions.into_iter().flatten());
        }
    }
    Ok((record, false))
}
