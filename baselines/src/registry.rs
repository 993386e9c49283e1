//! All controllers by name, and the one function that makes one for an environment.

use crate::controller::Controller;
use crate::error::{Error, Result, parameter};
use crate::gait::Gait;
use crate::pendulum::{HybridLqr, Lqg, Lqr, Noise, RodDesign, ThesisLqg};
use rodgym_core::fin::cycle::Waveform;
use serde_json::{Map, Value};

/// Names that `make` knows.
pub const NAMES: &[&str] = &[
    "lqr",
    "lqr-hybrid",
    "lqg",
    "thesis-lqr",
    "thesis-lqg",
    "gait",
    "gait-sine",
    "gait-square",
    "gait-triangle",
];

/// What a controller is told of its environment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Target {
    /// Every keyword of the environment with its value (`Spec::config`).
    pub config: Map<String, Value>,
    /// Length of an observation.
    pub observation_size: usize,
}

/// Designs a controller for an environment.
///
/// # Errors
/// An unknown name, an environment that the controller cannot play, a design without solution.
pub fn make(name: &str, target: &Target) -> Result<Box<dyn Controller>> {
    let size = target.observation_size;
    let gait = |waveform| -> Result<Box<dyn Controller>> {
        Ok(Box::new(Gait::for_target(waveform, &target.config, size)?))
    };
    match name {
        "gait" => return Ok(Box::new(Gait::best_for_target(&target.config, size)?)),
        "gait-sine" => return gait(Waveform::Sine),
        "gait-square" => return gait(Waveform::Square),
        "gait-triangle" => return gait(Waveform::Triangle),
        _ => {}
    }
    let Some(&known) = NAMES.iter().find(|known| **known == name) else {
        return Err(parameter("controller", name, &format!("one of {}", NAMES.join(", "))));
    };
    // An observation of a fin may be as long as one of a pendulum; only a fin has a geometry.
    if target.config.contains_key("geometry") {
        let reason = "it is a fin's, and this law is for the pendulum; a fin has gaits".into();
        return Err(Error::Unsuitable { controller: known, reason });
    }
    let rod = RodDesign::from_config(&target.config)?;
    match name {
        "lqr" => Ok(Box::new(Lqr::for_target(rod, size)?)),
        "lqr-hybrid" => Ok(Box::new(HybridLqr::for_target(rod, size)?)),
        "thesis-lqr" => Ok(Box::new(HybridLqr::literal_for_target(rod, size)?)),
        "thesis-lqg" => Ok(Box::new(ThesisLqg::for_target(rod, size)?)),
        _ => Ok(Box::new(Lqg::for_target(rod, Noise::of_sensors(&target.config), size)?)),
    }
}
