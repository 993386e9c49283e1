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

/// One dictionary an environment: `reward_terms` and metrics from the rows of `terms` (n, k), the given `parameters`
/// (not copied), and `TimeLimit.truncated` and `solver_failure` from `limit` and `failed` (n).
#[caught]
#[pyfunction]
fn info_list<'py>(
    py: Python<'py>,
    reward_terms: Vec<Bound<'py, PyString>>,
    metrics: Vec<Bound<'py, PyString>>,
    terms: &Bound<'py, PyAny>,
    parameters: Vec<Bound<'py, PyAny>>,
    limit: &Bound<'py, PyAny>,
    failed: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyList>> {
    let terms = arrays::read::<f64, Ix2>("terms", terms)?;
    let limit = arrays::read::<bool, Ix1>("limit", limit)?;
    let failed = arrays::read::<bool, Ix1>("failed", failed)?;
    let (terms, limit, failed) = (terms.as_array(), limit.as_array(), failed.as_array());
    let n = parameters.len();
    let wide = [n, reward_terms.len() + metrics.len()];
    let arrays: [(&str, &[usize], &[usize]); 3] = [
        ("terms", terms.shape(), &wide),
        ("limit", limit.shape(), &[n]),
        ("failed", failed.shape(), &[n]),
    ];
    if let Some((name, got, expected)) = arrays.iter().find(|(_, got, needed)| got != needed) {
        let text = format!("{name} has shape {got:?}, but {expected:?} is needed");
        return Err(raise("ShapeError", text));
    }
    let terms_key = PyString::intern(py, "reward_terms");
    let parameters_key = PyString::intern(py, "parameters");
    let limit_key = PyString::intern(py, "TimeLimit.truncated");
    let failed_key = PyString::intern(py, "solver_failure");
    let list = PyList::empty(py);
    let flags = limit.iter().zip(failed);
    for ((row, own), (late, failed)) in terms.rows().into_iter().zip(parameters).zip(flags) {
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
        info.set_item(&parameters_key, own)?;
        info.set_item(&limit_key, *late)?;
        info.set_item(&failed_key, *failed)?;
        list.append(info)?;
    }
    Ok(list)
}
