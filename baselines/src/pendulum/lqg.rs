//! Output feedback: the extended Kalman filter from the episode's first sample, the regulator on its
//! estimate.

use super::{Chain, Estimator, Noise, Regulator, RodDesign, gentle_weights};
use crate::controller::Controller;
use crate::error::{Error, Result};

/// Coordinates of the model: order 12 at most, whatever the plant.
pub const ORDER: usize = 6;

/// Swing-up and balance from base angle and rate.
///
/// Observation: cos, sin, rate / (10 rad/s) of the base edge; a NaN among them is a lost sample.
/// State: last torque \[N m\], the regulator's clock \[s\], the filter's memory.
#[derive(Clone, Debug)]
pub struct Lqg {
    regulator: Regulator,
    estimator: Estimator,
}

impl Lqg {
    /// Designs filter and regulator for a rod.
    ///
    /// # Errors
    /// A rod that is not allowed; a Riccati equation without solution.
    pub fn new(rod: RodDesign, noise: Noise) -> Result<Self> {
        rod.check()?;
        let chain = Chain::new(&rod, ORDER);
        let regulator = Regulator::new(chain.clone(), gentle_weights(&rod))?;
        Ok(Lqg { regulator, estimator: Estimator::new(chain, noise) })
    }

    /// Designs the controller for an environment.
    ///
    /// # Errors
    /// As [`Lqg::new`]; [`Error::Unsuitable`] where an observation is not that of the base edge.
    pub fn for_target(rod: RodDesign, noise: Noise, observation_size: usize) -> Result<Self> {
        needs_base("Lqg", observation_size)?;
        Lqg::new(rod, noise)
    }

    /// The filter.
    pub fn estimator(&self) -> &Estimator {
        &self.estimator
    }

    /// The feedback law.
    pub fn regulator(&self) -> &Regulator {
        &self.regulator
    }
}

/// Refuses observations that are not those of the base edge.
pub(super) fn needs_base(controller: &'static str, observation_size: usize) -> Result<()> {
    if observation_size == 3 {
        return Ok(());
    }
    Err(Error::Unsuitable {
        controller,
        reason: format!(
            "it reads cos, sin and rate of the base edge (observation='base', 3 numbers), but an \
             observation has {observation_size}"
        ),
    })
}

/// Base angle \[rad\] and rate \[rad/s\] of an observation.
pub(super) fn measured(observation: &[f32]) -> (f64, f64) {
    let angle = libm::atan2(observation[1] as f64, observation[0] as f64);
    (angle, observation[2] as f64 * super::RATE_SCALE)
}

impl Controller for Lqg {
    fn observation_size(&self) -> usize {
        3
    }
    fn state_size(&self) -> usize {
        2 + self.estimator.memory()
    }
    fn takes_lost_samples(&self) -> bool {
        true
    }
    fn start(&self, observation: &[f32], state: &mut [f64]) {
        let (angle, rate) = measured(observation);
        // NaN marks that no torque acted before the first sample.
        state[0] = f64::NAN;
        state[1] = self.regulator.start();
        let known = angle.is_finite() && rate.is_finite();
        let (angle, rate) = if known { (angle, rate) } else { (0.0, 0.0) };
        self.estimator.start(angle, rate, &mut state[2..]);
    }
    fn act(&self, observation: &[f32], state: &mut [f64], action: &mut [f32]) {
        let (law, memory) = state.split_at_mut(2);
        let [torque, clock] = law else { unreachable!("split at two") };
        if torque.is_finite() {
            self.estimator.predict(*torque, memory);
        }
        let (angle, rate) = measured(observation);
        if angle.is_finite() && rate.is_finite() {
            self.estimator.update(angle, rate, memory);
            if !self.estimator.sound(memory) {
                // A rod unlike the model can drive the filter off; it begins anew from what is seen.
                self.estimator.start(angle, rate, memory);
            }
        } else if !self.estimator.sound(memory) {
            self.estimator.start(0.0, 0.0, memory);
        }
        let order = 2 * self.estimator.chain().coordinates();
        let limit = self.regulator.chain().rod().torque_limit;
        action[0] =
            (self.regulator.torque(&memory[..order], clock) / limit).clamp(-1.0, 1.0) as f32;
        *torque = action[0] as f64 * limit;
    }
}
