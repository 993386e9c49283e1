//! Keywords of the fin environments, checked.

use super::design::Design;
use super::geometry::Geometry;
use super::parameters::Parameters;
use super::servo::Ticks;
use crate::draw::Draw;
use crate::error::{Error, Result};
use crate::fluid::Hydrodynamics;
use crate::given::{check_names, number, whole};
use crate::keywords::{Allowed, Keyword, Parameter, RANDOMIZE, THESIS, THESIS_PRESET, preset};
use crate::reader::Reader;
use crate::solver::Scheme;
use serde_json::{Map, Value, json};

/// Largest pitch \[rad\].
#[expect(clippy::approx_constant, reason = "a bound that people type, not pi/6")]
const PITCH_BOUND: f64 = 0.5236;

/// What a task asks of the fin, unless the user asks otherwise.
#[derive(Clone, Copy, Debug, Default)]
pub struct Setup {
    /// Whether the pivot is free along x and pushes a hull through water at rest.
    pub free_swimming: bool,
    /// Range that Young's modulus is drawn from, log-uniform, where nothing else is asked for \[Pa\].
    pub stiffness: Option<(f64, f64)>,
}

/// Which numbers the agent sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensors {
    /// Servo, shape and forces.
    Full,
    /// The sideways positions of the nodes, as a camera sees them, and the servo's command.
    Camera,
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
    bare(keyword(
        "hydrodynamics",
        "",
        "\"lighthill\"",
        Allowed::Choice(&["lighthill", "morison", "resistive", "air"]),
        "forces of the water",
    )),
    keyword(
        "pitch_limit",
        "rad",
        "0.349",
        Allowed::Number(1e-3, PITCH_BOUND),
        "pitch at action 1, at most 30 degrees",
    ),
    bare(keyword(
        "command_cutoff",
        "Hz",
        "3",
        Allowed::NumberOrNone(0.1, 100.0),
        "cut-off of the low-pass of the command, None: no low-pass",
    )),
    keyword(
        "power_weight",
        "",
        "1",
        Allowed::Number(0.0, 100.0),
        "factor of the reward's power term (0.5 with `thesis=True`)",
    ),
    bare(keyword(
        "geometry",
        "m, m^2",
        "Table 3.1",
        Allowed::Other("a dictionary with keys edge_length, height, pivot, widths, areas"),
        "{\"edge_length\", \"height\", \"pivot\", \"widths\", \"areas\"}",
    )),
    bare(keyword(
        "stiffness_profile",
        "",
        "1 at each node",
        Allowed::Other("a list of finite numbers, one a node"),
        "multiplies `youngs_modulus`, node by node",
    )),
    keyword(
        "observation",
        "",
        "\"full\"",
        Allowed::Choice(&["full", "camera"]),
        "what the agent sees",
    ),
    keyword(
        "control_dt",
        "s",
        "0.04",
        Allowed::Number(1e-6, 1.0),
        "duration of a step, a multiple of `physics_dt`",
    ),
    bare(keyword(
        "physics_dt",
        "s",
        "chosen",
        Allowed::Number(1e-6, 0.04),
        "with BDF2 4e-3 (E below 6e4 Pa: 1.6e-3; morison water: 2e-3), with backward Euler 1e-3",
    )),
    bare(keyword(
        "stepper",
        "",
        "\"auto\"",
        Allowed::Choice(&["auto", "bdf2", "backward_euler"]),
        "auto: bdf2",
    )),
    keyword(
        "start_pitch",
        "rad",
        "(-0.1, 0.1)",
        Allowed::Range(-PITCH_BOUND, PITCH_BOUND),
        "range of the start pitch",
    ),
    keyword(
        "demand",
        "N",
        "(0.02, 0.15)",
        Allowed::Range(1e-3, 10.0),
        "range of the demanded thrust (Efficiency)",
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
        "by which the command lags behind the action",
    ),
    bare(keyword(
        "actuator_gain",
        "",
        "1",
        Allowed::Number(0.01, 10.0),
        "pitch that the servo goes to over pitch commanded; at most 30 degrees over `pitch_limit`",
    )),
    keyword(
        "command_disturbance",
        "",
        "0",
        Allowed::Number(0.0, 1.0),
        "standard deviation of what is drawn and added to the command each step, before its low-pass",
    ),
    preset(&[THESIS_PRESET], "the thesis' material (8.11 MPa, damping 0.1238 kg/s) and stepper"),
    THESIS,
];

/// Places in the table.
const STIFFNESS: usize = 0;
const DAMPING: usize = 1;

/// Physics step of BDF2, unless asked otherwise \[s\]: thrust and power within a period at 10 degrees, 1.5 Hz are then
/// within 1 % of their root mean squares (`docs/performance/accuracy.md`).
const BDF2_DT: f64 = 4e-3;
/// The same for a fin that is known to be softer than `FLOPPY` \[Pa\], where a higher mode answers the beat and 4 ms leave
/// up to 3.5 %. (Where stiffness is drawn from a range, few fins are so soft, and all would pay.)
const FLOPPY_DT: f64 = 1.6e-3;
const FLOPPY: f64 = 6e4;
/// The same in `morison` water, which takes nothing from a fin that beats: its vibration stays.
const MORISON_DT: f64 = 2e-3;
/// There, Young's modulus \[Pa\] below which nothing but damping brings the vibration within 1 %, and down to where
/// the thesis' damping does.
const VIBRATES: (f64, f64) = (2.5e5, 1e5);
/// Physics step of backward Euler, unless asked otherwise \[s\].
const EULER_DT: f64 = 1e-3;
/// Cut-off of the low-pass in front of the servo, unless asked otherwise \[Hz\]: beyond 5 Hz, where the model of
/// the water is not to be trusted, less than 1 % of a command is left.
const CUTOFF: f64 = 3.0;

/// A fin environment's configuration.
#[derive(Clone, Debug)]
pub struct Config {
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
    /// Whether the step is ours to choose, and so its error to promise.
    pub promised: bool,
    /// Pitch that the servo goes to over pitch commanded.
    pub gain: f64,
    /// Standard deviation of what is drawn each control step and added to the command.
    pub disturbance: f64,
    /// Keywords as resolved.
    pub resolved: Map<String, Value>,
}

impl Config {
    /// Reads the keywords; `setup` is what the task asks for.
    ///
    /// # Errors
    /// Unknown keywords, values outside their ranges, steps that do not divide each other.
    pub fn new(setup: &Setup, given: &Map<String, Value>) -> Result<Config> {
        let table = Parameters::table_of(setup.free_swimming);
        let mut reader = Reader::new(given, &table, KEYWORDS)?;
        let thesis = reader.thesis()?;
        let usual = if thesis { Parameters::thesis() } else { Parameters::default() };
        let row = |p: &Parameter| table.iter().position(|known| known.name == p.name);
        let values = reader.parameters(&table, |p| {
            usual.get(row(p).expect("it is a row of the table")).min(p.high)
        })?;
        let known = thesis || reader.get(table[STIFFNESS].name).is_some();
        let soft = setup
            .stiffness
            .filter(|_| !known)
            .map(|(low, high)| json!({table[STIFFNESS].name: ["log_uniform", low, high]}));
        let draws = reader.draws(&table, &values, soft)?;
        let hydrodynamics = Hydrodynamics::from_name(reader.choice("hydrodynamics", "lighthill")?)?;
        let scheme =
            match reader.choice("stepper", if thesis { "backward_euler" } else { "auto" })? {
                "backward_euler" => Scheme::BackwardEuler,
                _ => Scheme::Bdf2,
            };
        reader.note("stepper", if scheme == Scheme::Bdf2 { "bdf2" } else { "backward_euler" });
        let control_dt = reader.number("control_dt", 0.04)?;
        let usual = match (scheme, hydrodynamics) {
            (Scheme::Bdf2, Hydrodynamics::Morison) => MORISON_DT,
            (Scheme::Bdf2, Hydrodynamics::Lighthill) if draws[STIFFNESS].bounds().1 < FLOPPY => {
                FLOPPY_DT
            }
            (Scheme::Bdf2, _) => BDF2_DT,
            _ => EULER_DT,
        };
        // The small reduction keeps an exact quotient from being rounded up.
        let divided = control_dt / libm::ceil(control_dt / usual - 1e-9);
        let promised = scheme == Scheme::Bdf2 && reader.get("physics_dt").is_none();
        let physics_dt = reader.number("physics_dt", divided)?;
        let substeps = whole("control_dt", control_dt, physics_dt)?;
        let delay = reader.number_within("actuator_delay", 0.0, 0.0, 10.0 * control_dt)?;
        let delay = whole("actuator_delay", delay, physics_dt)?;
        reader.note("actuator_delay", delay as f64 * physics_dt);
        let command_cutoff = reader.number_or_none("command_cutoff", CUTOFF)?;
        // The thesis' fin is stiff and damped: at the usual price of power it earns nothing whatever it does.
        let weight = if thesis { 0.5 } else { 1.0 };
        let geometry = read_geometry(&mut reader)?;
        let pitch_limit = reader.number("pitch_limit", 20f64.to_radians())?;
        let gain = reader.number("actuator_gain", 1.0)?;
        if gain > 1.0 && gain * pitch_limit > PITCH_BOUND {
            let most = (PITCH_BOUND / pitch_limit).max(1.0);
            let allowed = format!(
                "a number from 0.01 to {most:.4} for a pitch_limit of {pitch_limit:.4} rad: the servo turns by at most {PITCH_BOUND} rad"
            );
            return Err(Error::parameter("actuator_gain", gain, allowed));
        }
        let free_swimming = setup.free_swimming;
        let design = Design { geometry, hydrodynamics, scheme, physics_dt, free_swimming };
        design.check()?;
        Ok(Config {
            design,
            draws,
            sensors: match reader.choice("observation", "full")? {
                "full" => Sensors::Full,
                _ => Sensors::Camera,
            },
            control_dt,
            substeps,
            pitch_limit,
            command_cutoff,
            ticks: Ticks::new(physics_dt, command_cutoff, gain),
            power_weight: reader.number("power_weight", weight)?,
            start_pitch: reader.range("start_pitch", (-0.1, 0.1))?,
            demand: reader.range("demand", (0.02, 0.15))?,
            noise: reader.numbers("sensor_noise")?,
            delay,
            promised,
            gain,
            disturbance: reader.number("command_disturbance", 0.0)?,
            resolved: reader.resolved(),
        })
    }

    /// What users should know of the error, where no default keeps it within 1 %.
    pub fn warning(&self) -> Option<String> {
        let softest = self.draws[STIFFNESS].bounds().0;
        let damped = self.draws[DAMPING].bounds().0 >= Parameters::thesis().damping * 0.999;
        let least = if damped { VIBRATES.1 } else { VIBRATES.0 };
        let morison = self.design.hydrodynamics == Hydrodynamics::Morison;
        (self.promised && morison && softest < least).then(|| {
            format!(
                "youngs_modulus = {softest:.3e} Pa: in 'morison' water the vibration of so soft a fin never dies, and \
                 thrust and power of a beat may be off by more than 10 % of their rms whatever the step (elsewhere by \
                 less than 1 %): 'lighthill' water, a stiffer fin (from {least:.1e} Pa) or damping help"
            )
        })
    }
}

/// The shape: Table 3.1, or the columns of the keyword `geometry`, with `stiffness_profile`.
fn read_geometry(reader: &mut Reader<'_>) -> Result<Geometry> {
    let mut geometry = Geometry::thesis();
    if let Some(value) = reader.get("geometry") {
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
    if let Some(value) = reader.get("stiffness_profile") {
        geometry.stiffness = column("stiffness_profile", value)?;
    }
    reader.note(
        "geometry",
        json!({
            "edge_length": geometry.edge_length,
            "height": geometry.height,
            "pivot": geometry.pivot,
            "widths": geometry.widths,
            "areas": geometry.areas,
        }),
    );
    reader.note("stiffness_profile", json!(geometry.stiffness));
    Ok(geometry)
}

/// A list of finite numbers.
fn column(name: &str, value: &Value) -> Result<Vec<f64>> {
    let refuse = || Error::parameter(name, value, "a list of finite numbers, one a node");
    let list = value.as_array().ok_or_else(refuse)?;
    list.iter().map(|item| item.as_f64().filter(|x| x.is_finite()).ok_or_else(refuse)).collect()
}
