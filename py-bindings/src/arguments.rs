//! Arguments as Python gives them: counts, seeds, reset options, actions.

use crate::arrays;
use crate::convert::to_map;
use crate::errors::to_py;
use numpy::{Ix1, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyBytes, PyDict, PyInt, PyString};
use rodgym_core::Error;
use rodgym_core::batch::{MAX_ENVS, MAX_THREADS};
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
        let read = match arrays::as_is(actions) {
            Some(array) => Actions::Single(array),
            None => {
                // What numbers are is said once, for a server's environments too.
                let checks = actions.py().import("rodgym._checks")?;
                let array = checks.call_method1("actions", (actions,))?;
                Actions::Double(arrays::read("actions", &array)?)
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

/// A value as Python shows it: strings in quotes; long ones are cut.
pub fn repr(value: &Bound<'_, PyAny>) -> String {
    const LONGEST: usize = 200;
    let text = value.repr().map_or_else(|_| "?".to_owned(), |text| text.to_string());
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text,
    }
}

/// The bytes of a snapshot.
pub fn bytes<'a>(value: &'a Bound<'_, PyAny>) -> PyResult<&'a [u8]> {
    let allowed = "the bytes that get_state returned";
    let bytes = value.cast::<PyBytes>().map(|bytes| bytes.as_bytes());
    bytes.map_err(|_| to_py(Error::parameter("state", repr(value), allowed)))
}

/// Names of parameters: a list or tuple of texts.
pub fn names(value: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    let text = value.is_instance_of::<PyString>();
    value.extract().ok().filter(|_| !text).ok_or_else(|| {
        to_py(Error::parameter("parameters", repr(value), "a list of names of parameters"))
    })
}

/// Rows of numbers, whatever their lengths.
pub fn rows(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<Vec<f64>>> {
    let sequence = || to_py(Error::parameter(name, repr(value), "a sequence of lists of numbers"));
    let row = |row: Bound<'_, PyAny>| Ok(arrays::read::<f64, Ix1>(name, &row)?.as_array().to_vec());
    let items = value.try_iter().map_err(|_| sequence())?;
    items.map(|item| row(item.map_err(|_| sequence())?)).collect()
}

/// An integer of Python or NumPy; True and False are none.
fn whole<T>(value: &Bound<'_, PyAny>) -> Option<T>
where
    T: for<'a, 'py> FromPyObject<'a, 'py>,
{
    if value.is_instance_of::<PyBool>() {
        return None;
    }
    value.call_method0("__index__").ok()?.extract().ok()
}

/// A number of things, within what the core allows.
pub fn count(name: &str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let (most, allowed) = match name {
        "num_envs" => (MAX_ENVS, format!("an integer from 1 to {MAX_ENVS}")),
        "num_threads" => (MAX_THREADS, format!("an integer from 1 to {MAX_THREADS}")),
        "max_episode_steps" => (usize::MAX, "an integer of at least 1, None or -1".into()),
        _ => (usize::MAX, "an integer of at least 1".into()),
    };
    let number = whole::<usize>(value).filter(|number| (1..=most).contains(number));
    number.ok_or_else(|| to_py(Error::parameter(name, repr(value), allowed)))
}

fn read_seed(value: &Bound<'_, PyAny>) -> PyResult<u64> {
    let allowed = "a whole number from 0 to 2^64 - 1";
    whole(value).ok_or_else(|| to_py(Error::parameter("seed", repr(value), allowed)))
}

/// None continues the streams, an integer is the seed of the first environment, a list is one each.
pub fn read_seeds(seeds: Option<&Bound<'_, PyAny>>) -> PyResult<Seeds> {
    let Some(seeds) = seeds else { return Ok(Seeds::Continue) };
    let text = seeds.is_instance_of::<PyString>();
    if text || seeds.is_instance_of::<PyInt>() || seeds.len().is_err() {
        return Ok(Seeds::Base(read_seed(seeds)?));
    }
    let one = |seed: Bound<'_, PyAny>| {
        if seed.is_none() { Ok(None) } else { read_seed(&seed).map(Some) }
    };
    seeds.try_iter()?.map(|seed| one(seed?)).collect::<PyResult<_>>().map(Seeds::Each)
}

/// The options of a reset, a dictionary, without `reset_mask`, which is an argument of its own here.
pub fn read_options(options: Option<&Bound<'_, PyAny>>) -> PyResult<ResetOptions> {
    let Some(options) = options else { return Ok(ResetOptions::default()) };
    let Ok(dict) = options.cast::<PyDict>() else {
        let allowed = "a dictionary, or None";
        return Err(to_py(Error::parameter("options", repr(options), allowed)));
    };
    let mut map = to_map(dict)?;
    if let Some(mask) = map.get("reset_mask") {
        let allowed = "left out here: a mask is for a batch (gym.make_vec) and its reset";
        return Err(to_py(Error::parameter("options['reset_mask']", mask, allowed)));
    }
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
            known: "options['parameters'], options['state'], and of a batch options['reset_mask']"
                .into(),
        }));
    }
    Ok(ResetOptions { parameters, state })
}
