//! Reading keywords: every value is checked, every refusal names the keyword, the value and what is allowed.

use crate::env::Parameter;
use crate::error::{Error, Result};
use crate::seed::Stream;
use serde_json::{Map, Value};

/// The keywords that a user gave, and the names that exist.
pub struct Keywords<'a> {
    given: &'a Map<String, Value>,
}

impl<'a> Keywords<'a> {
    /// Refuses names that are not in `known`.
    pub fn new(given: &'a Map<String, Value>, known: &[&str]) -> Result<Self> {
        check_names(given, known)?;
        Ok(Keywords { given })
    }

    /// The value of a keyword; `None` where it was not given or is null.
    pub fn get(&self, name: &str) -> Option<&'a Value> {
        self.given.get(name).filter(|value| !value.is_null())
    }

    /// A number within `[low, high]`.
    pub fn number(&self, name: &str, default: f64, low: f64, high: f64) -> Result<f64> {
        self.get(name).map_or(Ok(default), |value| number(name, value, low, high))
    }

    /// A number within `[low, high]`, or `None` where it was not given.
    pub fn optional(&self, name: &str, low: f64, high: f64) -> Result<Option<f64>> {
        self.get(name).map(|value| number(name, value, low, high)).transpose()
    }

    /// The value of a physical parameter.
    pub fn parameter(&self, parameter: &Parameter, default: f64) -> Result<f64> {
        self.number(parameter.name, default, parameter.low, parameter.high)
    }

    /// An integer within `[low, high]`.
    pub fn integer(&self, name: &str, default: u64, low: u64, high: u64) -> Result<u64> {
        let Some(value) = self.get(name) else { return Ok(default) };
        let refuse = || Error::parameter(name, value, format!("an integer from {low} to {high}"));
        value.as_u64().filter(|n| (low..=high).contains(n)).ok_or_else(refuse)
    }

    /// True or false.
    pub fn flag(&self, name: &str, default: bool) -> Result<bool> {
        let Some(value) = self.get(name) else { return Ok(default) };
        value.as_bool().ok_or_else(|| Error::parameter(name, value, "true or false"))
    }

    /// One of a few words.
    pub fn choice<'c>(&self, name: &str, default: &'c str, words: &[&'c str]) -> Result<&'c str> {
        let Some(value) = self.get(name) else { return Ok(default) };
        let found = words.iter().copied().find(|word| Some(*word) == value.as_str());
        let quoted: Vec<String> = words.iter().map(|word| format!("'{word}'")).collect();
        found.ok_or_else(|| Error::parameter(name, value, format!("one of {}", quoted.join(", "))))
    }

    /// A pair low <= high within limits.
    pub fn range(&self, name: &str, default: (f64, f64), limits: (f64, f64)) -> Result<(f64, f64)> {
        let Some(value) = self.get(name) else { return Ok(default) };
        let allowed =
            || format!("a pair (low, high) with {} <= low <= high <= {}", limits.0, limits.1);
        let refuse = || Error::parameter(name, value, allowed());
        let pair = value.as_array().filter(|pair| pair.len() == 2).ok_or_else(refuse)?;
        let (Some(low), Some(high)) = (pair[0].as_f64(), pair[1].as_f64()) else {
            return Err(refuse());
        };
        if limits.0 <= low && low <= high && high <= limits.1 {
            Ok((low, high))
        } else {
            Err(refuse())
        }
    }

    /// A dictionary whose values are numbers within limits, for the names in `known`; 0 where not given.
    pub fn numbers(&self, name: &str, known: &[&str], low: f64, high: f64) -> Result<Vec<f64>> {
        let empty = Map::new();
        let map = match self.get(name) {
            None => &empty,
            Some(value) => value.as_object().ok_or_else(|| {
                Error::parameter(
                    name,
                    value,
                    format!("a dictionary with keys {}", known.join(", ")),
                )
            })?,
        };
        check_names(map, known)?;
        let read = |key: &&str| {
            let full = format!("{name}['{key}']");
            map.get(*key).map_or(Ok(0.0), |value| number(&full, value, low, high))
        };
        known.iter().map(read).collect()
    }
}

/// Refuses names that are not in `known`.
pub fn check_names(given: &Map<String, Value>, known: &[&str]) -> Result<()> {
    match given.keys().find(|name| !known.contains(&name.as_str())) {
        None => Ok(()),
        Some(name) => Err(Error::UnknownParameter { name: name.clone(), known: known.join(", ") }),
    }
}

/// A finite number within `[low, high]`.
pub fn number(name: &str, value: &Value, low: f64, high: f64) -> Result<f64> {
    let fits = value.as_f64().filter(|x| (low..=high).contains(x));
    let allowed =
        || if low == high { low.to_string() } else { format!("a number from {low} to {high}") };
    fits.ok_or_else(|| Error::parameter(name, value, allowed()))
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

/// Reads exact parameter values, as given to `reset`; `None` where not given.
pub fn exact_parameters(
    given: &Map<String, Value>,
    table: &[Parameter],
) -> Result<Vec<Option<f64>>> {
    let known: Vec<&str> = table.iter().map(|p| p.name).collect();
    check_names(given, &known)?;
    let read = |p: &Parameter| {
        given.get(p.name).map(|value| number(p.name, value, p.low, p.high)).transpose()
    };
    table.iter().map(read).collect()
}

/// How a parameter is drawn for an episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Draw {
    /// Always the same.
    Fixed(f64),
    /// Uniform between two values.
    Uniform(f64, f64),
    /// Log-uniform between two positive values.
    LogUniform(f64, f64),
}

impl Draw {
    /// Draws a value.
    pub fn draw(&self, stream: &mut Stream) -> f64 {
        match *self {
            Draw::Fixed(value) => value,
            Draw::Uniform(low, high) => stream.uniform(low, high),
            Draw::LogUniform(low, high) => stream.log_uniform(low, high),
        }
    }

    /// Smallest and largest value.
    pub fn bounds(&self) -> (f64, f64) {
        match *self {
            Draw::Fixed(value) => (value, value),
            Draw::Uniform(low, high) | Draw::LogUniform(low, high) => (low, high),
        }
    }

    /// How each parameter of a table is drawn: `values`, unless `randomize` has a `(low, high)` or
    /// `("log_uniform", low, high)` for its name.
    pub fn table(
        keywords: &Keywords<'_>,
        table: &[Parameter],
        values: &[f64],
    ) -> Result<Vec<Draw>> {
        let mut draws: Vec<Draw> = values.iter().map(|&value| Draw::Fixed(value)).collect();
        let Some(value) = keywords.get("randomize") else { return Ok(draws) };
        let allowed = "a dictionary such as {'width': (0.006, 0.009)}";
        let map = value.as_object().ok_or_else(|| Error::parameter("randomize", value, allowed))?;
        let known: Vec<&str> = table.iter().map(|p| p.name).collect();
        check_names(map, &known)?;
        for (draw, parameter) in draws.iter_mut().zip(table) {
            if let Some(value) = map.get(parameter.name) {
                *draw = Draw::read(parameter, value)?;
            }
        }
        Ok(draws)
    }

    fn read(parameter: &Parameter, value: &Value) -> Result<Draw> {
        let (least, most) = (parameter.low, parameter.high);
        let name = format!("randomize['{}']", parameter.name);
        let refuse = || {
            let pair = format!("(low, high) with {least} <= low <= high <= {most}");
            let allowed = format!("{pair}, or ('log_uniform', low, high) with low > 0");
            Error::parameter(&name, value, allowed)
        };
        let (log, pair) = match value.as_array().map(Vec::as_slice) {
            Some([word, rest @ ..]) if word.as_str() == Some("log_uniform") => (true, rest),
            Some(pair) => (false, pair),
            None => return Err(refuse()),
        };
        let [low, high] = pair else { return Err(refuse()) };
        let (Some(low), Some(high)) = (low.as_f64(), high.as_f64()) else { return Err(refuse()) };
        if !(least <= low && low <= high && high <= most && (!log || low > 0.0)) {
            return Err(refuse());
        }
        Ok(if log { Draw::LogUniform(low, high) } else { Draw::Uniform(low, high) })
    }
}
