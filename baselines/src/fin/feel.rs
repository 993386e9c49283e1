//! What a fin feels like to its servo: the torque that a fin of some stiffness takes for a motion.
//!
//! For each of a row of stiffnesses the torque of a step is predicted from the pitch, its rate and the thrust of the last steps and
//! from the torques before. The prediction is linear in [`FEATURES`] numbers: those themselves, squares that keep their sign
//! (drag), and products of the thrust with the motion. Its weights are fitted by least squares to fins that are played, so they
//! hold whatever water, noise and delay the environment has. A fin is as stiff as those whose torque it has.

use crate::error::{Error, Result};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// What is measured: pitch, its rate, thrust, torque, as they are observed.
pub const SENSORS: usize = 4;
/// Steps that are remembered, the last one included.
const LAGS: usize = 5;
/// Numbers of the memory.
pub const MEMORY: usize = SENSORS * LAGS;
/// Numbers that the torque is predicted from.
const FEATURES: usize = 48;
/// Deviation that a prediction has at rest, in the torque's unit (0.1 N m). A small one takes the first stirrings of the fin,
/// which are unlike all that was played, for proofs.
const REST: f64 = 0.005;
/// Most that a square of an error over its variance counts.
const MOST: f64 = 50.0;
/// Part of the squares' size that is added to them, so that features which hardly differ get no huge weights.
const RIDGE: f64 = 1e-9;

/// The last steps: [`SENSORS`] numbers a step, the newest first.
#[derive(Clone, Copy)]
struct Past<'a>(&'a [f64]);

impl Past<'_> {
    fn pitch(self, ago: usize) -> f64 {
        self.0[SENSORS * ago]
    }
    fn rate(self, ago: usize) -> f64 {
        self.0[SENSORS * ago + 1]
    }
    fn thrust(self, ago: usize) -> f64 {
        self.0[SENSORS * ago + 2]
    }
    fn torque(self, ago: usize) -> f64 {
        self.0[SENSORS * ago + 3]
    }

    /// Mean square of the torques.
    fn power(self) -> f64 {
        (0..LAGS).map(|ago| self.torque(ago) * self.torque(ago)).sum::<f64>() / LAGS as f64
    }

    fn features(self) -> [f64; FEATURES] {
        let mut all = [0.0; FEATURES];
        let mut next = 0;
        let mut put = |x: f64| {
            all[next] = x;
            next += 1;
        };
        for ago in 0..LAGS {
            put(self.pitch(ago));
            put(self.rate(ago));
        }
        for ago in 1..LAGS {
            put(self.torque(ago));
        }
        for ago in 0..4 {
            put(self.rate(ago) * self.rate(ago).abs());
        }
        for ago in 1..4 {
            put(self.torque(ago) * self.torque(ago).abs());
        }
        for ago in 1..4 {
            for other in 0..3 {
                put(self.thrust(ago) * self.rate(other));
                put(self.thrust(ago) * self.pitch(other));
                put(self.thrust(ago) * self.torque(other + 1));
            }
        }
        debug_assert_eq!(next, FEATURES);
        all
    }
}

/// Takes a step's measurements into a memory of [`MEMORY`] numbers.
pub fn remember(measured: [f64; SENSORS], memory: &mut [f64]) {
    memory.rotate_right(SENSORS);
    memory[..SENSORS].copy_from_slice(&measured);
}

/// The torque of one stiffness.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Model {
    weights: Vec<f64>,
    /// Variance of an error over the mean square of the torques.
    spread: f64,
}

/// The torques of a row of stiffnesses.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Feel(Vec<Model>);

impl Feel {
    /// Fits the next stiffness to the memories of its fins.
    ///
    /// # Errors
    /// Fins that do not move.
    pub fn learn(&mut self, memories: &[[f64; MEMORY]]) -> Result<()> {
        let mut squares = DMatrix::<f64>::zeros(FEATURES, FEATURES);
        let mut aims = DVector::<f64>::zeros(FEATURES);
        for memory in memories {
            let past = Past(memory);
            let features = past.features();
            for i in 0..FEATURES {
                aims[i] += features[i] * past.torque(0);
                for j in 0..=i {
                    squares[(i, j)] += features[i] * features[j];
                }
            }
        }
        let size = squares.diagonal().max();
        for i in 0..FEATURES {
            squares[(i, i)] += RIDGE * (squares[(i, i)] + 1e-6 * size);
        }
        // (Only the lower half is read.)
        let solved = squares.cholesky().ok_or_else(|| Error::NoSolution {
            equation: "fit of a fin's torque",
            reason: format!("{} steps hardly move the fin", memories.len()),
        })?;
        let weights: Vec<f64> = solved.solve(&aims).iter().copied().collect();
        let mut model = Model { weights, spread: 0.0 };
        let (mut error, mut power) = (0.0, 0.0);
        for memory in memories {
            let past = Past(memory);
            let off = past.torque(0) - model.torque(&past.features());
            error += off * off;
            power += past.power();
        }
        model.spread = error / power;
        self.0.push(model);
        Ok(())
    }

    /// How unlikely each stiffness thinks the last torque: minus the logarithm, up to a constant. Calls `told` with the number
    /// of the stiffness.
    pub fn surprise(&self, memory: &[f64], mut told: impl FnMut(usize, f64)) {
        let past = Past(memory);
        let (features, power) = (past.features(), past.power());
        for (i, model) in self.0.iter().enumerate() {
            let variance = REST * REST + model.spread * power;
            let off = past.torque(0) - model.torque(&features);
            told(i, 0.5 * ((off * off / variance).min(MOST) + libm::log(variance)));
        }
    }
}

impl Model {
    fn torque(&self, features: &[f64; FEATURES]) -> f64 {
        self.weights.iter().zip(features).map(|(w, x)| w * x).sum()
    }
}

#[cfg(test)]
mod tests {
    //! A torque that follows a law of the features is learned, and told from another.

    use super::*;
    use rodgym_core::seed::Stream;

    /// Memories of a servo whose torque is `stiffness` times the pitch plus a drag.
    fn memories(stiffness: f64, stream: &mut Stream) -> Vec<[f64; MEMORY]> {
        let mut memory = [0.0; MEMORY];
        let (mut pitch, mut all) = (0.0, Vec::new());
        for _ in 0..600 {
            let rate = stream.uniform(-1.0, 1.0);
            pitch += 0.3 * rate - 0.1 * pitch;
            let torque = stiffness * pitch + 0.2 * rate * rate.abs() + 0.001 * stream.normal();
            remember([pitch, rate, 0.1 * rate * rate, torque], &mut memory);
            all.push(memory);
        }
        all.split_off(LAGS)
    }

    #[test]
    fn the_stiffness_whose_torque_it_is_surprises_least() {
        let mut stream = Stream::new(1);
        let mut feel = Feel::default();
        for stiffness in [0.2, 0.5, 0.9] {
            feel.learn(&memories(stiffness, &mut stream)).unwrap();
        }
        for (wanted, stiffness) in [0.2, 0.5, 0.9].into_iter().enumerate() {
            let mut sums = [0.0; 3];
            for memory in memories(stiffness, &mut stream) {
                feel.surprise(&memory, |i, surprise| sums[i] += surprise);
            }
            let least = (0..3).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).unwrap();
            assert_eq!(least, wanted, "{sums:?}");
        }
    }
}
