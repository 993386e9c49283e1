//! What a machine's keywords are: one table that says what each takes and what it is, from which they are read
//! (`reader`), listed and documented.

use crate::given::between;
use serde::{Serialize, Serializer};

/// A physical parameter: name, unit, default and allowed range. Its name is the same word everywhere: keyword,
/// `info["parameters"]`, report column.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Keyword.
    pub name: &'static str,
    /// SI unit, empty where there is none.
    pub unit: &'static str,
    /// Default value.
    pub default: f64,
    /// Smallest allowed value.
    pub low: f64,
    /// Largest allowed value.
    pub high: f64,
    /// What it is, in one sentence.
    pub doc: &'static str,
}

/// One keyword of a machine, beside its physical parameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Keyword {
    /// Its name.
    pub name: &'static str,
    /// SI unit, empty where there is none.
    pub unit: &'static str,
    /// The default in words that a user would type, or in a few that say what it depends on.
    pub default: &'static str,
    /// What it takes.
    #[serde(serialize_with = "as_text")]
    pub allowed: Allowed,
    /// What it is, in a few words.
    pub doc: &'static str,
    /// Whether the bare simulation takes it, too.
    pub bare: bool,
}

/// What a keyword takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Allowed {
    /// A number between two bounds.
    Number(f64, f64),
    /// The same, or `None` for none at all.
    NumberOrNone(f64, f64),
    /// An integer between two bounds.
    Integer(u64, u64),
    /// True or false.
    Flag,
    /// One of a few words.
    Choice(&'static [&'static str]),
    /// A pair low <= high between two bounds.
    Range(f64, f64),
    /// A dictionary of numbers between two bounds; what is left out is 0.
    Numbers(&'static [&'static str], f64, f64),
    /// Something that its machine reads by itself, in words.
    Other(&'static str),
}

impl Allowed {
    /// In words, as errors have it.
    pub fn text(&self) -> String {
        match self {
            Allowed::Number(low, high) => between(*low, *high),
            Allowed::NumberOrNone(low, high) => format!("{}, or None", between(*low, *high)),
            Allowed::Integer(low, high) => format!("an integer from {low} to {high}"),
            Allowed::Flag => "true or false".into(),
            Allowed::Choice(words) => {
                let quoted: Vec<String> = words.iter().map(|word| format!("'{word}'")).collect();
                format!("one of {}", quoted.join(", "))
            }
            Allowed::Range(low, high) => {
                format!("a pair (low, high) with {low} <= low <= high <= {high}")
            }
            Allowed::Numbers(keys, ..) => format!("a dictionary with keys {}", keys.join(", ")),
            Allowed::Other(words) => (*words).into(),
        }
    }
}

fn as_text<S: Serializer>(
    allowed: &Allowed,
    serializer: S,
) -> std::result::Result<S::Ok, S::Error> {
    serializer.serialize_str(&allowed.text())
}

/// The row of `randomize`, which every machine has.
pub const RANDOMIZE: Keyword = Keyword {
    name: "randomize",
    unit: "",
    default: "{}",
    allowed: Allowed::Other("a dictionary such as {'width': (0.006, 0.009)}"),
    doc: "{parameter: (low, high), ('log_uniform', low, high) or ('log_normal', median, deviation of the logarithm, {other parameter: correlation})}, drawn each episode",
    bare: false,
};

/// The row of `preset`, of machines that have a published one.
pub const fn preset(words: &'static [&'static str], doc: &'static str) -> Keyword {
    let allowed = Allowed::Choice(words);
    Keyword { name: "preset", unit: "", default: "None", allowed, doc, bare: true }
}

/// Burch's 2019 thesis, as `preset` knows it.
pub const THESIS_PRESET: &str = "burch2019";

/// The row of `thesis`, the short word for that preset.
pub const THESIS: Keyword = Keyword {
    name: "thesis",
    unit: "",
    default: "False",
    allowed: Allowed::Flag,
    doc: "the same as `preset=\"burch2019\"`",
    bare: true,
};

/// Names that a bare simulation takes: parameters, and the keywords that say so.
pub fn bare_names<'a>(
    parameters: impl IntoIterator<Item = &'a Parameter>,
    keywords: &'static [Keyword],
) -> Vec<&'static str> {
    let bare = keywords.iter().filter(|keyword| keyword.bare).map(|keyword| keyword.name);
    parameters.into_iter().map(|parameter| parameter.name).chain(bare).collect()
}
