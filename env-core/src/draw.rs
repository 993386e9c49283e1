//! How the parameters of an episode are drawn, or set exactly.

use crate::error::{Error, Result};
use crate::given::{check_names, number};
use crate::keywords::Parameter;
use crate::seed::Stream;
use serde_json::{Map, Value};

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
    ///
    /// # Errors
    /// A `randomize` that is none, or a range beyond the parameter's.
    pub fn table(
        randomize: Option<&Value>,
        table: &[Parameter],
        values: &[f64],
    ) -> Result<Vec<Draw>> {
        let mut draws: Vec<Draw> = values.iter().map(|&value| Draw::Fixed(value)).collect();
        let Some(value) = randomize else { return Ok(draws) };
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
