//! Infos of a batch as one dictionary an environment, as Stable-Baselines3 wants them.

use crate::arrays;
use crate::errors::raise;
use numpy::{Ix1, Ix2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyString};
use rodgym_caught::caught;

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(info_list, module)?)
}

/// One dictionary an environment: `reward_terms` and metrics from the rows of `terms` (n, k), and
/// `TimeLimit.truncated` from `limit` (n).
#[caught]
#[pyfunction]
fn info_list<'py>(
    py: Python<'py>,
    reward_terms: Vec<Bound<'py, PyString>>,
    metrics: Vec<Bound<'py, PyString>>,
    terms: &Bound<'py, PyAny>,
    limit: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyList>> {
    let terms = arrays::read::<f64, Ix2>("terms", terms)?;
    let limit = arrays::read::<bool, Ix1>("limit", limit)?;
    let (terms, limit) = (terms.as_array(), limit.as_array());
    let expected = [limit.len(), reward_terms.len() + metrics.len()];
    if terms.shape() != expected {
        let got = terms.shape();
        let text = format!("terms has shape {got:?}, but {expected:?} is needed");
        return Err(raise("ShapeError", text));
    }
    let terms_key = PyString::intern(py, "reward_terms");
    let limit_key = PyString::intern(py, "TimeLimit.truncated");
    let list = PyList::empty(py);
    for (row, late) in terms.rows().into_iter().zip(limit) {
        let mut values = row.iter();
        let inner = PyDict::new(py);
        for (name, value) in reward_terms.iter().zip(&mut values) {
            inner.set_item(name, value)?;
        }
        let info = PyDict::new(py);
        info.set_item(&terms_key, inner)?;
        for (name, value) in metrics.iter().zip(values) {
            info.set_item(name, value)?;
        }
        info.set_item(&limit_key, *late)?;
        list.append(info)?;
    }
    Ok(list)
}
