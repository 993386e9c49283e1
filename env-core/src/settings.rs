//! How the parameters of episodes to come are drawn, as far as that is changed between episodes.

use crate::draw::Draw;
use crate::error::{Error, Result};
use crate::given::{check_names, number};
use crate::keywords::Parameter;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Changes for some environments of a batch, effective from the next episode of each.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Values by name: one for all of these environments, or a list with one each. They are not drawn any more.
    pub parameters: Map<String, Value>,
    /// Ranges that parameters are drawn from by now, as the keyword `randomize` has them.
    pub randomize: Map<String, Value>,
}

/// The same, checked against a table: place and value of each parameter.
pub(crate) struct Changes {
    values: Vec<(usize, Vec<f64>)>,
    ranges: Vec<(usize, Draw)>,
}

impl Settings {
    /// Reads the changes for `count` environments.
    ///
    /// # Errors
    /// A name that is none, a value or range beyond a parameter's, a list of another length.
    pub(crate) fn read(&self, table: &[Parameter], count: usize) -> Result<Changes> {
        let known: Vec<&str> = table.iter().map(|p| p.name).collect();
        check_names(&self.parameters, &known)?;
        let mut values = Vec::new();
        for (i, p) in table.iter().enumerate() {
            let one = |value: &Value, name: &str| number(name, value, p.low, p.high);
            match self.parameters.get(p.name) {
                None => {}
                Some(Value::Array(list)) if list.len() == count => {
                    let named = |(k, value)| one(value, &format!("{}[{k}]", p.name));
                    values.push((i, list.iter().enumerate().map(named).collect::<Result<_>>()?));
                }
                Some(Value::Array(list)) => {
                    return Err(Error::Shape {
                        name: p.name.into(),
                        got: format!("({},)", list.len()),
                        expected: format!("({count},), or one number,"),
                    });
                }
                Some(value) => values.push((i, vec![one(value, p.name)?])),
            }
        }
        let ranges = Draw::ranges(&Value::Object(self.randomize.clone()), table)?;
        Ok(Changes { values, ranges })
    }
}

impl Changes {
    /// Makes them in the draws of the environment in place `k` of those concerned.
    pub(crate) fn make(&self, k: usize, draws: &mut [Draw]) {
        for (i, values) in &self.values {
            draws[*i] = Draw::Fixed(values[k % values.len()]);
        }
        for (i, range) in &self.ranges {
            draws[*i] = *range;
        }
    }
}
