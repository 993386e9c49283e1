//! Python values to JSON values and back: keywords, reset options, specs.

use crate::arguments::repr;
use crate::errors::{raise, to_py};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use rodgym_caught::caught;
use rodgym_core::Error;
use serde_json::{Map, Number, Value};

/// Adds this file's function to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(plain_values, module)?)
}

/// Keywords or options as numbers, strings, lists and dictionaries: what a local environment reads, and refused as it
/// would refuse.
#[caught]
#[pyfunction]
fn plain_values<'py>(given: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let Ok(dict) = given.cast::<PyDict>() else {
        let allowed = "a dictionary whose keys are strings";
        return Err(to_py(Error::parameter("keyword arguments", repr(given), allowed)));
    };
    to_python(given.py(), &Value::Object(to_map(dict)?))
}

/// A value nested deeper than this is a mistake (or contains itself).
const MAX_DEPTH: usize = 16;

/// A dictionary of keywords as JSON. Takes numbers (NumPy's too), strings, enums of these, and lists,
/// tuples, arrays and dictionaries of them.
///
/// # Errors
/// A value that is not finite or of another kind, named by its keyword.
pub fn to_map(dict: &Bound<'_, PyDict>) -> PyResult<Map<String, Value>> {
    object(dict, "", 0)
}

/// Keywords that a user gave as one argument, `rod`.
///
/// # Errors
/// Something that is no dictionary, and those of `to_map`.
pub fn keywords(rod: &Bound<'_, PyAny>) -> PyResult<Map<String, Value>> {
    match rod.cast::<PyDict>() {
        Ok(dict) => to_map(dict),
        Err(_) => {
            let allowed = "a dictionary of the rod's keywords";
            Err(to_py(Error::parameter("rod", repr(rod), allowed)))
        }
    }
}

fn object(dict: &Bound<'_, PyDict>, path: &str, depth: usize) -> PyResult<Map<String, Value>> {
    let mut map = Map::new();
    for (key, value) in dict.iter() {
        let Ok(key) = key.extract::<String>() else {
            let place = if path.is_empty() { "keyword arguments" } else { path };
            return Err(to_py(Error::parameter(
                place,
                repr(&key),
                "a dictionary whose keys are strings",
            )));
        };
        let inner = if path.is_empty() { key.clone() } else { format!("{path}[{key:?}]") };
        let value = to_value(&value, &inner, depth + 1)?;
        map.insert(key, value);
    }
    Ok(map)
}

/// One Python value as JSON; `path` names it in errors.
pub fn to_value(value: &Bound<'_, PyAny>, path: &str, depth: usize) -> PyResult<Value> {
    let refuse = |allowed: &str| Err(to_py(Error::parameter(path, repr(value), allowed)));
    if depth > MAX_DEPTH {
        return refuse("nested less deeply");
    }
    if value.is_none() {
        return Ok(Value::Null);
    }
    if let Ok(flag) = value.cast::<PyBool>() {
        return Ok(Value::Bool(flag.is_true()));
    }
    if let Ok(text) = value.cast::<PyString>() {
        return Ok(Value::String(text.to_string()));
    }
    if value.is_instance_of::<PyInt>() {
        return match (value.extract::<i64>(), value.extract::<u64>()) {
            (Ok(number), _) => Ok(Value::from(number)),
            (_, Ok(number)) => Ok(Value::from(number)),
            _ => refuse("an integer of at most 64 bits"),
        };
    }
    if value.is_instance_of::<PyFloat>() {
        return match Number::from_f64(value.extract::<f64>()?) {
            Some(number) => Ok(Value::Number(number)),
            None => refuse("finite"),
        };
    }
    if let Ok(dict) = value.cast::<PyDict>() {
        return Ok(Value::Object(object(dict, path, depth)?));
    }
    if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let mut items = Vec::new();
        for (i, item) in value.try_iter()?.enumerate() {
            items.push(to_value(&item?, &format!("{path}[{i}]"), depth + 1)?);
        }
        return Ok(Value::Array(items));
    }
    // NumPy's scalars and arrays say what they are in Python's own types, enums carry a value.
    for (name, call) in [("tolist", true), ("value", false)] {
        if let Ok(attribute) = value.getattr(name) {
            let plain = if call { attribute.call0()? } else { attribute };
            return to_value(&plain, path, depth + 1);
        }
    }
    refuse("a number, a string, or a list, tuple, array or dictionary of these")
}

/// JSON as Python: objects become dictionaries, arrays lists.
pub fn to_python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Null => py.None().into_bound(py),
        Value::Bool(flag) => PyBool::new(py, *flag).to_owned().into_any(),
        Value::Number(number) => match (number.as_i64(), number.as_u64(), number.as_f64()) {
            (Some(integer), _, _) => integer.into_pyobject(py)?.into_any(),
            (_, Some(integer), _) => integer.into_pyobject(py)?.into_any(),
            (_, _, Some(float)) => PyFloat::new(py, float).into_any(),
            _ => return Err(raise("RodgymError", format!("{number} is not a number of Python"))),
        },
        Value::String(text) => PyString::new(py, text).into_any(),
        Value::Array(items) => {
            let list = PyList::empty(py);
            for item in items {
                list.append(to_python(py, item)?)?;
            }
            list.into_any()
        }
        Value::Object(map) => {
            let dict = PyDict::new(py);
            for (key, item) in map {
                dict.set_item(key, to_python(py, item)?)?;
            }
            dict.into_any()
        }
    })
}

/// Anything that serde can write, as Python dictionaries and lists.
pub fn serialize<'py>(
    py: Python<'py>,
    value: &impl serde::Serialize,
) -> PyResult<Bound<'py, PyAny>> {
    let json =
        serde_json::to_value(value).map_err(|error| raise("RodgymError", error.to_string()))?;
    to_python(py, &json)
}

/// (x, y) a node as an array of shape (nodes, 2).
pub fn points<'py>(py: Python<'py>, nodes: &[[f64; 2]]) -> PyResult<Bound<'py, PyAny>> {
    let flat = PyArray1::from_slice(py, nodes.as_flattened());
    Ok(flat.reshape([nodes.len(), 2])?.into_any())
}
