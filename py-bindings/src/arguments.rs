//! Arguments as Python gives them: counts, seeds, reset options, actions.

use crate::convert::to_map;
use crate::errors::{raise, to_py};
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyInt};
use rodgym_core::Error;
use rodgym_core::env::{ResetOptions, Seeds};
use serde_json::Value;

/// Actions as given.
pub enum Actions<'py> {
    Single(PyReadonlyArrayDyn<'py, f32>),
    Double(PyReadonlyArrayDyn<'py, f64>),
}

impl<'py> Actions<'py> {
    /// Numbers of this shape.
    ///
    /// # Errors
    /// Another shape, or something that is not numbers.
    pub fn read(actions: &Bound<'py, PyAny>, expected: &[usize]) -> PyResult<Self> {
        let read = match actions.extract() {
            Ok(array) => Actions::Single(array),
            Err(_) => {
                let array = actions.py().import("numpy")?.call_method1("asarray", (actions,))?;
                let kind: char = array.getattr("dtype")?.getattr("kind")?.extract()?;
                if !"fiub".contains(kind) {
                    let message = format!("actions must be numbers, but are {}", actions.repr()?);
                    return Err(raise("ShapeError", message));
                }
                Actions::Double(array.call_method1("astype", ("float64",))?.extract()?)
            }
        };
        if read.shape() == expected {
            return Ok(read);
        }
        Err(to_py(Error::Shape {
            name: "action".into(),
            got: format!("{:?}", read.shape()),
            expected: format!("{expected:?}"),
        }))
    }

    fn shape(&self) -> &[usize] {
        match self {
            Actions::Single(array) => array.shape(),
            Actions::Double(array) => array.shape(),
        }
    }

    /// Row-major in single precision; finite numbers beyond its range stay finite.
    pub fn copy_to(&self, kept: &mut [f32]) {
        let limit = f64::from(f32::MAX);
        match self {
            Actions::Single(array) => {
                kept.iter_mut().zip(array.as_array()).for_each(|(kept, given)| *kept = *given);
            }
            Actions::Double(array) => {
                for (kept, given) in kept.iter_mut().zip(array.as_array()) {
                    let finite = given.clamp(-limit, limit);
                    *kept = if given.is_finite() { finite as f32 } else { *given as f32 };
                }
            }
        }
    }
}

/// A number of things: an integer of at least 0 (the core knows the rest of the range).
pub fn count(name: &str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    value
        .call_method0("__index__")
        .and_then(|integer| integer.extract::<usize>())
        .map_err(|_| to_py(Error::parameter(name, value, "a whole number, 0 or more")))
}

fn read_seed(value: &Bound<'_, PyAny>) -> PyResult<u64> {
    value
        .call_method0("__index__")
        .and_then(|integer| integer.extract::<u64>())
        .map_err(|_| to_py(Error::parameter("seed", value, "a whole number from 0 to 2^64 - 1")))
}

/// None continues the streams, an integer is the seed of the first environment, a list is one each.
pub fn read_seeds(seeds: Option<&Bound<'_, PyAny>>) -> PyResult<Seeds> {
    let Some(seeds) = seeds else { return Ok(Seeds::Continue) };
    if seeds.is_instance_of::<PyInt>() || seeds.len().is_err() {
        return Ok(Seeds::Base(read_seed(seeds)?));
    }
    let one = |seed: Bound<'_, PyAny>| {
        if seed.is_none() { Ok(None) } else { read_seed(&seed).map(Some) }
    };
    seeds.try_iter()?.map(|seed| one(seed?)).collect::<PyResult<_>>().map(Seeds::Each)
}

/// The options of a reset without `reset_mask`, which is an argument of its own here.
pub fn read_options(options: Option<&Bound<'_, PyDict>>) -> PyResult<ResetOptions> {
    let Some(options) = options else { return Ok(ResetOptions::default()) };
    let mut map = to_map(options)?;
    let parameters = match map.remove("parameters") {
        None | Some(Value::Null) => Default::default(),
        Some(Value::Object(parameters)) => parameters,
        Some(other) => {
            let allowed = "a dictionary of parameters and their values";
            return Err(to_py(Error::parameter("options['parameters']", other, allowed)));
        }
    };
    let state = map.remove("state").filter(|state| !state.is_null());
    if let Some(name) = map.keys().next() {
        return Err(to_py(Error::UnknownParameter {
            name: format!("options['{name}']"),
            known: "options['parameters'], options['state'], options['reset_mask']".into(),
        }));
    }
    Ok(ResetOptions { parameters, state })
}
