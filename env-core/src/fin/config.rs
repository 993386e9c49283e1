//! Keywords of the fin environments, checked.

use super::geometry::Geometry;
use super::parameters::Parameters;
use super::plant::{Design, Scheme};
use super::servo::Ticks;
use crate::env::Parameter;
use crate::error::{Error, Result};
use crate::fluid::Hydrodynamics;
use crate::keywords::{Draw, Keywords, check_names, number, whole};
use serde_json::{Map, Value, json};

/// Largest pitch \[rad\].
#[expect(clippy::approx_constant, reason = "a bound that people type, not pi/6")]
const PITCH_BOUND: f64 = 0.5236;

/// Which task is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// Much thrust for little power.
    Thrust,
    /// A demanded thrust at the least power.
    Efficiency,
    /// Swim forward with a hull.
    Swim,
}

/// Which numbers the agent sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensors {
    /// Servo, shape and forces.
    Full,
    /// The sideways positions of the nodes, as a camera sees them, and the servo's command.
    Camera,
}

const OTHERS: &[&str] = &[
    "hydrodynamics",
    "stepper",
    "physics_dt",
    "control_dt",
    "pitch_limit",
    "command_cutoff",
    "power_weight",
    "geometry",
    "stiffness_profile",
    "observation",
    "start_pitch",
    "demand",
    "randomize",
    "sensor_noise",
    "actuator_delay",
    "thesis",
];

/// Place of `youngs_modulus` in the table.
const STIFFNESS: usize = 0;
/// Range of Young's modulus in `FinThrust`, about the soft fin's 2.5e5 Pa, unless a value or `randomize` is given
/// \[Pa\]. For a fin that is known beforehand the best sinusoid is nearly the best that can be done; one that must
/// be felt is worth controlling (docs/fin.md).
const SOFT: (f64, f64) = (3e4, 3e6);

/// Physics step of BDF2, unless asked otherwise \[s\].
const BDF2_DT: f64 = 4e-3;
/// Physics step of backward Euler, unless asked otherwise \[s\].
const EULER_DT: f64 = 1e-3;
/// Cut-off of the low-pass in front of the servo, unless asked otherwise \[Hz\]: beyond 5 Hz, where the model of
/// the water is not to be trusted, less than 1 % of a command is left.
const CUTOFF: f64 = 3.0;

/// A fin environment's configuration.
#[derive(Clone, Debug)]
pub struct Config {
    /// Task to play.
    pub task: Task,
    /// Shape, water and stepping.
    pub design: Design,
    /// How each parameter is drawn.
    pub draws: Vec<Draw>,
    /// What the agent sees.
    pub sensors: Sensors,
    /// Control step \[s\].
    pub control_dt: f64,
    /// Physics steps of a control step.
    pub substeps: usize,
    /// Pitch at command 1 \[rad\].
    pub pitch_limit: f64,
    /// Cut-off of the low-pass in front of the servo \[Hz\], if there is one.
    pub command_cutoff: Option<f64>,
    /// How servo and low-pass advance.
    pub ticks: Ticks,
    /// Factor of the reward's power term.
    pub power_weight: f64,
    /// Range of the pitch at the start \[rad\].
    pub start_pitch: (f64, f64),
    /// Range of the demanded thrust \[N\].
    pub demand: (f64, f64),
    /// Standard deviation of the measured angles \[rad\] and rates \[rad/s\].
    pub noise: [f64; 2],
    /// Physics steps by which the command lags behind the action.
    pub delay: usize,
    /// Keywords as resolved.
    pub resolved: Map<String, Value>,
}

impl Config {
    /// Reads the keywords of a task.
    ///
    /// # Errors
    /// Unknown keywords, values outside their ranges, steps that do not divide each other.
    pub fn new(task: Task, given: &Map<String, Value>) -> Result<Config> {
        let table = Parameters::table_of(task);
        let names = table.iter().map(|p| p.name).chain(OTHERS.iter().copied());
        let keywords = Keywords::new(given, &names.collect::<Vec<_>>())?;
        let thesis = keywords.flag("thesis", false)?;
        let defaults = if thesis { Parameters::thesis() } else { Parameters::default() };
        let mut values = Vec::with_capacity(table.len());
        for (i, parameter) in table.iter().enumerate() {
            let default = defaults.get(i).min(parameter.high);
            values.push(keywords.parameter(parameter, default)?);
        }
        let mut draws = Draw::table(&keywords, &table, &values)?;
        let drawn = task == Task::Thrust
            && !thesis
            && keywords.get("randomize").is_none()
            && keywords.get(table[STIFFNESS].name).is_none();
        if drawn {
            draws[STIFFNESS] = Draw::LogUniform(SOFT.0, SOFT.1);
        }
        let models: Vec<&str> = Hydrodynamics::NAMES.iter().map(|(name, _)| *name).collect();
        let hydrodynamics = keywords.choice("hydrodynamics", "lighthill", &models)?;
        let default = if thesis { "backward_euler" } else { "auto" };
        let scheme =
            match keywords.choice("stepper", default, &["auto", "bdf2", "backward_euler"])? {
                "backward_euler" => Scheme::BackwardEuler,
                _ => Scheme::Bdf2,
            };
        let control_dt = keywords.number("control_dt", 0.04, 1e-6, 1.0)?;
        let usual = if scheme == Scheme::Bdf2 { BDF2_DT } else { EULER_DT };
        // The small reduction keeps an exact quotient from being rounded up.
        let divided = control_dt / libm::ceil(control_dt / usual - 1e-9);
        let physics_dt = keywords.number("physics_dt", divided, 1e-6, 0.04)?;
        let substeps = whole("control_dt", control_dt, physics_dt)?;
        let delay = keywords.number("actuator_delay", 0.0, 0.0, 10.0 * control_dt)?;
        let command_cutoff = cutoff(given)?;
        // The thesis' fin is stiff and damped: at the usual price of power it earns nothing whatever it does.
        let weight = if thesis { 0.5 } else { 1.0 };
        let noise = keywords.numbers("sensor_noise", &["angle", "rate"], 0.0, 100.0)?;
        let design = Design {
            geometry: geometry(&keywords)?,
            hydrodynamics: Hydrodynamics::from_name(hydrodynamics)?,
            scheme,
            physics_dt,
            free_swimming: task == Task::Swim,
        };
        design.check()?;
        let config = Config {
            task,
            design,
            draws,
            sensors: match keywords.choice("observation", "full", &["full", "camera"])? {
                "full" => Sensors::Full,
                _ => Sensors::Camera,
            },
            control_dt,
            substeps,
            pitch_limit: keywords.number("pitch_limit", 20f64.to_radians(), 1e-3, PITCH_BOUND)?,
            command_cutoff,
            ticks: Ticks::new(physics_dt, command_cutoff),
            power_weight: keywords.number("power_weight", weight, 0.0, 100.0)?,
            start_pitch: keywords.range("start_pitch", (-0.1, 0.1), (-PITCH_BOUND, PITCH_BOUND))?,
            demand: keywords.range("demand", (0.02, 0.15), (1e-3, 10.0))?,
            noise: [noise[0], noise[1]],
            delay: whole("actuator_delay", delay, physics_dt)?,
            resolved: Map::new(),
        };
        Ok(config.with_resolved(&table, &values, given, thesis))
    }

    fn with_resolved(
        mut self,
        table: &[Parameter],
        values: &[f64],
        given: &Map<String, Value>,
        thesis: bool,
    ) -> Self {
        let geometry = &self.design.geometry;
        let scheme = if self.design.scheme == Scheme::Bdf2 { "bdf2" } else { "backward_euler" };
        let sensors = if self.sensors == Sensors::Full { "full" } else { "camera" };
        let randomize = match given.get("randomize").filter(|value| !value.is_null()) {
            Some(value) => value.clone(),
            None if matches!(self.draws[STIFFNESS], Draw::LogUniform(..)) => {
                json!({table[STIFFNESS].name: ["log_uniform", SOFT.0, SOFT.1]})
            }
            None => json!({}),
        };
        let others = json!({
            "hydrodynamics": self.design.hydrodynamics.name(),
            "stepper": scheme,
            "physics_dt": self.design.physics_dt,
            "control_dt": self.control_dt,
            "pitch_limit": self.pitch_limit,
            "command_cutoff": self.command_cutoff,
            "power_weight": self.power_weight,
            "geometry": {
                "edge_length": geometry.edge_length,
                "height": geometry.height,
                "pivot": geometry.pivot,
                "widths": geometry.widths,
                "areas": geometry.areas,
            },
            "stiffness_profile": geometry.stiffness,
            "observation": sensors,
            "start_pitch": [self.start_pitch.0, self.start_pitch.1],
            "demand": [self.demand.0, self.demand.1],
            "randomize": randomize,
            "sensor_noise": {"angle": self.noise[0], "rate": self.noise[1]},
            "actuator_delay": self.delay as f64 * self.design.physics_dt,
            "thesis": thesis,
        });
        for (parameter, value) in table.iter().zip(values) {
            self.resolved.insert(parameter.name.into(), json!(value));
        }
        if let Value::Object(others) = others {
            self.resolved.extend(others);
        }
        self
    }
}

/// Cut-off of the low-pass \[Hz\]: 3 Hz, unless it is given; given as null there is none.
fn cutoff(given: &Map<String, Value>) -> Result<Option<f64>> {
    match given.get("command_cutoff") {
        None => Ok(Some(CUTOFF)),
        Some(Value::Null) => Ok(None),
        Some(value) => {
            let fits = value.as_f64().filter(|f| (0.1..=100.0).contains(f));
            let allowed = "a number from 0.1 to 100, or None for no low-pass";
            fits.map(Some).ok_or_else(|| Error::parameter("command_cutoff", value, allowed))
        }
    }
}

/// The shape: Table 3.1, or the columns of the keyword `geometry`, with `stiffness_profile`.
fn geometry(keywords: &Keywords<'_>) -> Result<Geometry> {
    let mut geometry = Geometry::thesis();
    if let Some(value) = keywords.get("geometry") {
        let known = ["edge_length", "height", "pivot", "widths", "areas"];
        let allowed = format!("a dictionary with keys {}", known.join(", "));
        let map = value.as_object().ok_or_else(|| Error::parameter("geometry", value, allowed))?;
        check_names(map, &known)?;
        let name = |key: &str| format!("geometry['{key}']");
        if let Some(value) = map.get("edge_length") {
            geometry.edge_length = number(&name("edge_length"), value, 1e-4, 1.0)?;
        }
        if let Some(value) = map.get("height") {
            geometry.height = number(&name("height"), value, 1e-3, 10.0)?;
        }
        if let Some(value) = map.get("pivot") {
            let refuse = || Error::parameter(name("pivot"), value, "the index of a node, from 0");
            geometry.pivot = value.as_u64().ok_or_else(refuse)? as usize;
        }
        if let Some(value) = map.get("widths") {
            geometry.widths = column(&name("widths"), value)?;
            // Without areas of its own, a fin of other widths has full rectangular sections.
            geometry.areas = geometry.widths.iter().map(|w| w * geometry.height).collect();
            geometry.stiffness = vec![1.0; geometry.widths.len()];
        }
        if let Some(value) = map.get("areas") {
            geometry.areas = column(&name("areas"), value)?;
        }
    }
    if let Some(value) = keywords.get("stiffness_profile") {
        geometry.stiffness = column("stiffness_profile", value)?;
    }
    Ok(geometry)
}

/// A list of finite numbers.
fn column(name: &str, value: &Value) -> Result<Vec<f64>> {
    let refuse = || Error::parameter(name, value, "a list of finite numbers, one a node");
    let list = value.as_array().ok_or_else(refuse)?;
    list.iter().map(|item| item.as_f64().filter(|x| x.is_finite()).ok_or_else(refuse)).collect()
}
