//! Keywords of the pendulum environments, checked.

use crate::draw::Draw;
use crate::error::{Error, Result};
use crate::given::whole;
use crate::keywords::{Allowed, Keyword, Parameter, RANDOMIZE, THESIS, THESIS_PRESET, preset};
use crate::lane::Real;
use crate::reader::Reader;
use crate::rod::Uniform;
use crate::solver::Scheme;
use serde_json::{Map, Value};

/// Which numbers the agent sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensors {
    /// Angle and rate of every edge.
    Full,
    /// Angle and rate of the first edge: what the thesis observer has.
    Base,
    /// Position and velocity of the last node.
    Tip,
}

impl Sensors {
    const WORDS: [&str; 3] = ["full", "base", "tip"];

    fn word(self) -> &'static str {
        Sensors::WORDS[self as usize]
    }
}

/// What a task asks of the pendulum, unless the user asks otherwise.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// What the agent sees.
    pub sensors: Sensors,
    /// Range of the first edge's start angle, from hanging \[rad\].
    pub start_angle: (f64, f64),
    /// Range of the start angle's growth from first to last edge \[rad\].
    pub start_bend: (f64, f64),
}

impl Default for Setup {
    /// A straight rod that nearly hangs, every edge seen.
    fn default() -> Self {
        Setup { sensors: Sensors::Full, start_angle: (-0.1, 0.1), start_bend: (0.0, 0.0) }
    }
}

/// Physical parameters of the pendulum, in the order of `info["parameters"]` (thesis Table 4.1).
pub const PARAMETERS: &[Parameter] = &[
    parameter("width", "m", 0.007, 5e-4, 0.1, "side of the rod's square section"),
    parameter("length", "m", 0.3, 0.02, 10.0, "length of the rod at rest"),
    parameter("density", "kg/m^3", 1500.0, 10.0, 3e4, "density of the rod"),
    parameter("youngs_modulus", "Pa", 1e7, 1e3, 1e12, "Young's modulus E of the rod"),
    parameter("damping", "kg/s", 0.0, 0.0, 10.0, "nodal damping zeta, force -zeta v at each node"),
    parameter("bending_damping", "s", 5e-4, 0.0, 1.0, "Kelvin-Voigt bending damping beta"),
    parameter("gravity", "m/s^2", 9.81, 0.0, 100.0, "gravity, pointing down"),
    parameter("torque_limit", "N m", 0.05, 1e-6, 1e4, "base torque at action 1"),
];
/// Places of parameters in the table.
pub mod at {
    #![allow(missing_docs, reason = "names of the table's rows")]
    pub const WIDTH: usize = 0;
    pub const LENGTH: usize = 1;
    pub const DENSITY: usize = 2;
    pub const YOUNGS_MODULUS: usize = 3;
    pub const DAMPING: usize = 4;
    pub const BENDING_DAMPING: usize = 5;
    pub const GRAVITY: usize = 6;
    pub const TORQUE_LIMIT: usize = 7;
}
/// Number of parameters.
pub const COUNT: usize = PARAMETERS.len();

const fn parameter(
    name: &'static str,
    unit: &'static str,
    default: f64,
    low: f64,
    high: f64,
    doc: &'static str,
) -> Parameter {
    Parameter { name, unit, default, low, high, doc }
}

const fn keyword(
    name: &'static str,
    unit: &'static str,
    default: &'static str,
    allowed: Allowed,
    doc: &'static str,
) -> Keyword {
    Keyword { name, unit, default, allowed, doc, bare: false }
}

const fn bare(keyword: Keyword) -> Keyword {
    Keyword { bare: true, ..keyword }
}

/// The other keywords.
pub const KEYWORDS: &[Keyword] = &[
    bare(keyword("nodes", "", "7", Allowed::Integer(2, 1001), "number of nodes")),
    keyword("observation", "", "\"full\"", Allowed::Choice(&Sensors::WORDS), "what the agent sees"),
    keyword(
        "control_dt",
        "s",
        "0.01",
        Allowed::Number(1e-5, 1.0),
        "duration of a step, a multiple of `physics_dt`",
    ),
    bare(keyword(
        "physics_dt",
        "s",
        "chosen",
        Allowed::Number(1e-7, 1.0),
        "2e-4 with Verlet, 1e-3 with an implicit stepper",
    )),
    bare(keyword(
        "stepper",
        "",
        "\"auto\"",
        Allowed::Choice(&["auto", "verlet", "backward_euler", "implicit"]),
        "auto: verlet where stable, else implicit",
    )),
    keyword(
        "start_angle",
        "rad",
        "by task",
        Allowed::Range(-10.0, 10.0),
        "(low, high) of the start angle from hanging",
    ),
    keyword(
        "start_bend",
        "rad",
        "by task",
        Allowed::Range(-10.0, 10.0),
        "(low, high) of the angle's growth along the rod",
    ),
    RANDOMIZE,
    keyword(
        "sensor_noise",
        "rad, rad/s",
        "{}",
        Allowed::Numbers(&["angle", "rate"], 0.0, 100.0),
        "standard deviations of the measured angles and rates",
    ),
    keyword(
        "actuator_delay",
        "s",
        "0",
        Allowed::Other("a multiple of physics_dt, from 0 to 10 control_dt"),
        "lag of the torque behind the action",
    ),
    keyword(
        "torque_disturbance",
        "N m",
        "0",
        Allowed::Number(0.0, 1e4),
        "standard deviation of a torque drawn each step",
    ),
    preset(&[THESIS_PRESET], "the thesis' parameters, stepper and step"),
    THESIS,
];

/// Physics step with Verlet, unless asked otherwise \[s\].
const VERLET_DT: f64 = 2e-4;
/// Physics step with an implicit stepper, unless asked otherwise \[s\].
const IMPLICIT_DT: f64 = 1e-3;
/// The thesis' own step \[s\].
const THESIS_DT: f64 = 1e-4;

/// A pendulum environment's configuration.
#[derive(Clone, Debug)]
pub struct Config {
    /// Number of nodes.
    pub nodes: usize,
    /// How each parameter is drawn.
    pub draws: Vec<Draw>,
    /// What the agent sees.
    pub sensors: Sensors,
    /// Scheme of the physics.
    pub scheme: Scheme,
    /// Physics step \[s\].
    pub physics_dt: f64,
    /// Control step \[s\].
    pub control_dt: f64,
    /// Physics steps of a control step.
    pub substeps: usize,
    /// Range of the first edge's start angle, from hanging \[rad\].
    pub start_angle: (f64, f64),
    /// Range of the start angle's growth from first to last edge \[rad\].
    pub start_bend: (f64, f64),
    /// Standard deviation of the measured angles \[rad\] and rates \[rad/s\].
    pub noise: [f64; 2],
    /// Physics steps by which the torque lags behind the action.
    pub delay: usize,
    /// Standard deviation of a random torque, drawn each control step \[N m\].
    pub disturbance: f64,
    /// Keywords as resolved.
    pub resolved: Map<String, Value>,
}

/// A rod with the given parameters, in the order of the table.
pub fn uniform<R: Real>(nodes: usize, values: &[R]) -> Uniform<R> {
    Uniform {
        nodes,
        length: values[at::LENGTH],
        width: values[at::WIDTH],
        density: values[at::DENSITY],
        youngs_modulus: values[at::YOUNGS_MODULUS],
        damping: values[at::DAMPING],
        bending_damping: values[at::BENDING_DAMPING],
        gravity: values[at::GRAVITY],
    }
}

/// Smallest Verlet limit over all corners of the parameters' ranges \[s\].
pub fn verlet_limit(nodes: usize, bounds: &[(f64, f64)]) -> f64 {
    let corner = |bits: usize| {
        let pick =
            |(i, range): (usize, &(f64, f64))| if bits >> i & 1 == 0 { range.0 } else { range.1 };
        let values: Vec<f64> = bounds.iter().enumerate().map(pick).collect();
        uniform(nodes, &values).verlet_limit()
    };
    (0..1usize << bounds.len()).map(corner).fold(f64::INFINITY, f64::min)
}

impl Config {
    /// Reads the keywords; `setup` is what the task asks for unless the user asks otherwise.
    ///
    /// # Errors
    /// Unknown keywords, values outside their ranges, a physics step beyond the stepper's limit.
    pub fn new(setup: &Setup, given: &Map<String, Value>) -> Result<Config> {
        let mut reader = Reader::new(given, PARAMETERS, KEYWORDS)?;
        let thesis = reader.thesis()?;
        let damped = PARAMETERS[at::BENDING_DAMPING].name;
        let values = reader
            .parameters(PARAMETERS, |p| if thesis && p.name == damped { 0.0 } else { p.default })?;
        let draws = reader.draws(PARAMETERS, &values, None)?;
        let nodes = reader.integer("nodes", 7)? as usize;
        let control_dt = reader.number("control_dt", 0.01)?;
        let bounds: Vec<_> = draws.iter().map(Draw::bounds).collect();
        let limit = verlet_limit(nodes, &bounds);
        let (scheme, physics_dt, substeps) = timing(&mut reader, thesis, control_dt, limit)?;
        let sensors = match reader.choice("observation", setup.sensors.word())? {
            "full" => Sensors::Full,
            "base" => Sensors::Base,
            _ => Sensors::Tip,
        };
        let delay = reader.number_within("actuator_delay", 0.0, 0.0, 10.0 * control_dt)?;
        let delay = whole("actuator_delay", delay, physics_dt)?;
        reader.note("actuator_delay", delay as f64 * physics_dt);
        Ok(Config {
            nodes,
            draws,
            sensors,
            scheme,
            physics_dt,
            control_dt,
            substeps,
            start_angle: reader.range("start_angle", setup.start_angle)?,
            start_bend: reader.range("start_bend", setup.start_bend)?,
            noise: reader.numbers("sensor_noise")?,
            delay,
            disturbance: reader.number("torque_disturbance", 0.0)?,
            resolved: reader.resolved(),
        })
    }
}

/// Scheme, physics step and physics steps a control step.
fn timing(
    reader: &mut Reader<'_>,
    thesis: bool,
    control_dt: f64,
    limit: f64,
) -> Result<(Scheme, f64, usize)> {
    let word = reader.choice("stepper", if thesis { "backward_euler" } else { "auto" })?;
    let asked = reader.asked("physics_dt")?;
    let divided = |dt: f64| control_dt / (control_dt / dt - 1e-9).ceil();
    let scheme = match word {
        "verlet" => Scheme::Verlet,
        "backward_euler" => Scheme::BackwardEuler,
        "implicit" => Scheme::Implicit,
        _ if asked.unwrap_or(divided(VERLET_DT)) <= limit => Scheme::Verlet,
        _ => Scheme::Implicit,
    };
    let default = match scheme {
        _ if thesis => THESIS_DT,
        Scheme::Verlet => VERLET_DT,
        _ => IMPLICIT_DT,
    };
    let dt = asked.unwrap_or(divided(default));
    if scheme == Scheme::Verlet && dt > limit {
        let allowed = format!(
            "at most {limit:.3e} s for the verlet stepper with these parameters (stepper='implicit' has no limit)"
        );
        return Err(Error::parameter("physics_dt", dt, allowed));
    }
    let substeps = whole("control_dt", control_dt, dt)?;
    reader.note("stepper", scheme.name());
    reader.note("physics_dt", dt);
    Ok((scheme, dt, substeps))
}
