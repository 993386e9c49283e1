//! `Controller`: a classical controller of the crate rodgym-baselines, as NumPy sees it.

use crate::arguments::repr;
use crate::arrays;
use crate::convert::{serialize, to_map, to_python};
use crate::errors::{raise, to_py};
use numpy::{Ix1, Ix2, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use rodgym_baselines::registry::{self, Target};
use rodgym_baselines::saved::{self, Saved};
use rodgym_baselines::{Controller as Law, Error};
use rodgym_caught::caught;
use serde_json::Value;

/// Adds this file's classes and functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Controller>()?;
    module.add_function(wrap_pyfunction!(controllers, module)?)
}

/// Name and machine of every controller.
#[caught]
#[pyfunction]
fn controllers() -> PyResult<Vec<(&'static str, &'static str)>> {
    Ok(registry::entries().iter().map(|entry| (entry.name, entry.machine)).collect())
}

/// An error of the crate as a Python exception.
pub fn raise_baseline(error: Error) -> PyErr {
    let message = error.to_string();
    match error {
        Error::Core(error) => to_py(error),
        Error::Shape { .. } => raise("ShapeError", message),
        Error::Saved { .. } => raise("SnapshotError", message),
        Error::NoSolution { .. } | Error::Inaccurate { .. } => raise("DesignError", message),
        Error::Parameter { .. } | Error::Unsuitable { .. } => raise("ParameterError", message),
    }
}

/// Actions (n, a) and the next state (n, s).
type Answer<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f64>>);

/// A control law made for an environment: one of `controllers`, and the environment's spec.
#[pyclass(module = "rodgym._native", frozen)]
pub struct Controller {
    name: String,
    target: Target,
    law: Box<dyn Law>,
}

#[caught]
#[pymethods]
impl Controller {
    #[new]
    fn new(py: Python<'_>, name: String, spec: &Bound<'_, PyDict>) -> PyResult<Self> {
        let target: Target =
            serde_json::from_value(Value::Object(to_map(spec)?)).map_err(|error| {
                to_py(rodgym_core::Error::parameter("spec", error, "an environment's"))
            })?;
        let law = py.detach(|| registry::make(&name, &target)).map_err(raise_baseline)?;
        Ok(Controller { name, target, law })
    }

    /// The controller of a file that `save` made.
    #[staticmethod]
    fn load(py: Python<'_>, data: &Bound<'_, PyAny>) -> PyResult<Self> {
        let data: Vec<u8> = data.extract().map_err(|_| {
            let allowed = "the bytes that save wrote";
            to_py(rodgym_core::Error::parameter("data", repr(data), allowed))
        })?;
        let Saved { name, target, law } =
            py.detach(|| saved::decode(&data)).map_err(raise_baseline)?;
        Ok(Controller { name, target, law })
    }

    /// Every number of its design, for `load`, and for programs in other languages.
    fn save<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = saved::encode(&self.name, &self.target, &*self.law).map_err(raise_baseline)?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Names of the physical parameters among the environment's keywords.
    #[getter]
    fn physical(&self) -> PyResult<Vec<&str>> {
        Ok(self.target.parameters.iter().map(|one| one.name.as_str()).collect())
    }

    /// One of `controllers`.
    #[getter]
    fn name(&self) -> PyResult<&str> {
        Ok(self.name.as_str())
    }

    /// The environment's keywords, as it was designed for.
    #[getter]
    fn config<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &Value::Object(self.target.config.clone()))
    }

    /// Length of an observation.
    #[getter]
    fn observation_size(&self) -> PyResult<usize> {
        Ok(self.law.observation_size())
    }

    /// Length of an action.
    #[getter]
    fn action_size(&self) -> PyResult<usize> {
        Ok(self.law.action_size())
    }

    /// What the design settled on, by name.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, value) in self.law.parameters() {
            dict.set_item(name, value)?;
        }
        Ok(dict)
    }

    /// Numbers that it remembers of each environment.
    #[getter]
    fn state_size(&self) -> PyResult<usize> {
        Ok(self.law.state_size())
    }

    /// What a state (n, s) says of the machine: for each quantity its unit, and value, low and high of every row (n, 3).
    fn estimate<'py>(
        &self,
        py: Python<'py>,
        state: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let state = arrays::read::<f64, Ix2>("state", state)?;
        let (n, s) = (state.shape()[0], self.law.state_size());
        if state.shape()[1] != s {
            let message = format!("state has shape {:?}, but (n, {s}) is needed", state.shape());
            return Err(raise("ShapeError", message));
        }
        let state: Vec<f64> = state.as_array().iter().copied().collect();
        let mut told: Vec<(&str, &str, Vec<f64>)> = Vec::new();
        for row in 0..n {
            let mut i = 0;
            self.law.estimate(&state[row * s..(row + 1) * s], &mut |quantity| {
                if row == 0 {
                    told.push((quantity.name, quantity.unit, Vec::with_capacity(3 * n)));
                }
                told[i].2.extend([quantity.value, quantity.low, quantity.high]);
                i += 1;
            });
        }
        let dict = PyDict::new(py);
        for (name, unit, numbers) in told {
            dict.set_item(name, (unit, numpy::PyArray1::from_vec(py, numbers).reshape([n, 3])?))?;
        }
        Ok(dict)
    }

    /// Actions (n, a) float32 and the next state (n, s) from observations (n, d) float32, state (n, s)
    /// and the mask of episodes that begin (n).
    fn predict<'py>(
        &self,
        py: Python<'py>,
        observation: &Bound<'py, PyAny>,
        state: &Bound<'py, PyAny>,
        episode_start: &Bound<'py, PyAny>,
    ) -> PyResult<Answer<'py>> {
        let observation = arrays::read::<f32, Ix2>("observation", observation)?;
        let state = arrays::read::<f64, Ix2>("state", state)?;
        let episode_start = arrays::read::<bool, Ix1>("episode_start", episode_start)?;
        let n = episode_start.len();
        let (d, s) = (self.law.observation_size(), self.law.state_size());
        for (name, got, expected) in
            [("observation", observation.shape(), [n, d]), ("state", state.shape(), [n, s])]
        {
            if got != expected {
                let message = format!("{name} has shape {got:?}, but {expected:?} is needed");
                return Err(raise("ShapeError", message));
            }
        }
        let observation: Vec<f32> = observation.as_array().iter().copied().collect();
        let mut next: Vec<f64> = state.as_array().iter().copied().collect();
        let start = episode_start.as_array().to_vec();
        let mut actions = vec![0.0; n * self.law.action_size()];
        py.detach(|| self.law.predict(&observation, &mut next, &start, &mut actions))
            .map_err(raise_baseline)?;
        let actions =
            numpy::PyArray1::from_vec(py, actions).reshape([n, self.law.action_size()])?;
        Ok((actions, numpy::PyArray1::from_vec(py, next).reshape([n, s])?))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let (py, this) = (slf.py(), slf.get());
        let spec = serialize(py, &this.target)?;
        let arguments = (&this.name, spec);
        (slf.get_type(), arguments).into_pyobject(py)
    }

    fn __repr__(&self) -> PyResult<String> {
        Ok(format!("Controller({:?})", self.name))
    }
}
