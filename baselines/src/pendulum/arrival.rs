//! The torque that arrives: actions of the past on their way through the motor's delay.

use crate::error::{Result, parameter};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Most control periods that a torque may be late, as the environments have it.
pub const MOST: usize = 10;

/// The delay of a motor in control periods.
///
/// A control period has two parts: in its first the torque of one action still acts, in the rest that of the
/// next. The memory holds the actions that are on their way, the newest first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Arrival {
    whole: usize,
    late: f64,
}

impl Arrival {
    /// Reads `actuator_delay` and `control_dt` of an environment's keywords.
    ///
    /// # Errors
    /// A delay that no environment has.
    pub fn from_config(config: &Map<String, Value>, control_dt: f64) -> Result<Self> {
        let Some(value) = config.get("actuator_delay").filter(|value| !value.is_null()) else {
            return Ok(Arrival::default());
        };
        let delay = value.as_f64().map(|delay| delay / control_dt);
        let most = MOST as f64;
        match delay.filter(|periods| (0.0..=most + 1e-9).contains(periods)) {
            Some(periods) => Ok(Arrival::new(periods)),
            None => Err(parameter("actuator_delay", value, "a number from 0 to 10 control_dt")),
        }
    }

    /// A delay in control periods.
    pub fn new(periods: f64) -> Self {
        // Physics steps divide the period; what is nearly whole is whole.
        let whole = libm::floor(periods + 1e-9);
        let late = periods - whole;
        Arrival { whole: whole as usize, late: if late < 1e-9 { 0.0 } else { late } }
    }

    /// Part of a period in which the earlier torque still acts.
    pub fn late(&self) -> f64 {
        self.late
    }

    /// Numbers of the memory.
    pub fn memory(&self) -> usize {
        self.whole + 2
    }

    /// Whole periods that an action is late.
    pub fn whole(&self) -> usize {
        self.whole
    }

    /// No action is on its way.
    pub fn start(&self, memory: &mut [f64]) {
        memory.fill(0.0);
    }

    /// Takes the newest action in.
    pub fn push(&self, action: f64, memory: &mut [f64]) {
        memory.rotate_right(1);
        memory[0] = action;
    }

    /// The actions of the period that the newest action belongs to: in its first part, and in the rest.
    pub fn acting(&self, memory: &[f64]) -> [f64; 2] {
        [memory[self.whole + 1], memory[self.whole]]
    }

    /// The action that acts in a part of the periods that begin now, before an action was taken in them: parts
    /// 0 and 1 are those of the first period, 2 and 3 those of the next; there are twice the whole periods of the
    /// delay and one more.
    pub fn coming(&self, part: usize, memory: &[f64]) -> f64 {
        memory[self.whole - part.div_ceil(2)]
    }
}
