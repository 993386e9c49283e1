//! Array arguments: whatever is given becomes an array of the wanted numbers, or is refused by its name.

use crate::arguments::repr;
use crate::errors::raise;
use numpy::ndarray::Dimension;
use numpy::{
    Element, PyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArray, PyReadwriteArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

/// What an array can hold.
pub trait Number: Element {
    /// NumPy's name of the type.
    const NAME: &'static str;
    /// Kinds of NumPy's types that are read as such: floats, integers, bools.
    const KINDS: &'static str;
    /// In words.
    const WORDS: &'static str;
}

impl Number for f32 {
    const NAME: &'static str = "float32";
    const KINDS: &'static str = "fiub";
    const WORDS: &'static str = "numbers";
}

impl Number for f64 {
    const NAME: &'static str = "float64";
    const KINDS: &'static str = "fiub";
    const WORDS: &'static str = "numbers";
}

impl Number for bool {
    const NAME: &'static str = "bool";
    const KINDS: &'static str = "b";
    const WORDS: &'static str = "True and False";
}

/// The array itself, if it is one of these numbers with as many dimensions, and nobody writes to it.
pub fn as_is<'py, T: Number, D: Dimension>(
    given: &Bound<'py, PyAny>,
) -> Option<PyReadonlyArray<'py, T, D>> {
    given.cast::<PyArray<T, D>>().ok().filter(|array| array.is_aligned())?.try_readonly().ok()
}

/// The array, or a copy that NumPy makes of it in these numbers: of lists, too.
///
/// # Errors
/// A `ShapeError`: no array, numbers of another kind (complex, objects, text), other dimensions.
pub fn read<'py, T: Number, D: Dimension>(
    name: &str,
    given: &Bound<'py, PyAny>,
) -> PyResult<PyReadonlyArray<'py, T, D>> {
    if let Some(array) = as_is(given) {
        return Ok(array);
    }
    // (Rows of different lengths are no array at all.)
    let plain = given.py().import("numpy")?.call_method1("asarray", (given,)).ok();
    let kind = |array: &Bound<'py, PyAny>| -> PyResult<char> {
        array.getattr("dtype")?.getattr("kind")?.extract()
    };
    let plain = plain.filter(|array| kind(array).is_ok_and(|kind| T::KINDS.contains(kind)));
    // (What overflows is refused where NumPy's warnings are errors.)
    let copy = plain.as_ref().and_then(|array| array.call_method1("astype", (T::NAME, "C")).ok());
    let (Some(plain), Some(copy)) = (plain, copy) else {
        let text = format!("{name} must be an array of {}, but is {}", T::WORDS, repr(given));
        return Err(raise("ShapeError", text));
    };
    as_is(&copy).ok_or_else(|| {
        let shape = plain.getattr("shape").map_or_else(|_| "()".into(), |shape| repr(&shape));
        let needed = D::NDIM.unwrap_or(1);
        let text = format!("{name} has shape {shape}, but {needed} dimensions are needed");
        raise("ShapeError", text)
    })
}

/// An array of float32 of this shape that results can be written to in one piece.
///
/// # Errors
/// A `ShapeError`: anything else.
pub fn writable<'py>(
    name: &str,
    given: &Bound<'py, PyAny>,
    shape: &[usize],
) -> PyResult<PyReadwriteArrayDyn<'py, f32>> {
    let fits = |array: &&Bound<'py, PyArrayDyn<f32>>| {
        array.is_aligned() && array.is_c_contiguous() && array.shape() == shape
    };
    let array = given.cast::<PyArrayDyn<f32>>().ok().filter(fits);
    // (What is read-only or in use elsewhere is not lent.)
    array.and_then(|array| array.try_readwrite().ok()).ok_or_else(|| {
        let text = format!(
            "{name} must be a float32 array of shape {shape:?}, contiguous, writable and used by nobody else, but is {}",
            repr(given)
        );
        raise("ShapeError", text)
    })
}
