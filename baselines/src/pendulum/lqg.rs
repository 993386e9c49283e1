//! Output feedback: the extended Kalman filter from the episode's first sample, the regulator on its
//! estimate.

use super::belief::Belief;
use super::filter::{Filter, Learning, Pace};
use super::rods::{ORDER, STATE};
use super::{Arrival, Chain, Noise, Regulator, RodDesign, gentle_weights};
use crate::controller::Controller;
use crate::error::{Error, Result};
use crate::registry::Target;
use crate::saved;
use serde::{Deserialize, Serialize};

/// Swing-up and balance from base angle and rate.
///
/// Observation: cos, sin, rate / (10 rad/s) of the base edge; a NaN among them is a lost sample.
/// State: steps taken, the regulator's clock \[s\], actions on their way, the filter's belief.
#[derive(Clone, Debug)]
pub struct Lqg {
    numbers: Numbers,
    filter: Filter<f64>,
}

/// What a design comes to.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Numbers {
    regulator: Regulator,
    noise: Noise,
    arrival: Arrival,
    pace: Pace,
}

impl From<Numbers> for Lqg {
    fn from(numbers: Numbers) -> Self {
        let rod = numbers.regulator.chain().rod().clone();
        let filter = Filter::new(&[rod], numbers.noise, numbers.pace, Learning::default());
        Lqg { numbers, filter }
    }
}

impl Lqg {
    /// Designs filter and regulator for a rod whose motor is late.
    ///
    /// # Errors
    /// A rod that is not allowed; a Riccati equation without solution.
    pub fn new(rod: RodDesign, noise: Noise, arrival: Arrival) -> Result<Self> {
        rod.check()?;
        let regulator = Regulator::new(Chain::new(&rod, ORDER), gentle_weights(&rod))?;
        let pace = Pace::of(&[rod], &arrival);
        Ok(Numbers { regulator, noise, arrival, pace }.into())
    }

    /// Reads what `Controller::numbers` wrote.
    ///
    /// # Errors
    /// Bytes of something else.
    pub fn from_numbers(bytes: &[u8]) -> Result<Self> {
        saved::read::<Numbers>(bytes).map(Lqg::from)
    }

    /// Designs the controller for an environment.
    ///
    /// # Errors
    /// As [`Lqg::new`]; [`Error::Unsuitable`] where an observation is not that of the base edge.
    pub fn for_target(target: &Target) -> Result<Self> {
        needs_base("Lqg", target.observation.size())?;
        let rod = RodDesign::from_config(&target.config)?;
        let arrival = Arrival::from_config(&target.config, rod.control_dt)?;
        Lqg::new(rod, Noise::default().with_sensors(&target.config), arrival)
    }

    /// The feedback law.
    pub fn regulator(&self) -> &Regulator {
        &self.numbers.regulator
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

/// Base angle \[rad\] and rate \[rad/s\] of an observation; nothing where the sample was lost.
pub(super) fn measured(observation: &[f32]) -> Option<(f64, f64)> {
    let angle = libm::atan2(observation[1] as f64, observation[0] as f64);
    let rate = observation[2] as f64 * super::RATE_SCALE;
    (angle.is_finite() && rate.is_finite()).then_some((angle, rate))
}

impl Controller for Lqg {
    fn observation_size(&self) -> usize {
        3
    }
    fn state_size(&self) -> usize {
        2 + self.numbers.arrival.memory() + Belief::<f64>::SIZE
    }
    fn takes_lost_samples(&self) -> bool {
        true
    }
    fn parameters(&self) -> Vec<(&'static str, f64)> {
        [self.numbers.regulator.parameters(), self.numbers.noise.by_name()].concat()
    }
    fn numbers(&self) -> Option<Vec<u8>> {
        saved::written(&self.numbers)
    }
    fn start(&self, observation: &[f32], state: &mut [f64]) {
        state.fill(0.0);
        state[1] = self.numbers.regulator.start();
        let (angle, rate) = measured(observation).unwrap_or((0.0, 0.0));
        let memory = &mut state[2 + self.numbers.arrival.memory()..];
        self.filter.start(angle, rate).write(memory);
    }
    fn act(&self, observation: &[f32], state: &mut [f64], action: &mut [f32]) {
        let (law, memory) = state.split_at_mut(2);
        let (actions, memory) = memory.split_at_mut(self.numbers.arrival.memory());
        let [steps, clock] = law else { unreachable!("split at two") };
        let limit = self.numbers.regulator.chain().rod().torque_limit;
        let mut belief = Belief::read(memory);
        if *steps > 0.0 {
            let torques = self.numbers.arrival.acting(actions).map(|action| action * limit);
            self.filter.predict(torques, &mut belief);
        }
        *steps += 1.0;
        let seen = measured(observation);
        if let Some((angle, rate)) = seen {
            self.filter.update(angle, rate, &mut belief);
        }
        if !self.filter.sound(&belief) {
            // A rod unlike the model can drive the filter off; it begins anew from what is seen.
            let (angle, rate) = seen.unwrap_or((0.0, 0.0));
            belief = self.filter.start(angle, rate);
        }
        belief.write(memory);
        let mean = self.filter.forecast(&belief, &self.numbers.arrival, actions, limit);
        let mut x = [0.0; STATE];
        let n = self.filter.rods().lane(&mean, 0, &mut x);
        let torque = self.numbers.regulator.torque(&x[..n], clock);
        action[0] = (torque / limit).clamp(-1.0, 1.0) as f32;
        self.numbers.arrival.push(f64::from(action[0]), actions);
    }
}
