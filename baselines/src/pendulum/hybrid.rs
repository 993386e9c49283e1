//! Sampled state feedback near up, the thesis' swing-up elsewhere.

use super::lqr::needs_every_edge;
use super::{ProcessNoise, RodDesign, ThesisDesign, Weights, upright};
use crate::controller::Controller;
use crate::error::Result;
use crate::linalg::{dare, sample_cost};
use crate::saved;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// The hybrid state feedback of thesis 4.2, made for a held torque: within 60 degrees of up (base
/// edge) the regulator of the exactly sampled cost, elsewhere A cos(omega t), thesis (4.15). The
/// choice is made anew at every step.
///
/// Observation: cos, sin, rate / (10 rad/s) of every edge. State: time since the episode began \[s\].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct HybridLqr {
    rod: RodDesign,
    weights: Weights,
    gain: Vec<f64>,
    swing_amplitude: f64,
    swing_frequency: f64,
}

/// The regulator acts where the base edge is nearer to up than this \[rad\].
pub(crate) const SWITCH_ANGLE: f64 = PI / 3.0;
/// Amplitude of the swing-up, thesis (4.15) \[N m\].
pub(crate) const SWING_AMPLITUDE: f64 = 0.025;
/// Rates are observed in units of this \[rad/s\].
pub(crate) const RATE_SCALE: f64 = 10.0;

impl HybridLqr {
    /// Designs the regulator for a rod.
    ///
    /// # Errors
    /// A rod or weights that are not allowed; a Riccati equation without solution.
    pub fn new(rod: RodDesign, weights: Weights) -> Result<Self> {
        rod.check()?;
        let model = upright(&rod);
        let (q, r) = weights.matrices(rod.edges());
        let sampled = sample_cost(&model.a, &model.b, &q, &r, rod.control_dt);
        let solution = dare(&sampled.a, &sampled.b, &sampled.q, &sampled.r, Some(&sampled.n))?;
        Ok(HybridLqr::with_gain(rod, weights, solution.gain.iter().copied().collect()))
    }

    /// The gain of the thesis' continuous design, sampled and held all the same: what becomes of it on
    /// a real motor.
    ///
    /// # Errors
    /// As [`HybridLqr::new`].
    pub fn literal(rod: RodDesign) -> Result<Self> {
        let design = ThesisDesign::new(&rod, ProcessNoise::Torque)?;
        let gain = design.regulator.iter().copied().collect();
        Ok(HybridLqr::with_gain(rod, Weights::default(), gain))
    }

    fn with_gain(rod: RodDesign, weights: Weights, gain: Vec<f64>) -> Self {
        HybridLqr {
            gain,
            weights,
            swing_amplitude: SWING_AMPLITUDE,
            swing_frequency: libm::sqrt(rod.gravity / rod.length),
            rod,
        }
    }

    /// Designs the regulator for an environment, with the thesis' weights.
    ///
    /// # Errors
    /// As [`HybridLqr::new`]; [`crate::Error::Unsuitable`] where the environment does not show the whole state.
    pub fn for_target(rod: RodDesign, observation_size: usize) -> Result<Self> {
        rod.check()?;
        needs_every_edge("HybridLqr", &rod, observation_size)?;
        HybridLqr::new(rod, Weights::default())
    }

    /// As [`HybridLqr::literal`], for an environment.
    ///
    /// # Errors
    /// As [`HybridLqr::for_target`].
    pub fn literal_for_target(rod: RodDesign, observation_size: usize) -> Result<Self> {
        rod.check()?;
        needs_every_edge("ThesisLqr", &rod, observation_size)?;
        HybridLqr::literal(rod)
    }

    /// Gain K of T = -K z, z = (theta_i - pi, thetadot_i) \[N m/rad, N m s/rad\].
    pub fn gain(&self) -> &[f64] {
        &self.gain
    }

    /// The rod it was designed for.
    pub fn rod(&self) -> &RodDesign {
        &self.rod
    }

    /// Torque \[N m\], unlimited, for an observation at a time \[s\] of the episode.
    fn torque(&self, observation: &[f32], time: f64) -> f64 {
        let n = self.rod.edges();
        let from_up = |i: usize| {
            // theta - pi: both cosine and sine change sign.
            libm::atan2(-observation[n + i] as f64, -observation[i] as f64)
        };
        if from_up(0).abs() >= SWITCH_ANGLE {
            return self.swing_amplitude * libm::cos(self.swing_frequency * time);
        }
        let mut torque = 0.0;
        for i in 0..n {
            torque -= self.gain[i] * from_up(i);
            torque -= self.gain[n + i] * observation[2 * n + i] as f64 * RATE_SCALE;
        }
        torque
    }
}

impl Controller for HybridLqr {
    fn observation_size(&self) -> usize {
        3 * self.rod.edges()
    }
    fn state_size(&self) -> usize {
        1
    }
    fn parameters(&self) -> Vec<(&'static str, f64)> {
        let mut named = self.weights.by_name();
        named.extend([
            ("switch_angle", SWITCH_ANGLE),
            ("swing_amplitude", self.swing_amplitude),
            ("swing_frequency", self.swing_frequency),
        ]);
        named
    }
    fn numbers(&self) -> Option<Vec<u8>> {
        saved::written(self)
    }
    fn start(&self, _observation: &[f32], state: &mut [f64]) {
        state[0] = 0.0;
    }
    fn act(&self, observation: &[f32], state: &mut [f64], action: &mut [f32]) {
        let torque = self.torque(observation, state[0]);
        action[0] = (torque / self.rod.torque_limit).clamp(-1.0, 1.0) as f32;
        state[0] += self.rod.control_dt;
    }
}
