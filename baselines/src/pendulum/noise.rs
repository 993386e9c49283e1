//! What a filter believes of noise and start.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// What the filter believes of noise and start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Standard deviation of the measured base angle \[rad\].
    pub angle: f64,
    /// Standard deviation of the measured base rate \[rad/s\].
    pub rate: f64,
    /// Variance added to every coordinate at each step, for what the model lacks.
    pub process: f64,
    /// The same for every rate.
    pub process_rate: f64,
    /// Variance of every coordinate and rate at the start.
    pub start: f64,
}

impl Default for Noise {
    /// Sensors are believed ten times noisier than the usual 1 mrad and 10 mrad/s: who trusts them more
    /// extrapolates from base to tip by the model alone, and a rod a little thinner or thicker than
    /// believed is lost.
    fn default() -> Self {
        Noise { angle: 1e-2, rate: 1e-1, process: 1e-5, process_rate: 1e-4, start: 1e-2 }
    }
}

impl Noise {
    /// For a filter that learns its rod: it may trust the angle as far as sensors are usually good, but not the
    /// rate, which shows the shiver of the base edge that no model of six coordinates has. (With 0.1 rad/s a rod of
    /// 31 nodes teaches it a wrong mass within ten samples.)
    pub const LEARNER: Noise =
        Noise { angle: 1e-3, rate: 1.0, process: 1e-5, process_rate: 1e-4, start: 1e-2 };

    /// What it believes, by name, for reports.
    pub fn by_name(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("angle_noise", self.angle),
            ("rate_noise", self.rate),
            ("process_noise", self.process),
            ("process_rate_noise", self.process_rate),
        ]
    }

    /// With what an environment's keyword `sensor_noise` says, where that is more.
    pub fn with_sensors(self, config: &Map<String, Value>) -> Self {
        let read = |name: &str, least: f64| {
            let value = config.get("sensor_noise").and_then(|noise| noise.get(name)?.as_f64());
            value.unwrap_or(0.0).max(least)
        };
        Noise { angle: read("angle", self.angle), rate: read("rate", self.rate), ..self }
    }
}
