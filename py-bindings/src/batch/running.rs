//! The batch that runs, and how its results become NumPy arrays.

use crate::arguments::{Actions, names};
use crate::arrays::writable;
use crate::errors::OrRaise;
use crate::interrupt::watched;
use crate::sim::named;
use numpy::{PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use rodgym_core::env::{StepBuffer, StepData, VectorEnv};
use rodgym_core::error::Result;
use rodgym_core::results::Widths;
use rodgym_core::simulation::Named;
use rodgym_core::step_fields;
use std::sync::MutexGuard;

pub(crate) struct Inner {
    pub(crate) env: Box<dyn VectorEnv>,
    /// Actions of the step being taken: the caller's array is not read once the GIL is released.
    pub(super) actions: Vec<f32>,
    /// Results of the one environment of mode Single; empty otherwise.
    pub(super) buffer: StepBuffer,
}

/// Makes result arrays and lets `call` fill them; what it has written into `out` is undone where it fails.
pub(super) fn fill<'py>(
    py: Python<'py>,
    mut guard: MutexGuard<'_, Inner>,
    out: Option<&Bound<'py, PyAny>>,
    call: impl FnOnce(&mut Inner, StepData<'_>) -> PyResult<()>,
) -> PyResult<Bound<'py, PyTuple>> {
    let n = guard.env.num_envs();
    let widths = Widths::of(guard.env.spec());
    let mut out = out.map(|out| writable("out", out, &[n, widths.observation])).transpose()?;
    macro_rules! shape {
        (one) => {
            vec![n]
        };
        ($width:ident) => {
            vec![n, widths.$width]
        };
    }
    // An array for every field; the observation may go where the caller wants it.
    let taken = out.is_some();
    macro_rules! fill {
        ($($(#[$doc:meta])* $field:ident: $element:ty, $width:ident;)*) => {{
            $(let mut $field =
                PyArrayDyn::<$element>::zeros(py, shape!($width), false).readwrite();)*
            let mut data = StepData { $($field: $field.as_slice_mut()?,)* };
            if let Some(given) = &mut out {
                data.observation = given.as_slice_mut()?;
            }
            let long = guard.env.long_step().is_some();
            let before = (long && taken).then(|| data.observation.to_vec());
            let called = call(&mut guard, data);
            drop(guard);
            if let (Err(_), Some(given), Some(before)) = (&called, &mut out, before) {
                given.as_slice_mut()?.copy_from_slice(&before);
            }
            called?;
            [$($field.as_any().clone()),*]
        }};
    }
    let mut result = step_fields!(fill);
    if let Some(given) = &out {
        result[0] = given.as_any().clone();
    }
    PyTuple::new(py, result)
}

/// What `call` finds for `actions` of the given shape and the named parameters, without the GIL.
pub(super) fn derive<'py>(
    py: Python<'py>,
    env: &mut dyn VectorEnv,
    (actions, shape): (&Bound<'py, PyAny>, &[usize]),
    parameters: &Bound<'py, PyAny>,
    call: impl FnOnce(&mut dyn VectorEnv, &[f32], &[String]) -> Result<Vec<Named>> + Send,
) -> PyResult<Bound<'py, PyDict>> {
    let parameters = names(parameters)?;
    let given = Actions::read(actions, shape)?;
    let mut actions = vec![0.0; shape.iter().product()];
    given.copy_to(&mut actions);
    named(py, py.detach(move || call(env, &actions, &parameters)).or_raise()?)
}

/// One control step without the GIL. Ctrl-C ends one that takes long, and then it was not made.
pub(super) fn step(
    py: Python<'_>,
    env: &mut dyn VectorEnv,
    actions: &[f32],
    data: StepData<'_>,
) -> PyResult<()> {
    let Some(env) = env.long_step() else {
        return py.detach(|| env.step(actions, data)).or_raise();
    };
    let long = &mut *env;
    let (stepped, interrupt) = watched(py, move |stop| {
        let before = long.save();
        (long.step_unless(actions, data, stop), before)
    });
    let (stepped, before) = stepped;
    if let Some(interrupt) = interrupt {
        py.detach(|| env.restore(before));
        return Err(interrupt);
    }
    stepped.or_raise()
}

/// Names and values as a dictionary.
pub(super) fn table<'py>(
    py: Python<'py>,
    names: impl Iterator<Item = &'static str>,
    values: &[f64],
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, value) in names.zip(values) {
        dict.set_item(name, value)?;
    }
    Ok(dict)
}
