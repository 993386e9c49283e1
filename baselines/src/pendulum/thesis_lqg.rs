//! The thesis' output feedback with its torque sampled and held.

use super::hybrid::{SWING_AMPLITUDE, SWITCH_ANGLE};
use super::lqg::{measured, needs_base};
use super::{ProcessNoise, RodDesign, ThesisDesign, Weights};
use crate::controller::Controller;
use crate::error::Result;
use crate::linalg::sample;
use crate::saved;
use nalgebra::{DMatrix, DVector, DVectorView};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Thesis 4.3 on a real motor: the continuous gains, the observer integrated exactly over a control
/// period with torque and measurement held. It does not hold the rod; it is here to be compared with.
///
/// Observation: cos, sin, rate / (10 rad/s) of the base edge. State: time \[s\], 1 while the observer
/// runs, the estimate of z, room for the next.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ThesisLqg {
    rod: RodDesign,
    gain: DVector<f64>,
    /// Estimate after a period: transition . estimate + input . (torque, angle, rate).
    transition: DMatrix<f64>,
    input: DMatrix<f64>,
    swing_frequency: f64,
}

impl ThesisLqg {
    /// Designs both gains for a rod.
    ///
    /// # Errors
    /// A rod that is not allowed; a Riccati equation without solution.
    pub fn new(rod: RodDesign) -> Result<Self> {
        let design = ThesisDesign::new(&rod, ProcessNoise::Torque)?;
        let states = 2 * rod.edges();
        let mut input = DMatrix::zeros(states, 3);
        input.set_column(0, design.torque_column());
        input.columns_mut(1, 2).copy_from(&design.observer);
        let (transition, input) = sample(&design.error_dynamics(), &input, rod.control_dt);
        let swing_frequency = libm::sqrt(rod.gravity / rod.length);
        Ok(ThesisLqg { gain: design.regulator, transition, input, swing_frequency, rod })
    }

    /// Designs the controller for an environment.
    ///
    /// # Errors
    /// As [`ThesisLqg::new`]; [`crate::Error::Unsuitable`] where an observation is not that of the
    /// base edge.
    pub fn for_target(rod: RodDesign, observation_size: usize) -> Result<Self> {
        needs_base("ThesisLqg", observation_size)?;
        ThesisLqg::new(rod)
    }
}

impl Controller for ThesisLqg {
    fn observation_size(&self) -> usize {
        3
    }
    fn state_size(&self) -> usize {
        2 + 2 * self.gain.len()
    }
    fn numbers(&self) -> Option<Vec<u8>> {
        saved::written(self)
    }
    fn parameters(&self) -> Vec<(&'static str, f64)> {
        // Those of `ThesisDesign`.
        let mut named = Weights::default().by_name();
        named.extend([
            ("switch_angle", SWITCH_ANGLE),
            ("swing_amplitude", SWING_AMPLITUDE),
            ("swing_frequency", self.swing_frequency),
        ]);
        named
    }
    fn start(&self, _observation: &[f32], state: &mut [f64]) {
        state.fill(0.0);
    }
    fn act(&self, observation: &[f32], state: &mut [f64], action: &mut [f32]) {
        let (angle, rate) = measured(observation).unwrap_or((0.0, 0.0));
        let from_up = angle - PI;
        let from_up = if from_up <= -PI { from_up + TAU } else { from_up };
        let (clock, estimates) = state.split_at_mut(2);
        let (estimate, next) = estimates.split_at_mut(self.gain.len());
        let limit = self.rod.torque_limit;
        let torque = if from_up.abs() >= SWITCH_ANGLE {
            clock[1] = 0.0;
            SWING_AMPLITUDE * libm::cos(self.swing_frequency * clock[0])
        } else {
            let edges = self.rod.edges();
            if clock[1] == 0.0 {
                clock[1] = 1.0;
                estimate[..edges].fill(from_up);
                estimate[edges..].fill(rate);
            }
            let z = DVectorView::from_slice(estimate, self.gain.len());
            let torque = (-self.gain.dot(&z)).clamp(-limit, limit);
            let driven = [torque, from_up, rate];
            for (i, next) in next.iter_mut().enumerate() {
                let row = |m: &DMatrix<f64>, x: &[f64]| -> f64 {
                    x.iter().enumerate().map(|(j, x)| m[(i, j)] * x).sum()
                };
                *next = row(&self.transition, estimate) + row(&self.input, &driven);
            }
            estimate.copy_from_slice(next);
            torque
        };
        action[0] = (torque / limit).clamp(-1.0, 1.0) as f32;
        clock[0] += self.rod.control_dt;
    }
}
