//! Matrix equations for people who design their own controllers.

use crate::arrays;
use crate::baselines::raise_baseline;
use nalgebra::DMatrix;
use numpy::{Ix2, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use rodgym_baselines::linalg::{self, Riccati};
use rodgym_caught::caught;

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(dare, module)?)?;
    module.add_function(wrap_pyfunction!(care, module)?)
}

type Matrix<'a, 'py> = &'a Bound<'py, PyAny>;

/// An array of two dimensions as one of nalgebra's.
fn read(name: &str, given: Matrix<'_, '_>) -> PyResult<DMatrix<f64>> {
    let array = arrays::read::<f64, Ix2>(name, given)?;
    let view = array.as_array();
    Ok(DMatrix::from_fn(view.nrows(), view.ncols(), |i, j| view[[i, j]]))
}

/// One of nalgebra's matrices as NumPy's.
pub fn write<'py>(py: Python<'py>, m: &DMatrix<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    PyArray1::from_iter(py, m.transpose().iter().copied()).reshape([m.nrows(), m.ncols()])
}

type Solver = fn(
    &DMatrix<f64>,
    &DMatrix<f64>,
    &DMatrix<f64>,
    &DMatrix<f64>,
    Option<&DMatrix<f64>>,
) -> rodgym_baselines::Result<Riccati>;

type Solution<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

fn solve<'py>(
    py: Python<'py>,
    solver: Solver,
    [a, b, q, r]: [Matrix<'_, 'py>; 4],
    n: Option<Matrix<'_, 'py>>,
) -> PyResult<Solution<'py>> {
    let [a, b, q, r] = [read("A", a)?, read("B", b)?, read("Q", q)?, read("R", r)?];
    let n = n.map(|n| read("N", n)).transpose()?;
    let solution = py.detach(|| solver(&a, &b, &q, &r, n.as_ref())).map_err(raise_baseline)?;
    Ok((write(py, &solution.cost)?, write(py, &solution.gain)?))
}

/// Stabilising solution P and gain K (u = -K z) of the discrete algebraic Riccati equation with cost
/// z'Qz + 2z'Nu + u'Ru.
#[caught]
#[pyfunction]
#[pyo3(signature = (a, b, q, r, n=None))]
fn dare<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    b: &Bound<'py, PyAny>,
    q: &Bound<'py, PyAny>,
    r: &Bound<'py, PyAny>,
    n: Option<&Bound<'py, PyAny>>,
) -> PyResult<Solution<'py>> {
    solve(py, linalg::dare, [a, b, q, r], n)
}

/// Stabilising solution P and gain K (u = -K z) of the continuous algebraic Riccati equation with cost
/// z'Qz + 2z'Nu + u'Ru.
#[caught]
#[pyfunction]
#[pyo3(signature = (a, b, q, r, n=None))]
fn care<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    b: &Bound<'py, PyAny>,
    q: &Bound<'py, PyAny>,
    r: &Bound<'py, PyAny>,
    n: Option<&Bound<'py, PyAny>>,
) -> PyResult<Solution<'py>> {
    solve(py, linalg::care, [a, b, q, r], n)
}
