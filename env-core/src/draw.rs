//! How the parameters of an episode are drawn, or set exactly.

use crate::error::{Error, Result};
use crate::given::{check_names, number};
use crate::keywords::{Parameter, RANDOMIZE};
use crate::seed::Stream;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// How a parameter is drawn for an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
        for (i, draw) in Draw::ranges(value, table)? {
            draws[i] = draw;
        }
        Ok(draws)
    }

    /// The ranges of a `randomize`, with the places of their parameters in the table.
    ///
    /// # Errors
    /// Those of `table`.
    pub fn ranges(randomize: &Value, table: &[Parameter]) -> Result<Vec<(usize, Draw)>> {
        let refuse = || Error::parameter(RANDOMIZE.name, randomize, RANDOMIZE.allowed.text());
        let map = randomize.as_object().ok_or_else(refuse)?;
        let known: Vec<&str> = table.iter().map(|p| p.name).collect();
        check_names(map, &known)?;
        let given = table.iter().enumerate().filter_map(|(i, p)| Some((i, p, map.get(p.name)?)));
        given.map(|(i, p, value)| Ok((i, Draw::read(p, value)?))).collect()
    }

    /// Refuses draws that no keywords make.
    ///
    /// # Errors
    /// Not one for each parameter, or beyond its range.
    pub fn check(draws: &[Draw], table: &[Parameter]) -> Result<()> {
        let fits = |(draw, parameter): (&Draw, &Parameter)| {
            let (low, high) = draw.bounds();
            let positive = !matches!(draw, Draw::LogUniform(..)) || low > 0.0;
            parameter.low <= low && low <= high && high <= parameter.high && positive
        };
        if draws.len() == table.len() && draws.iter().zip(table).all(fits) {
            return Ok(());
        }
        Err(Error::snapshot("it draws parameters from beyond their ranges"))
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
