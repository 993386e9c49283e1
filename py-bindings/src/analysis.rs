//! Controllability, observability and buckling of a rod, for plots over its parameters.

use crate::baselines::raise_baseline;
use crate::convert::keywords;
use crate::riccati::write;
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rodgym_baselines::pendulum::{
    RodDesign, buckling_width, discrete_buckling_width, reach, upright as linear_model,
};
use rodgym_caught::caught;

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(analyse, module)?)?;
    module.add_function(wrap_pyfunction!(upright, module)?)
}

/// How well a rod is moved and seen from its base about up, without units, and when it buckles.
///
/// `rod`: keywords of the rod; the others keep their defaults. Returns `states`, `controllable` and
/// `observable` (ranks), `hankel` (values, largest first), `distance` to the nearest uncontrollable
/// system, `buckling_width` of the continuous and `discrete_buckling_width` of the discrete rod [m].
#[caught]
#[pyfunction]
fn analyse<'py>(py: Python<'py>, rod: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    let design = RodDesign::from_keywords(&keywords(rod)?).map_err(raise_baseline)?;
    let found = py.detach(|| reach(&design)).map_err(raise_baseline)?;
    let out = PyDict::new(py);
    out.set_item("states", found.states)?;
    out.set_item("controllable", found.controllable)?;
    out.set_item("observable", found.observable)?;
    out.set_item("hankel", numpy::PyArray1::from_vec(py, found.hankel))?;
    out.set_item("distance", found.distance)?;
    out.set_item("buckling_width", buckling_width(&design))?;
    out.set_item("discrete_buckling_width", discrete_buckling_width(&design))?;
    Ok(out)
}

type Matrix<'py> = Bound<'py, PyArray2<f64>>;

/// The inextensible rod about up, thesis (4.9)-(4.12) and (4.18), bending damping and drag included:
/// A (2n, 2n), B (2n, 1), C (2, 2n) of z' = A z + B T, y = C z.
///
/// `rod`: keywords of the rod; the others keep their defaults. z: angles of the n edges from up [rad],
/// then their rates [rad/s]; T: base torque [N m]; y: base angle and rate.
#[caught]
#[pyfunction]
fn upright<'py>(
    py: Python<'py>,
    rod: &Bound<'py, PyAny>,
) -> PyResult<(Matrix<'py>, Matrix<'py>, Matrix<'py>)> {
    let design = RodDesign::from_keywords(&keywords(rod)?).map_err(raise_baseline)?;
    let model = linear_model(&design);
    Ok((write(py, &model.a)?, write(py, &model.b)?, write(py, &model.c)?))
}
