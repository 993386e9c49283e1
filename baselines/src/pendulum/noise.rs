//! What a filter believes of noise and start.

use serde_json::{Map, Value};

/// What the filter believes of noise and start.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// What an environment's keyword `sensor_noise` says; the default stands for less.
    pub fn of_sensors(config: &Map<String, Value>) -> Self {
        let least = Noise::default();
        let read = |name: &str, least: f64| {
            let value = config.get("sensor_noise").and_then(|noise| noise.get(name)?.as_f64());
            value.unwrap_or(0.0).max(least)
        };
        Noise { angle: read("angle", least.angle), rate: read("rate", least.rate), ..least }
    }
}
