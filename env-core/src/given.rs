//! Checks of what a user gave, each of which names the value and what is allowed.

use crate::error::{Error, Result};
use serde_json::{Map, Value};

/// Refuses keywords that are not in `known`.
pub fn check_keywords(given: &Map<String, Value>, known: &[&str]) -> Result<()> {
    check_names(given, known).map_err(|error| match error {
        Error::UnknownParameter { name, known } => Error::UnknownKeyword { name, known },
        other => other,
    })
}

/// Refuses names that are not in `known`.
pub fn check_names(given: &Map<String, Value>, known: &[&str]) -> Result<()> {
    match given.keys().find(|name| !known.contains(&name.as_str())) {
        None => Ok(()),
        Some(name) => Err(Error::UnknownParameter { name: name.clone(), known: known.join(", ") }),
    }
}

/// Where a name stands among those that are known.
///
/// # Errors
/// A name that is none of them.
pub fn place(name: &str, known: &[&str]) -> Result<usize> {
    known
        .iter()
        .position(|own| *own == name)
        .ok_or_else(|| Error::UnknownParameter { name: name.into(), known: known.join(", ") })
}

/// A finite number within `[low, high]`.
pub fn number(name: &str, value: &Value, low: f64, high: f64) -> Result<f64> {
    let fits = value.as_f64().filter(|x| (low..=high).contains(x));
    fits.ok_or_else(|| Error::parameter(name, value, between(low, high)))
}

/// How many times `dt` fits into a duration that must be a multiple of it.
///
/// # Errors
/// A duration that is not a multiple.
pub fn whole(name: &str, duration: f64, dt: f64) -> Result<usize> {
    let times = libm::round(duration / dt);
    if (times * dt - duration).abs() > 1e-9 * duration.max(dt) {
        let allowed = format!("a multiple of physics_dt = {dt} s");
        return Err(Error::parameter(name, duration, allowed));
    }
    Ok(times as usize)
}

/// A range in words, as errors have it.
pub(crate) fn between(low: f64, high: f64) -> String {
    if low == high { low.to_string() } else { format!("a number from {low} to {high}") }
}
