//! Parameters whose logarithms are normal together: what a fit knows of a rod, an ellipsoid.
//!
//! With medians m, deviations s of the logarithms and their correlations C = L L^T, the values are
//! m exp(s L z): z is standard normal, drawn again while its length is above `REACH`. So nothing is
//! drawn from beyond the ellipsoid of so many deviations, and ranges can be checked beforehand.

use super::{Draw, named};
use crate::error::{Error, Result};
use crate::given::{check_names, number};
use crate::keywords::Parameter;
use crate::seed::Stream;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Draws are no farther from the median than so many deviations, all parameters together.
pub const REACH: f64 = 3.0;
/// At most so many parameters are normal together.
pub const MOST: usize = 8;
/// The largest deviation of a logarithm: a factor of ten between median and bound.
const WIDEST: f64 = 0.75;
/// A place that no correlation takes.
const NOBODY: u16 = u16::MAX;

/// A parameter whose logarithm is normal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Normal {
    /// The value in the middle.
    pub median: f64,
    /// Standard deviation of the logarithm.
    pub deviation: f64,
    /// Places in the table of other parameters, and the correlations of the logarithms. Those with
    /// parameters that are not drawn normally, too, count nothing: what is left is the distribution
    /// of the others.
    correlations: [(u16, f64); MOST - 1],
}

impl Normal {
    /// Reads `median, deviation` and perhaps `{other: correlation}`.
    ///
    /// # Errors
    /// Names what is not allowed.
    pub fn read(parameter: &Parameter, given: &[Value], table: &[Parameter]) -> Result<Normal> {
        let name = named(parameter);
        let refuse = |what: String| {
            let form = "('log_normal', median, deviation) or ('log_normal', median, deviation, {other: correlation})";
            Error::parameter(&name, Value::Array(given.to_vec()), format!("{form} {what}"))
        };
        let (median, deviation, others) = match given {
            [median, deviation] => (median, deviation, None),
            [median, deviation, others] => (median, deviation, Some(others)),
            _ => return Err(refuse(String::new())),
        };
        let (Some(median), Some(deviation)) = (median.as_f64(), deviation.as_f64()) else {
            return Err(refuse("with numbers".into()));
        };
        let mut normal = Normal { median, deviation, correlations: [(NOBODY, 0.0); MOST - 1] };
        if !normal.is_sound() {
            return Err(refuse(format!("with median > 0 and deviation from 0 to {WIDEST}")));
        }
        let ((low, high), Parameter { low: least, high: most, .. }) = (normal.bounds(), parameter);
        if !(*least <= low && high <= *most) {
            return Err(refuse(format!(
                "with {least} <= median exp(-{REACH} deviation) and median exp({REACH} deviation) <= {most}"
            )));
        }
        if let Some(others) = others {
            let map = others
                .as_object()
                .filter(|map| map.len() < MOST)
                .ok_or_else(|| refuse(format!("with at most {} correlations", MOST - 1)))?;
            check_names(map, &table.iter().map(|p| p.name).collect::<Vec<_>>())?;
            if map.contains_key(parameter.name) {
                return Err(refuse("with correlations to others".into()));
            }
            let places =
                table.iter().enumerate().filter_map(|(i, p)| Some((i, p, map.get(p.name)?)));
            for (slot, (i, p, value)) in normal.correlations.iter_mut().zip(places) {
                let place = format!("the correlation of {} in {name}", p.name);
                *slot = (i as u16, number(&place, value, -1.0, 1.0)?);
            }
        }
        Ok(normal)
    }

    /// Smallest and largest value.
    pub fn bounds(&self) -> (f64, f64) {
        let factor = libm::exp(REACH * self.deviation);
        (self.median / factor, self.median * factor)
    }

    /// Whether the numbers are those of a distribution.
    pub(super) fn is_sound(&self) -> bool {
        self.median > 0.0 && self.median.is_finite() && (0.0..=WIDEST).contains(&self.deviation)
    }

    fn with(&self, place: usize) -> Option<f64> {
        self.correlations.iter().find(|(i, _)| usize::from(*i) == place).map(|(_, c)| *c)
    }
}

/// The lower triangle L of the correlations of those that are normal together, with their places.
struct Factor {
    places: [usize; MOST],
    lower: [[f64; MOST]; MOST],
    count: usize,
}

/// Factors the correlations.
///
/// # Errors
/// Says what is wrong with them, in words.
fn factor(draws: &[Draw], table: &[Parameter]) -> std::result::Result<Factor, String> {
    let name = |i: usize| table.get(i).map_or("?", |p| p.name);
    let mut found = Factor { places: [0; MOST], lower: [[0.0; MOST]; MOST], count: 0 };
    let mut normals = [None; MOST];
    for (place, draw) in draws.iter().enumerate() {
        let Draw::LogNormal(normal) = draw else { continue };
        if found.count == MOST {
            return Err(format!("at most {MOST} parameters that are drawn 'log_normal'"));
        }
        (found.places[found.count], normals[found.count]) = (place, Some(normal));
        found.count += 1;
    }
    for i in 0..found.count {
        for j in 0..=i {
            let (one, other) = (found.places[i], found.places[j]);
            let said = |i: usize, at: usize| normals[i].and_then(|normal| normal.with(at));
            let (mine, theirs) = (said(i, other), said(j, one));
            if let (Some(mine), Some(theirs)) = (mine, theirs)
                && mine != theirs
            {
                let (one, other) = (name(one), name(other));
                return Err(format!(
                    "one correlation of {one} and {other}, not {mine} and {theirs}"
                ));
            }
            let correlation = if i == j { 1.0 } else { mine.or(theirs).unwrap_or(0.0) };
            let (rows, column) = (&found.lower, j);
            let dot = (0..column).fold(0.0, |sum, k| sum + rows[i][k] * rows[j][k]);
            let rest = correlation - dot;
            found.lower[i][j] = if i == j {
                // Two that are the same number but for a factor are allowed: rest 0, or just below.
                if rest < -1e-9 {
                    return Err("correlations that numbers can have together".into());
                }
                libm::sqrt(rest.max(0.0))
            } else if found.lower[j][j] > 1e-9 {
                rest / found.lower[j][j]
            } else {
                0.0
            };
        }
    }
    Ok(found)
}

/// Refuses correlations that no numbers have.
pub(super) fn check(draws: &[Draw], table: &[Parameter]) -> Result<()> {
    let refuse = |allowed: String| Error::parameter("randomize", "'log_normal'", allowed);
    factor(draws, table).map(drop).map_err(refuse)
}

/// Draws the values that are normal together.
pub(super) fn draw(draws: &[Draw], stream: &mut Stream, values: &mut [f64]) {
    if !draws.iter().any(|draw| matches!(draw, Draw::LogNormal(_))) {
        return;
    }
    let Factor { places, lower, count } = factor(draws, &[]).expect("the draws were checked");
    let mut z = [0.0; MOST];
    loop {
        z[..count].iter_mut().for_each(|z| *z = stream.normal());
        if z[..count].iter().fold(0.0, |sum, z| sum + z * z) <= REACH * REACH {
            break;
        }
    }
    for (i, &place) in places[..count].iter().enumerate() {
        let Draw::LogNormal(normal) = draws[place] else { continue };
        let shift = (0..=i).fold(0.0, |sum, j| sum + lower[i][j] * z[j]);
        // (Rounding may leave the ellipsoid, and so the parameter's range, by a last digit.)
        let (low, high) = normal.bounds();
        values[place] = (normal.median * libm::exp(normal.deviation * shift)).clamp(low, high);
    }
}

#[cfg(test)]
mod tests {
    //! Draws have the medians, deviations and correlations that were asked for, and never leave
    //! the ellipsoid.

    use super::*;
    use crate::pendulum::PARAMETERS;
    use serde_json::json;

    fn draws(randomize: Value) -> Result<Vec<Draw>> {
        let values: Vec<f64> = PARAMETERS.iter().map(|p| p.default).collect();
        Draw::table(Some(&randomize), PARAMETERS, &values)
    }

    fn place(name: &str) -> usize {
        PARAMETERS.iter().position(|p| p.name == name).unwrap()
    }

    #[test]
    fn what_is_drawn_has_the_covariance_that_was_asked_for() {
        let draws = draws(json!({
            "youngs_modulus": ["log_normal", 9e6, 0.02],
            "bending_damping": ["log_normal", 5e-4, 0.05, {"youngs_modulus": -0.7}],
            "width": ["log_normal", 0.007, 0.01, {"youngs_modulus": 0.4, "length": 0.9}],
            "density": [1400.0, 1600.0],
        }))
        .unwrap();
        let mut stream = Stream::new(3);
        let names = ["youngs_modulus", "bending_damping", "width"];
        let (medians, deviations) = ([9e6, 5e-4, 0.007], [0.02, 0.05, 0.01]);
        let (n, mut sums, mut products) = (40_000, [0.0; 3], [[0.0; 3]; 3]);
        for _ in 0..n {
            let values = Draw::all::<{ PARAMETERS.len() }>(&draws, &mut stream);
            assert!((1400.0..1600.0).contains(&values[place("density")]));
            let z: [f64; 3] = std::array::from_fn(|i| {
                libm::log(values[place(names[i])] / medians[i]) / deviations[i]
            });
            for i in 0..3 {
                assert!(z[i].abs() <= REACH * (1.0 + 1e-12));
                sums[i] += z[i] / n as f64;
                (0..3).for_each(|j| products[i][j] += z[i] * z[j] / n as f64);
            }
        }
        // What lies beyond three deviations is cut off: of three numbers together, 2.9 % of the
        // draws, and with them a part of the variance: P(chi2 of 5 < 9) / P(chi2 of 3 < 9).
        let left = 0.890_936 / 0.970_709;
        let asked = [[1.0, -0.7, 0.4], [-0.7, 1.0, 0.0], [0.4, 0.0, 1.0]];
        for i in 0..3 {
            assert!(sums[i].abs() < 0.02, "mean {}", sums[i]);
            for j in 0..3 {
                let (got, want) = (products[i][j], left * asked[i][j]);
                assert!((got - want).abs() < 0.02, "{i} {j}: {got} instead of {want}");
            }
        }
    }

    #[test]
    fn other_parameters_are_drawn_as_without_them() {
        let plain = draws(json!({"density": [1400.0, 1600.0]})).unwrap();
        let both = json!({"density": [1400.0, 1600.0], "width": ["log_normal", 0.007, 0.01]});
        let both = draws(both).unwrap();
        let first = |draws: &[Draw]| {
            Draw::all::<{ PARAMETERS.len() }>(draws, &mut Stream::new(5))[place("density")]
        };
        assert_eq!(first(&plain), first(&both));
    }

    #[test]
    fn what_is_no_distribution_is_refused_by_name() {
        for (given, says) in [
            (json!(["log_normal", 9e6]), "log_normal"),
            (json!(["log_normal", -9e6, 0.1]), "median > 0"),
            (json!(["log_normal", 9e6, 0.9]), "0.75"),
            (json!(["log_normal", 9e6, "wide"]), "numbers"),
            (json!(["log_normal", 9e6, 0.1, {"widht": 0.1}]), "widht"),
            (json!(["log_normal", 9e6, 0.1, {"youngs_modulus": 1.0}]), "others"),
            (json!(["log_normal", 9e6, 0.1, {"width": 1.1}]), "width"),
            (json!(["log_normal", 9e6, 0.1, 0.5]), "correlations"),
            (json!(["log_normal", 1e30, 0.1]), "<="),
        ] {
            let error = draws(json!({"youngs_modulus": given})).unwrap_err().to_string();
            assert!(
                error.contains(says) && error.contains("youngs_modulus") | (says == "widht"),
                "{error}"
            );
        }
        let impossible = json!({
            "youngs_modulus": ["log_normal", 9e6, 0.02, {"width": 0.9, "density": 0.9}],
            "density": ["log_normal", 1500.0, 0.02, {"width": -0.9}],
            "width": ["log_normal", 0.007, 0.02],
        });
        assert!(draws(impossible).unwrap_err().to_string().contains("together"));
        let twice = json!({
            "youngs_modulus": ["log_normal", 9e6, 0.02, {"width": 0.9}],
            "width": ["log_normal", 0.007, 0.02, {"youngs_modulus": 0.8}],
        });
        assert!(draws(twice).unwrap_err().to_string().contains("one correlation"));
    }
}
