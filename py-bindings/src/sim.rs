//! The bare machines, one at a time: `rodgym.sim`. One class for all of them.

use crate::arguments::{names, repr, rows};
use crate::arrays;
use crate::convert::{points, to_map, to_python};
use crate::errors::{OrRaise, to_py};
use crate::interrupt::{LOOK, watched};
use crate::lock::Lock;
use numpy::{Ix1, Ix2, PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use rodgym_caught::caught;
use rodgym_core::Error;
use rodgym_core::catalog;
use rodgym_core::simulation::{Named, Simulation as Machine};
use rodgym_core::watch::Watch;
use serde_json::Value;
use std::sync::MutexGuard;

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Simulation>()
}

/// Physics steps of a derivative that nobody has to be able to stop.
const AT_ONCE: u64 = 1000;

/// A bare machine without sensors, task or control step.
#[pyclass(module = "rodgym._native", frozen)]
pub struct Simulation(Lock<Box<dyn Machine>>);

#[caught]
#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (machine, kwargs=None))]
    fn new(machine: &str, kwargs: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let given = kwargs.map_or_else(|| Ok(Default::default()), to_map)?;
        Ok(Simulation::of(catalog::simulation(machine, &given).or_raise()?))
    }

    /// The word that the machine is looked up by.
    #[getter]
    fn machine(&self, py: Python<'_>) -> PyResult<&'static str> {
        Ok(self.lock(py)?.machine())
    }

    /// Keywords with their values, defaults filled in.
    #[getter]
    fn config<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &Value::Object(self.lock(py)?.resolved()))
    }

    /// Physical parameters by name.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        table(py, self.lock(py)?.parameters())
    }

    /// Simulated time since the state was set [s].
    #[getter]
    fn time(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.lock(py)?.time())
    }

    /// Duration of a step [s].
    #[getter]
    fn physics_dt(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.lock(py)?.physics_dt())
    }

    /// Positions [m], (nodes, 2).
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        points(py, &self.lock(py)?.state().positions)
    }

    /// Velocities [m/s], (nodes, 2).
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        points(py, &self.lock(py)?.state().velocities)
    }

    /// Sets positions and velocities of all nodes, each (nodes, 2) [m, m/s]; the time goes back to 0.
    fn set_state(
        &self,
        py: Python<'_>,
        positions: &Bound<'_, PyAny>,
        velocities: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let (x, v) = (pairs("positions", positions)?, pairs("velocities", velocities)?);
        self.lock(py)?.set_state(&x, &v).or_raise()
    }

    /// `n` physics steps under a constant input: a pendulum's base torque [N m], a fin's pitch [rad].
    fn step(&self, py: Python<'_>, input: f64, n: u64) -> PyResult<()> {
        let mut guard = self.lock(py)?;
        in_parts(py, &mut guard, n, |machine, part| machine.step(input, part))
    }

    /// The whole state as one vector.
    fn get_vector<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, self.lock(py)?.vector().or_raise()?))
    }

    /// Goes to such a state; the time goes back to 0.
    fn set_vector(&self, py: Python<'_>, x: &Bound<'_, PyAny>) -> PyResult<()> {
        let x = arrays::read::<f64, Ix1>("x", x)?.as_array().to_vec();
        self.lock(py)?.set_vector(&x).or_raise()
    }

    /// Derivatives of that vector after `n` physics steps under a constant input: `A` by the vector, `B` by the
    /// input, `P` by the parameters of these names.
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        input: f64,
        n: u64,
        parameters: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let parameters = names(parameters)?;
        let machine = self.lock(py)?.copy();
        // (Few steps are not worth a thread that looks out for Ctrl-C.)
        if n <= AT_ONCE {
            let found = py.detach(move || machine.jacobian(input, n, &parameters, Watch::nobody()));
            return named(py, found.or_raise()?);
        }
        let (found, interrupt) =
            watched(py, move |stop| machine.jacobian(input, n, &parameters, Watch::new(stop)));
        if let Some(interrupt) = interrupt {
            return Err(interrupt);
        }
        named(py, found.or_raise()?)
    }

    /// Energies by kind [J], and their total.
    fn energy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let energies = self.lock(py)?.energies();
        let total: f64 = energies.iter().map(|(_, energy)| energy).sum();
        let dict = table(py, energies)?;
        dict.set_item("total", total)?;
        Ok(dict)
    }

    /// What this machine alone can tell, by one of its own words: numbers and arrays by name.
    #[pyo3(signature = (question, arguments=None))]
    fn ask<'py>(
        &self,
        py: Python<'py>,
        question: &str,
        arguments: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let arguments = arguments.map_or(Ok(vec![]), |given| rows("arguments", given))?;
        let guard = self.lock(py)?;
        named(py, guard.ask(question, &arguments).or_raise()?)
    }

    /// What this machine alone can do, by one of its own words; where it steps, `n` physics steps of it.
    #[pyo3(signature = (command, arguments, n=0))]
    fn act<'py>(
        &self,
        py: Python<'py>,
        command: &str,
        arguments: &Bound<'py, PyAny>,
        n: u64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let arguments = rows("arguments", arguments)?;
        let mut guard = self.lock(py)?;
        let mut told = vec![];
        in_parts(py, &mut guard, n, |machine, part| {
            told = machine.act(command, &arguments, part)?;
            Ok(())
        })?;
        named(py, told)
    }

    /// Pickling keeps the state: keywords first, then every number that the future depends on.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let (py, this) = (slf.py(), slf.get());
        let state = this.lock(py)?.snapshot();
        (slf.get_type(), (this.machine(py)?, this.config(py)?), state).into_pyobject(py)
    }

    fn __setstate__(&self, py: Python<'_>, state: &Bound<'_, PyAny>) -> PyResult<()> {
        let allowed = "the numbers and steps of __reduce__";
        let refuse = |_| to_py(Error::parameter("state", repr(state), allowed));
        let (numbers, steps): (Bound<'_, PyAny>, u64) = state.extract().map_err(refuse)?;
        let numbers = arrays::read::<f64, Ix1>("state", &numbers)?.as_array().to_vec();
        self.lock(py)?.restore(&numbers, steps).or_raise()
    }

    /// An independent copy, as it is now.
    fn copy(&self, py: Python<'_>) -> PyResult<Self> {
        Ok(Simulation::of(self.lock(py)?.copy()))
    }
}

impl Simulation {
    /// A machine as Python has it.
    pub fn of(machine: Box<dyn Machine>) -> Self {
        Simulation(Lock::new("simulation", machine))
    }

    /// The machine, waiting without the GIL while another thread steps it.
    fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, Box<dyn Machine>>> {
        self.0.lock(py)
    }
}

/// Takes `n` steps without the GIL, in parts. After Ctrl-C the machine is as it was before the first.
fn in_parts(
    py: Python<'_>,
    machine: &mut Box<dyn Machine>,
    n: u64,
    mut step: impl FnMut(&mut dyn Machine, u64) -> rodgym_core::Result<()> + Send,
) -> PyResult<()> {
    let before = (n > 1).then(|| machine.copy());
    let (mut left, mut part) = (n, 1);
    loop {
        part = left.min(part);
        let began = std::time::Instant::now();
        // (No step at all still refuses an input that is none.)
        py.detach(|| step(machine.as_mut(), part)).or_raise()?;
        left -= part;
        if left == 0 {
            return Ok(());
        }
        if let Err(interrupt) = py.check_signals() {
            if let Some(before) = before {
                *machine = before;
            }
            return Err(interrupt);
        }
        if began.elapsed() < LOOK {
            part *= 2;
        }
    }
}

/// Names and values as a dictionary.
fn table<'py>(py: Python<'py>, values: Vec<(&'static str, f64)>) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, value) in values {
        dict.set_item(name, value)?;
    }
    Ok(dict)
}

/// Named numbers as a dictionary: floats, or arrays of their shape.
pub fn named<'py>(py: Python<'py>, values: Vec<Named>) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for Named { name, shape, values } in values {
        match shape.is_empty() {
            true => dict.set_item(name, values[0])?,
            false => dict.set_item(name, PyArray1::from_vec(py, values).reshape(shape)?)?,
        }
    }
    Ok(dict)
}

/// Rows (x, y) of an array of shape (nodes, 2).
fn pairs(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 2]>> {
    let array = arrays::read::<f64, Ix2>(name, given)?;
    let view = array.as_array();
    if view.ncols() != 2 {
        return Err(to_py(Error::Shape {
            name: name.into(),
            got: format!("{:?}", array.shape()),
            expected: "(nodes, 2)".into(),
        }));
    }
    Ok(view.rows().into_iter().map(|row| [row[0], row[1]]).collect())
}
