//! The bare machines, one at a time: `rodgym.sim`.

use crate::convert::{points, to_map, to_python};
use crate::errors::{OrRaise, raise, to_py};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::{PyDict, PyTuple};
use rodgym_core::Error;
use rodgym_core::pendulum::{Linear, PARAMETERS, Simulation};
use serde_json::Value;
use std::sync::{Mutex, MutexGuard};

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PendulumSimulation>()
}

type Matrix<'py> = Bound<'py, PyArray2<f64>>;
type Vector<'py> = Bound<'py, PyArray1<f64>>;

/// The elastic pendulum without motor limit, sensors or control step.
#[pyclass(module = "rodgym._native", frozen)]
pub struct PendulumSimulation(Mutex<Simulation>);

#[pymethods]
impl PendulumSimulation {
    #[new]
    #[pyo3(signature = (kwargs=None))]
    fn new(kwargs: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let given = kwargs.map_or_else(|| Ok(Default::default()), to_map)?;
        Ok(PendulumSimulation(Mutex::new(Simulation::new(&given).or_raise()?)))
    }

    /// Keywords with their values, defaults filled in.
    #[getter]
    fn config<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &Value::Object(self.lock(py)?.resolved()))
    }

    /// The rod's parameters by name.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (parameter, value) in PARAMETERS.iter().zip(self.lock(py)?.parameters()) {
            dict.set_item(parameter.name, value)?;
        }
        Ok(dict)
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

    /// Angles of the edges from hanging [rad], (nodes - 1).
    #[getter]
    fn angles<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py>> {
        Ok(PyArray1::from_vec(py, self.lock(py)?.angles()))
    }

    /// Rates of the edges' angles [rad/s], (nodes - 1).
    #[getter]
    fn rates<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py>> {
        Ok(PyArray1::from_vec(py, self.lock(py)?.rates()))
    }

    /// Sets positions and velocities of all nodes, each (nodes, 2) [m, m/s]; the time goes back to 0.
    fn set_state(
        &self,
        py: Python<'_>,
        positions: PyReadonlyArray2<'_, f64>,
        velocities: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<()> {
        let (x, v) = (pairs("positions", &positions)?, pairs("velocities", &velocities)?);
        self.lock(py)?.set_state(&x, &v).or_raise()
    }

    /// Sets angles [rad] and rates [rad/s] of all edges; the time goes back to 0.
    fn set_angles(&self, py: Python<'_>, angles: Vec<f64>, rates: Vec<f64>) -> PyResult<()> {
        self.lock(py)?.set_angles(&angles, &rates).or_raise()
    }

    /// `n` physics steps under a constant base torque [N m].
    fn step(&self, py: Python<'_>, torque: f64, n: u64) -> PyResult<()> {
        let mut guard = self.lock(py)?;
        let sim = &mut *guard;
        in_parts(py, n, |part| sim.step(torque, part))
    }

    /// `n` physics steps under a linear law of the new state, solved within the implicit step.
    fn step_feedback(&self, py: Python<'_>, constant: f64, gain: Vec<f64>, n: u64) -> PyResult<()> {
        let mut guard = self.lock(py)?;
        let sim = &mut *guard;
        in_parts(py, n, |part| sim.step_feedback(constant, &gain, part))
    }

    /// Energies by kind [J].
    fn energy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let energy = self.lock(py)?.energy();
        let dict = PyDict::new(py);
        dict.set_item("kinetic", energy.kinetic)?;
        dict.set_item("stretch", energy.stretch)?;
        dict.set_item("bend", energy.bend)?;
        dict.set_item("gravity", energy.gravity)?;
        dict.set_item("total", energy.total())?;
        Ok(dict)
    }

    /// Matrices A, B, C of the motion near the present state and `torque`.
    fn linearize<'py>(
        &self,
        py: Python<'py>,
        torque: f64,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>, Matrix<'py>)> {
        let Linear { states, outputs, a, b, c } = self.lock(py)?.linearize(torque);
        let matrix =
            |values, rows, columns| PyArray1::from_vec(py, values).reshape([rows, columns]);
        Ok((matrix(a, states, states)?, matrix(b, states, 1)?, matrix(c, outputs, states)?))
    }

    /// Pickling keeps the state: keywords first, then every number that the future depends on.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let (py, this) = (slf.py(), slf.get());
        let state = this.lock(py)?.snapshot();
        (slf.get_type(), (this.config(py)?,), state).into_pyobject(py)
    }

    fn __setstate__(&self, py: Python<'_>, state: (Vec<f64>, u64)) -> PyResult<()> {
        self.lock(py)?.restore(&state.0, state.1).or_raise()
    }

    /// An independent copy, as it is now.
    fn copy(&self, py: Python<'_>) -> PyResult<Self> {
        Ok(PendulumSimulation(Mutex::new(self.lock(py)?.clone())))
    }
}

impl PendulumSimulation {
    /// The simulation, waiting without the GIL while another thread steps it.
    fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, Simulation>> {
        self.0.lock_py_attached(py).map_err(|_| {
            raise("RodgymError", "this simulation is not usable: an earlier call ended in a panic")
        })
    }
}

/// Physics steps between two looks at Ctrl-C: some milliseconds.
const PART: u64 = 1000;

/// Takes `n` steps without the GIL, in parts; Ctrl-C ends them after the part in which it came.
pub fn in_parts(
    py: Python<'_>,
    n: u64,
    mut step: impl FnMut(u64) -> rodgym_core::Result<()> + Send,
) -> PyResult<()> {
    let mut left = n;
    loop {
        let part = left.min(PART);
        // (No step at all still refuses a torque that is none.)
        py.detach(|| step(part)).or_raise()?;
        left -= part;
        if left == 0 {
            return Ok(());
        }
        py.check_signals()?;
    }
}

/// Rows (x, y) of an array of shape (nodes, 2).
pub fn pairs(name: &str, array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 2]>> {
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
