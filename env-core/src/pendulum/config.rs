//! Keywords of the pendulum environments, checked.

use super::accuracy;
use crate::draw::Draw;
use crate::error::{Error, Result};
use crate::given::whole;
use crate::keywords::{Allowed, Keyword, Parameter, RANDOMIZE, THESIS, THESIS_PRESET, preset};
use crate::lane::Real;
use crate::reader::Reader;
use crate::rod::Uniform;
use crate::solver::Scheme;
use serde_json::{Map, Value, json};

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
        "auto: what keeps the tip within 1e-4 of the length; else 2e-4 with Verlet, 1e-3 with others",
    )),
    bare(keyword(
        "stepper",
        "",
        "\"auto\"",
        Allowed::Choice(&[
            "auto",
            "verlet",
            "backward_euler",
            "implicit",
            "bdf2",
            "tr_bdf2",
            "esdirk3",
        ]),
        "auto: the cheaper of verlet and esdirk3 (with physics_dt: verlet where stable, else implicit)",
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
    keyword(
        "start_rate",
        "rad/s",
        "(0, 0)",
        Allowed::Range(-100.0, 100.0),
        "(low, high) of the rate at which the whole rod turns at the start",
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
        "actuator_gain",
        "",
        "1",
        Allowed::Number(0.01, 10.0),
        "torque that arrives over torque commanded",
    ),
    keyword(
        "torque_disturbance",
        "N m",
        "0",
        Allowed::Number(0.0, 1e4),
        "standard deviation of a torque drawn each step",
    ),
    keyword(
        "push",
        "N m, s",
        "{}",
        Allowed::Numbers(&["torque", "start", "duration"], -1e4, 1e4),
        "a torque at the base beside the motor's, from `start` on, for `duration`",
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

/// A torque at the base beside the motor's, once an episode: a knock at the motor's shaft. It stands at the base, not at
/// the tip, so that its size says how it compares with what the motor can do.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Push {
    /// Torque \[N m\]; 0: no push.
    pub torque: f64,
    /// Begin, from the start of the episode \[s\].
    pub start: f64,
    /// Duration \[s\].
    pub duration: f64,
}

impl Push {
    fn read(reader: &mut Reader<'_>) -> Result<Push> {
        let [torque, start, duration] = reader.numbers("push")?;
        if start < 0.0 {
            return Err(Error::parameter("push['start']", start, "a number from 0 to 10000, in s"));
        }
        // A push that lasts no time would do nothing without a word.
        if duration < 0.0 || (torque != 0.0 && duration == 0.0) {
            let allowed = "a number above 0, at most 10000, in s";
            return Err(Error::parameter("push['duration']", duration, allowed));
        }
        Ok(Push { torque, start, duration })
    }

    /// Its mean torque \[N m\] over a control step that begins `steps` steps after the episode did: the impulse is
    /// the same whatever the step.
    #[inline(always)]
    pub fn mean<R: Real>(&self, steps: R, control_dt: f64) -> R {
        let begin = R::splat(self.start / control_dt).max(steps);
        let end = R::splat((self.start + self.duration) / control_dt).min(steps + R::one());
        R::splat(self.torque) * (end - begin).max(R::zero())
    }
}

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
    /// What the tip is off after 1 s of free swing, at most, over the rod's length, where that is known.
    pub error: Option<f64>,
    /// Whether scheme and step were to be chosen so that the tip is within `accuracy::CONTRACT`.
    pub promised: bool,
    /// Range of the first edge's start angle, from hanging \[rad\].
    pub start_angle: (f64, f64),
    /// Range of the start angle's growth from first to last edge \[rad\].
    pub start_bend: (f64, f64),
    /// Range of the rate at which all edges turn at the start \[rad/s\].
    pub start_rate: (f64, f64),
    /// Standard deviation of the measured angles \[rad\] and rates \[rad/s\].
    pub noise: [f64; 2],
    /// Physics steps by which the torque lags behind the action.
    pub delay: usize,
    /// Torque that arrives over torque commanded.
    pub gain: f64,
    /// Standard deviation of a random torque, drawn each control step \[N m\].
    pub disturbance: f64,
    /// Once an episode.
    pub push: Push,
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
        let timing = timing(&mut reader, thesis, control_dt, (nodes, &bounds, limit))?;
        let Timing { scheme, physics_dt, substeps, promised } = timing;
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
            error: accuracy::error(scheme, physics_dt, nodes, &bounds),
            promised,
            start_angle: reader.range("start_angle", setup.start_angle)?,
            start_bend: reader.range("start_bend", setup.start_bend)?,
            start_rate: reader.range("start_rate", (0.0, 0.0))?,
            noise: reader.numbers("sensor_noise")?,
            delay,
            gain: reader.number("actuator_gain", 1.0)?,
            disturbance: reader.number("torque_disturbance", 0.0)?,
            push: Push::read(&mut reader)?,
            resolved: reader.resolved(),
        })
    }
}

impl Config {
    /// What users should know of the error, where no default keeps it within the contract.
    pub fn warning(&self) -> Option<String> {
        let contract = accuracy::CONTRACT;
        if !self.promised || self.error.is_some_and(|error| error <= contract * 1.000_001) {
            return None;
        }
        let error = match self.error {
            Some(error) => format!("is estimated to be off by {error:.1e} of its length"),
            None => "follows no path that smaller steps converge to".into(),
        };
        Some(format!(
            "after 1 s of free swing the tip of this rod {error} ({} steps of {:.3e} s; elsewhere the promise is {contract:.0e}): more damping, a stiffer rod or a smaller physics_dt help",
            self.scheme.name(),
            self.physics_dt
        ))
    }
}

/// How time is divided.
struct Timing {
    scheme: Scheme,
    physics_dt: f64,
    substeps: usize,
    promised: bool,
}

/// Scheme, physics step and physics steps a control step. The rod: nodes, bounds of its parameters, Verlet's limit.
fn timing(
    reader: &mut Reader<'_>,
    thesis: bool,
    control_dt: f64,
    (nodes, bounds, limit): (usize, &[(f64, f64)], f64),
) -> Result<Timing> {
    let word = reader.choice("stepper", if thesis { "backward_euler" } else { "auto" })?;
    let asked = reader.asked("physics_dt")?;
    let divided = |dt: f64| control_dt / (control_dt / dt - 1e-9).ceil();
    let (scheme, dt) = match (word, asked) {
        ("verlet", _) => (Scheme::Verlet, divided(VERLET_DT)),
        ("backward_euler", _) if thesis => (Scheme::BackwardEuler, divided(THESIS_DT)),
        ("backward_euler", _) => (Scheme::BackwardEuler, divided(IMPLICIT_DT)),
        ("implicit", _) => (Scheme::Implicit, divided(IMPLICIT_DT)),
        ("bdf2", _) => (Scheme::Bdf2, divided(IMPLICIT_DT)),
        ("tr_bdf2", _) => (Scheme::TrBdf2, divided(IMPLICIT_DT)),
        ("esdirk3", _) => (Scheme::Esdirk3, divided(IMPLICIT_DT)),
        (_, Some(dt)) if dt <= limit => (Scheme::Verlet, dt),
        (_, Some(dt)) => (Scheme::Implicit, dt),
        (_, None) => {
            let choice = accuracy::choose(nodes, bounds, limit, control_dt);
            // A delay is a multiple of the physics step: where one is asked for, steps that divide it.
            let delay = reader.get("actuator_delay").and_then(Value::as_f64).unwrap_or(0.0);
            let whole = |steps: &usize| {
                let late = delay / control_dt * *steps as f64;
                (late - late.round()).abs() < 1e-9
            };
            let steps = (choice.steps..=64 * choice.steps).find(whole).unwrap_or(choice.steps);
            (choice.scheme, control_dt / steps as f64)
        }
    };
    let physics_dt = asked.unwrap_or(dt);
    if scheme == Scheme::Verlet && physics_dt > limit {
        let (name, value) = match asked {
            Some(dt) => ("physics_dt", json!(dt)),
            None => ("stepper", json!("verlet")),
        };
        let allowed = format!(
            "a physics_dt of at most {limit:.3e} s for the verlet stepper with these parameters, or another stepper (tr_bdf2 and esdirk3 have no limit)"
        );
        return Err(Error::parameter(name, value, allowed));
    }
    let substeps = whole("control_dt", control_dt, physics_dt)?;
    reader.note("stepper", scheme.name());
    reader.note("physics_dt", physics_dt);
    let promised = word == "auto" && asked.is_none();
    Ok(Timing { scheme, physics_dt, substeps, promised })
}
