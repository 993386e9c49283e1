//! Reads the keywords that a user gave by the table of their machine. Every refusal names the keyword, the value and
//! what is allowed.

use crate::draw::Draw;
use crate::error::{Error, Result};
use crate::given::{check_keywords, check_names, number};
use crate::keywords::{Allowed, Keyword, Parameter, RANDOMIZE, THESIS, THESIS_PRESET};
use serde_json::{Map, Value, json};

/// Reads the keywords that a user gave by a machine's table, and notes the value that each resolves to.
pub struct Reader<'a> {
    given: &'a Map<String, Value>,
    table: &'static [Keyword],
    resolved: Map<String, Value>,
}

impl<'a> Reader<'a> {
    /// Refuses names that are neither a parameter nor in the table.
    ///
    /// # Errors
    /// Names the first of them.
    pub fn new(
        given: &'a Map<String, Value>,
        parameters: &[Parameter],
        table: &'static [Keyword],
    ) -> Result<Self> {
        let names = parameters.iter().map(|p| p.name).chain(table.iter().map(|k| k.name));
        check_keywords(given, &names.collect::<Vec<_>>())?;
        Ok(Reader { given, table, resolved: Map::new() })
    }

    /// The value of a keyword; `None` where it was not given or is null.
    pub fn get(&self, name: &str) -> Option<&'a Value> {
        self.given.get(name).filter(|value| !value.is_null())
    }

    /// Notes what a keyword resolves to, where that is not just what was read.
    pub fn note(&mut self, name: &str, value: impl Into<Value>) {
        self.resolved.insert(name.into(), value.into());
    }

    fn allowed(&self, name: &str) -> Allowed {
        let row = self.table.iter().find(|row| row.name == name);
        row.unwrap_or_else(|| panic!("the keyword {name} is not in the table")).allowed
    }

    /// What is given for a keyword of a certain kind: its value, as `read` has it.
    fn read<T>(
        &self,
        name: &str,
        read: impl FnOnce(&Value, Allowed) -> Option<T>,
    ) -> Result<Option<T>> {
        let allowed = self.allowed(name);
        let Some(value) = self.get(name) else { return Ok(None) };
        let refuse = || Error::parameter(name, value, allowed.text());
        read(value, allowed).map(Some).ok_or_else(refuse)
    }

    /// A number within the table's bounds, if it was given; nothing is noted.
    ///
    /// # Errors
    /// Anything else (so for all that follow).
    pub fn asked(&self, name: &str) -> Result<Option<f64>> {
        self.read(name, |value, allowed| match allowed {
            Allowed::Number(low, high) | Allowed::NumberOrNone(low, high) => {
                value.as_f64().filter(|x| (low..=high).contains(x))
            }
            _ => None,
        })
    }

    /// A number within the table's bounds.
    pub fn number(&mut self, name: &str, default: f64) -> Result<f64> {
        let value = self.asked(name)?.unwrap_or(default);
        self.note(name, value);
        Ok(value)
    }

    /// A number within bounds that depend on other keywords.
    pub fn number_within(&mut self, name: &str, default: f64, low: f64, high: f64) -> Result<f64> {
        let value = self.get(name).map_or(Ok(default), |value| number(name, value, low, high))?;
        self.note(name, value);
        Ok(value)
    }

    /// The same as `number`, or `None` where null was given.
    pub fn number_or_none(&mut self, name: &str, default: f64) -> Result<Option<f64>> {
        let none = self.given.get(name).is_some_and(Value::is_null);
        let value = if none { None } else { Some(self.asked(name)?.unwrap_or(default)) };
        self.note(name, value);
        Ok(value)
    }

    /// An integer within the table's bounds.
    pub fn integer(&mut self, name: &str, default: u64) -> Result<u64> {
        let found = self.read(name, |value, allowed| match allowed {
            Allowed::Integer(low, high) => value.as_u64().filter(|n| (low..=high).contains(n)),
            _ => None,
        })?;
        let value = found.unwrap_or(default);
        self.note(name, value);
        Ok(value)
    }

    /// True or false.
    pub fn flag(&mut self, name: &str, default: bool) -> Result<bool> {
        let value = self.read(name, |value, _| value.as_bool())?.unwrap_or(default);
        self.note(name, value);
        Ok(value)
    }

    /// One of the table's words, if it was given; nothing is noted.
    fn word(&self, name: &str) -> Result<Option<&'static str>> {
        self.read(name, |value, allowed| match allowed {
            Allowed::Choice(words) => {
                words.iter().copied().find(|word| Some(*word) == value.as_str())
            }
            _ => None,
        })
    }

    /// One of the table's words.
    pub fn choice(&mut self, name: &str, default: &'static str) -> Result<&'static str> {
        let value = self.word(name)?.unwrap_or(default);
        self.note(name, value);
        Ok(value)
    }

    /// Whether the thesis' values are asked for, by `preset` or by its short word.
    ///
    /// # Errors
    /// An unknown preset, or one that `thesis` contradicts.
    pub fn thesis(&mut self) -> Result<bool> {
        let preset = self.word("preset")?;
        let thesis = self.flag(THESIS.name, preset.is_some())?;
        if preset.is_some() && !thesis {
            let allowed = "True, or left out, beside preset='burch2019'";
            return Err(Error::parameter(THESIS.name, thesis, allowed));
        }
        self.note("preset", thesis.then_some(THESIS_PRESET));
        Ok(thesis)
    }

    /// A pair low <= high within the table's bounds.
    pub fn range(&mut self, name: &str, default: (f64, f64)) -> Result<(f64, f64)> {
        let found = self.read(name, |value, allowed| {
            let Allowed::Range(least, most) = allowed else { return None };
            let [low, high] = value.as_array()?.as_slice() else { return None };
            let (low, high) = (low.as_f64()?, high.as_f64()?);
            (least <= low && low <= high && high <= most).then_some((low, high))
        })?;
        let (low, high) = found.unwrap_or(default);
        self.note(name, json!([low, high]));
        Ok((low, high))
    }

    /// Numbers by the table's keys, 0 where not given.
    pub fn numbers<const N: usize>(&mut self, name: &str) -> Result<[f64; N]> {
        let Allowed::Numbers(keys, low, high) = self.allowed(name) else {
            panic!("the keyword {name} is no dictionary of numbers");
        };
        let mut values = [0.0; N];
        if let Some(map) = self.read(name, |value, _| value.as_object().cloned())? {
            check_names(&map, keys)?;
            for (slot, key) in values.iter_mut().zip(keys) {
                if let Some(value) = map.get(*key) {
                    *slot = number(&format!("{name}['{key}']"), value, low, high)?;
                }
            }
        }
        let noted: Map<String, Value> =
            keys.iter().zip(values).map(|(key, value)| ((*key).into(), value.into())).collect();
        self.note(name, noted);
        Ok(values)
    }

    /// The values of all physical parameters.
    pub fn parameters(
        &mut self,
        table: &[Parameter],
        default: impl Fn(&Parameter) -> f64,
    ) -> Result<Vec<f64>> {
        let mut values = Vec::with_capacity(table.len());
        for row in table {
            let value = self.get(row.name).map(|value| number(row.name, value, row.low, row.high));
            let value = value.transpose()?.unwrap_or_else(|| default(row));
            self.note(row.name, value);
            values.push(value);
        }
        Ok(values)
    }

    /// How each parameter is drawn: `values`, unless `randomize` has a range for its name, or is not given and the
    /// machine has a `usual` one.
    pub fn draws(
        &mut self,
        table: &[Parameter],
        values: &[f64],
        usual: Option<Value>,
    ) -> Result<Vec<Draw>> {
        let randomize = self.get(RANDOMIZE.name).cloned().or(usual);
        let draws = Draw::table(randomize.as_ref(), table, values)?;
        self.note(RANDOMIZE.name, randomize.unwrap_or_else(|| json!({})));
        Ok(draws)
    }

    /// Every keyword with the value that it resolved to.
    ///
    /// # Panics
    /// When the machine has left out a keyword of its table.
    pub fn resolved(self) -> Map<String, Value> {
        let missing = self.table.iter().find(|row| !self.resolved.contains_key(row.name));
        assert!(missing.is_none(), "the keyword {missing:?} was never read");
        self.resolved
    }
}
