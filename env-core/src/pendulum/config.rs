//! Keywords of the pendulum environments, checked.

use crate::env::Parameter;
use crate::error::{Error, Result};
use crate::keywords::{Draw, Keywords, whole};
use crate::rod::Uniform;
use crate::stepper::Scheme;
use serde_json::{Map, Value, json};
use std::f64::consts::PI;

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

/// Which task is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// From hanging to upright.
    SwingUp,
    /// Stay up.
    Balance,
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

const OTHERS: &[&str] = &[
    "nodes",
    "stepper",
    "physics_dt",
    "control_dt",
    "observation",
    "start_angle",
    "start_bend",
    "randomize",
    "sensor_noise",
    "actuator_delay",
    "torque_disturbance",
    "thesis",
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
    /// Task to play.
    pub task: Task,
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
pub fn uniform(nodes: usize, values: &[f64]) -> Uniform {
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
    /// Reads the keywords of a task; `sensors` is what it shows unless asked otherwise.
    ///
    /// # Errors
    /// Unknown keywords, values outside their ranges, a physics step beyond the stepper's limit.
    pub fn new(task: Task, sensors: Sensors, given: &Map<String, Value>) -> Result<Config> {
        let names = PARAMETERS.iter().map(|p| p.name).chain(OTHERS.iter().copied());
        let keywords = Keywords::new(given, &names.collect::<Vec<_>>())?;
        let thesis = keywords.flag("thesis", false)?;
        let mut values = Vec::with_capacity(COUNT);
        for p in PARAMETERS {
            let damped = p.name == "bending_damping";
            values.push(keywords.parameter(p, if thesis && damped { 0.0 } else { p.default })?);
        }
        let draws = Draw::table(&keywords, PARAMETERS, &values)?;
        let nodes = keywords.integer("nodes", 7, 2, 1001)? as usize;
        let control_dt = keywords.number("control_dt", 0.01, 1e-5, 1.0)?;
        let bounds: Vec<_> = draws.iter().map(Draw::bounds).collect();
        let limit = verlet_limit(nodes, &bounds);
        let (scheme, physics_dt, substeps) = timing(&keywords, thesis, control_dt, limit)?;
        let words = ["full", "base", "tip"];
        let default = words[sensors as usize];
        let sensors = match keywords.choice("observation", default, &words)? {
            "full" => Sensors::Full,
            "base" => Sensors::Base,
            _ => Sensors::Tip,
        };
        let (angle, bend) = match task {
            Task::SwingUp => ((-0.1, 0.1), (0.0, 0.0)),
            Task::Balance => ((PI - 0.05, PI + 0.05), (-0.2, 0.2)),
        };
        let noise = keywords.numbers("sensor_noise", &["angle", "rate"], 0.0, 100.0)?;
        let delay = keywords.number("actuator_delay", 0.0, 0.0, 10.0 * control_dt)?;
        let config = Config {
            task,
            nodes,
            draws,
            sensors,
            scheme,
            physics_dt,
            control_dt,
            substeps,
            start_angle: keywords.range("start_angle", angle, (-10.0, 10.0))?,
            start_bend: keywords.range("start_bend", bend, (-10.0, 10.0))?,
            noise: [noise[0], noise[1]],
            delay: whole("actuator_delay", delay, physics_dt)?,
            disturbance: keywords.number("torque_disturbance", 0.0, 0.0, 1e4)?,
            resolved: Map::new(),
        };
        Ok(config.with_resolved(&values, given, thesis))
    }

    fn with_resolved(mut self, values: &[f64], given: &Map<String, Value>, thesis: bool) -> Self {
        let mut map = Map::new();
        for (p, value) in PARAMETERS.iter().zip(values) {
            map.insert(p.name.into(), json!(value));
        }
        map.insert("nodes".into(), json!(self.nodes));
        map.insert("stepper".into(), json!(self.scheme.name()));
        map.insert("physics_dt".into(), json!(self.physics_dt));
        map.insert("control_dt".into(), json!(self.control_dt));
        let sensors = ["full", "base", "tip"][self.sensors as usize];
        map.insert("observation".into(), json!(sensors));
        map.insert("start_angle".into(), json!([self.start_angle.0, self.start_angle.1]));
        map.insert("start_bend".into(), json!([self.start_bend.0, self.start_bend.1]));
        map.insert("randomize".into(), given.get("randomize").cloned().unwrap_or(json!({})));
        let noise = json!({"angle": self.noise[0], "rate": self.noise[1]});
        map.insert("sensor_noise".into(), noise);
        map.insert("actuator_delay".into(), json!(self.delay as f64 * self.physics_dt));
        map.insert("torque_disturbance".into(), json!(self.disturbance));
        map.insert("thesis".into(), json!(thesis));
        self.resolved = map;
        self
    }
}

/// Scheme, physics step and physics steps a control step.
fn timing(
    keywords: &Keywords<'_>,
    thesis: bool,
    control_dt: f64,
    limit: f64,
) -> Result<(Scheme, f64, usize)> {
    let words = ["auto", "verlet", "backward_euler", "implicit"];
    let default = if thesis { "backward_euler" } else { "auto" };
    let word = keywords.choice("stepper", default, &words)?;
    let asked = keywords.optional("physics_dt", 1e-7, 1.0)?;
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
    Ok((scheme, dt, substeps))
}
