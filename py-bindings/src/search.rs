//! `Search`: the search for a trajectory of the crate rodgym-baselines, as `rodgym.optimal` drives it.

use crate::arrays;
use crate::baselines::raise_baseline;
use crate::batch::Batch;
use crate::errors::{OrRaise, to_py};
use crate::lock::Lock;
use numpy::{Ix1, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rodgym_baselines::ilqr::{self, Cost, Options, Quadratic, Status};
use rodgym_caught::caught;
use rodgym_core::Error;
use std::time::{Duration, Instant};

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Search>()
}

/// A search for the actions of `steps` control steps of environment `index` of a batch, from where it is; the batch
/// stays there. It begins with `actions` (t,); the horizon starts with `first` steps where none are given, and grows by
/// `more`. The cost is the reward, or squares: see `rodgym.optimal.Quadratic`.
#[pyclass(module = "rodgym._native", frozen)]
pub struct Search {
    inner: Lock<ilqr::Search>,
}

/// Target, weights of the state and of the action, weights of the last state.
type Weights<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, f64, Bound<'py, PyAny>);

fn numbers(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    Ok(arrays::read::<f64, Ix1>(name, given)?.as_array().to_vec())
}

#[caught]
#[pymethods]
impl Search {
    #[new]
    #[pyo3(signature = (batch, index, steps, actions, first=15, more=20, levels=0, quadratic=None))]
    #[expect(clippy::too_many_arguments, reason = "all of them are keywords of Python")]
    fn new(
        py: Python<'_>,
        batch: &Bound<'_, Batch>,
        index: usize,
        steps: usize,
        actions: &Bound<'_, PyAny>,
        first: usize,
        more: usize,
        levels: u32,
        quadratic: Option<Weights<'_>>,
    ) -> PyResult<Self> {
        let actions = numbers("actions", actions)?;
        let cost = match quadratic {
            None => Cost::Own,
            Some((target, state, action, last)) => Cost::Quadratic(Quadratic {
                target: numbers("target", &target)?,
                state: numbers("state", &state)?,
                action,
                last: numbers("last", &last)?,
            }),
        };
        let start = batch.get().rehearsal(py, index)?;
        let options = Options { first, more, levels, ..Options::default() };
        let search = py
            .detach(|| ilqr::Search::new(start, cost, steps, &actions, options))
            .map_err(raise_baseline)?;
        Ok(Search { inner: Lock::new("search", search) })
    }

    /// Iterates until it is done or `seconds` are over, once at least. Says where it stands: `horizon`, `iterations`,
    /// `loss` of the horizon, `done`.
    fn iterate<'py>(&self, py: Python<'py>, seconds: f64) -> PyResult<Bound<'py, PyDict>> {
        let Ok(time) = Duration::try_from_secs_f64(seconds) else {
            return Err(to_py(Error::parameter("seconds", seconds, "at least 0, and finite")));
        };
        let mut guard = self.inner.lock(py)?;
        let search = &mut *guard;
        let status = py.detach(move || {
            let end = Instant::now() + time;
            loop {
                let status = search.iterate()?;
                if status.done || Instant::now() >= end {
                    return Ok(status);
                }
            }
        });
        let Status { horizon, iterations, loss, done } = status.map_err(raise_baseline)?;
        let dict = PyDict::new(py);
        dict.set_item("horizon", horizon)?;
        dict.set_item("iterations", iterations)?;
        dict.set_item("loss", loss)?;
        dict.set_item("done", done)?;
        Ok(dict)
    }

    /// The actions of the present horizon (t,), as single precision has them.
    #[getter]
    fn actions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let guard = self.inner.lock(py)?;
        Ok(PyArray1::from_slice(py, guard.actions()))
    }

    /// Their rewards (t,).
    #[getter]
    fn rewards<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let guard = self.inner.lock(py)?;
        Ok(PyArray1::from_slice(py, guard.rewards()))
    }
}

impl Batch {
    /// Environment `index`, to try actions on.
    fn rehearsal(
        &self,
        py: Python<'_>,
        index: usize,
    ) -> PyResult<Box<dyn rodgym_core::batch::Rehearsal>> {
        self.lock(py)?.env.rehearsal(index).or_raise()
    }
}
