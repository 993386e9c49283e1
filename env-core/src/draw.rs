//! How the parameters of an episode are drawn, or set exactly.

mod together;

pub use together::{MOST, Normal, REACH};

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
    /// Its logarithm is normal, together with those of others.
    LogNormal(Normal),
}

impl Draw {
    /// Draws the values of all N parameters: in their order, then those that are normal together. (An array: an episode
    /// begins within a step, which takes no memory.)
    ///
    /// # Panics
    /// When `check` would refuse the draws, or there are fewer than N.
    pub fn all<const N: usize>(draws: &[Draw], stream: &mut Stream) -> [f64; N] {
        let mut one = |draw: &Draw| match *draw {
            Draw::Fixed(value) => value,
            Draw::Uniform(low, high) => stream.uniform(low, high),
            Draw::LogUniform(low, high) => stream.log_uniform(low, high),
            Draw::LogNormal(normal) => normal.median,
        };
        let mut values = std::array::from_fn(|i| one(&draws[i]));
        together::draw(draws, stream, &mut values);
        values
    }

    /// Smallest and largest value.
    pub fn bounds(&self) -> (f64, f64) {
        match self {
            Draw::Fixed(value) => (*value, *value),
            Draw::Uniform(low, high) | Draw::LogUniform(low, high) => (*low, *high),
            Draw::LogNormal(normal) => normal.bounds(),
        }
    }

    /// How each parameter of a table is drawn: `values`, unless `randomize` has a `(low, high)`,
    /// `("log_uniform", low, high)` or `("log_normal", median, deviation, {other: correlation})`
    /// for its name.
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
        together::check(&draws, table)?;
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
        given.map(|(i, p, value)| Ok((i, Draw::read(p, value, table)?))).collect()
    }

    /// Refuses correlations that no numbers have.
    ///
    /// # Errors
    /// Two that contradict each other, or too many parameters that are normal together.
    pub fn check_together(draws: &[Draw], table: &[Parameter]) -> Result<()> {
        together::check(draws, table)
    }

    /// Refuses draws that no keywords make.
    ///
    /// # Errors
    /// Not one for each parameter, or beyond its range.
    pub fn check(draws: &[Draw], table: &[Parameter]) -> Result<()> {
        let fits = |(draw, parameter): (&Draw, &Parameter)| {
            let (low, high) = draw.bounds();
            let positive = match draw {
                Draw::LogUniform(low, _) => *low > 0.0,
                Draw::LogNormal(normal) => normal.is_sound(),
                _ => true,
            };
            parameter.low <= low && low <= high && high <= parameter.high && positive
        };
        let each = draws.len() == table.len() && draws.iter().zip(table).all(fits);
        if each && together::check(draws, table).is_ok() {
            return Ok(());
        }
        Err(Error::snapshot("it draws parameters from beyond their ranges"))
    }

    fn read(parameter: &Parameter, value: &Value, table: &[Parameter]) -> Result<Draw> {
        let (least, most) = (parameter.low, parameter.high);
        let name = named(parameter);
        let refuse = || {
            let pair = format!("(low, high) with {least} <= low <= high <= {most}");
            let log = "('log_uniform', low, high) with low > 0";
            let normal = "('log_normal', median, deviation)";
            Error::parameter(&name, value, format!("{pair}, or {log}, or {normal}"))
        };
        if let Some([word, rest @ ..]) = value.as_array().map(Vec::as_slice)
            && word.as_str() == Some("log_normal")
        {
            let normal = Normal::read(parameter, rest, table);
            return normal.map(Draw::LogNormal);
        }
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

/// A parameter of `randomize`, as errors name it.
fn named(parameter: &Parameter) -> String {
    format!("{}['{}']", RANDOMIZE.name, parameter.name)
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
