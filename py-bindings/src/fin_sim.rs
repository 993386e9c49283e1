//! The fin by itself: `rodgym.sim.Fin`.

use crate::convert::{points, to_map, to_python};
use crate::errors::{OrRaise, raise};
use crate::sim::{in_parts, pairs};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::{PyDict, PyTuple};
use rodgym_core::fin::{Fin, Parameters};
use serde_json::Value;
use std::sync::{Mutex, MutexGuard};

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<FinSimulation>()
}

/// The flexible fin without sensors or control step.
#[pyclass(module = "rodgym._native", frozen)]
pub struct FinSimulation(Mutex<Fin>);

#[pymethods]
impl FinSimulation {
    #[new]
    #[pyo3(signature = (kwargs=None))]
    fn new(kwargs: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let given = kwargs.map_or_else(|| Ok(Default::default()), to_map)?;
        Ok(FinSimulation(Mutex::new(Fin::from_keywords(&given).or_raise()?)))
    }

    /// Keywords with their values, defaults filled in.
    #[getter]
    fn config<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &Value::Object(self.lock(py)?.resolved().clone()))
    }

    /// Parameters of the fin and its water by name.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        let parameters = *self.lock(py)?.parameters();
        for (i, row) in Parameters::table().iter().enumerate() {
            dict.set_item(row.name, parameters.get(i))?;
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
        Ok(self.lock(py)?.design().physics_dt)
    }

    /// Positions [m], (nodes, 2).
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        points(py, &self.lock(py)?.positions())
    }

    /// Velocities [m/s], (nodes, 2).
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        points(py, &self.lock(py)?.velocities())
    }

    /// Forces and power of the last physics step, by name.
    #[getter]
    fn loads<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let guard = self.lock(py)?;
        let (loads, pitch) = (*guard.loads(), guard.pitch());
        let dict = PyDict::new(py);
        dict.set_item("pitch", pitch)?;
        dict.set_item("thrust", loads.thrust)?;
        dict.set_item("shed_thrust", loads.shed_thrust)?;
        dict.set_item("resistive_thrust", loads.resistive_thrust)?;
        dict.set_item("mount_thrust", loads.mount_thrust)?;
        dict.set_item("torque", loads.torque)?;
        dict.set_item("power", loads.power)?;
        Ok(dict)
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

    /// `n` physics steps, each ending at this pitch [rad].
    fn step(&self, py: Python<'_>, pitch: f64, n: u64) -> PyResult<()> {
        let mut guard = self.lock(py)?;
        let fin = &mut *guard;
        in_parts(py, n, |part| fin.step(pitch, part))
    }

    /// `n` physics steps under the servo, told this pitch [rad].
    fn drive(&self, py: Python<'_>, command: f64, n: u64) -> PyResult<()> {
        let mut guard = self.lock(py)?;
        let fin = &mut *guard;
        in_parts(py, n, |part| fin.drive(command, part))
    }

    /// Physics steps that end at the given pitches [rad]; thrust [N], torque [N m], power [W] and y of the
    /// tail [m] after each, (n, 4).
    fn follow<'py>(&self, py: Python<'py>, pitches: Vec<f64>) -> PyResult<Bound<'py, PyAny>> {
        let mut guard = self.lock(py)?;
        let fin = &mut *guard;
        let trace = py.detach(|| fin.follow(&pitches)).or_raise()?;
        let (n, flat) = (trace.len(), trace.into_iter().flatten().collect::<Vec<f64>>());
        Ok(PyArray1::from_vec(py, flat).reshape([n, 4])?.into_any())
    }

    /// Forces [N, kg m/s] (nodes, 2) and energies [J] in any motion, by name.
    fn forces<'py>(
        &self,
        py: Python<'py>,
        positions: PyReadonlyArray2<'_, f64>,
        velocities: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (x, v) = (pairs("positions", &positions)?, pairs("velocities", &velocities)?);
        let forces = self.lock(py)?.forces(&x, &v).or_raise()?;
        let dict = PyDict::new(py);
        dict.set_item("elastic", points(py, &forces.elastic)?)?;
        dict.set_item("fluid_momentum", points(py, &forces.fluid_momentum)?)?;
        dict.set_item("fluid_gradient", points(py, &forces.fluid_gradient)?)?;
        dict.set_item("tail_flux", points(py, &forces.tail_flux)?)?;
        dict.set_item("resistive", points(py, &forces.resistive)?)?;
        dict.set_item("elastic_energy", forces.elastic_energy)?;
        dict.set_item("fluid_energy", forces.fluid_energy)?;
        Ok(dict)
    }

    /// Energies by kind [J].
    fn energy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let energy = self.lock(py)?.energy();
        let dict = PyDict::new(py);
        dict.set_item("kinetic", energy.kinetic)?;
        dict.set_item("stretch", energy.stretch)?;
        dict.set_item("bend", energy.bend)?;
        dict.set_item("fluid", energy.fluid)?;
        dict.set_item("total", energy.kinetic + energy.stretch + energy.bend + energy.fluid)?;
        Ok(dict)
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
        Ok(FinSimulation(Mutex::new(self.lock(py)?.clone())))
    }
}

impl FinSimulation {
    /// The simulation, waiting without the GIL while another thread steps it.
    fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, Fin>> {
        self.0.lock_py_attached(py).map_err(|_| {
            raise("RodgymError", "this simulation is not usable: an earlier call ended in a panic")
        })
    }
}
