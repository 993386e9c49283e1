//! State feedback: the regulator on the measured state.

use super::{Chain, ORDER, RATE_SCALE, Regulator, RodDesign, gentle_weights};
use crate::controller::Controller;
use crate::error::{Error, Result};
use crate::saved;
use serde::{Deserialize, Serialize};

/// Swing-up and balance from the whole state.
///
/// Observation: cos, sin, rate / (10 rad/s) of every edge. State: the regulator's clock \[s\].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Lqr {
    regulator: Regulator,
}

impl Lqr {
    /// Designs the regulator for a rod.
    ///
    /// # Errors
    /// A rod that is not allowed; a Riccati equation without solution.
    pub fn new(rod: RodDesign) -> Result<Self> {
        rod.check()?;
        let regulator = Regulator::new(Chain::new(&rod, ORDER), gentle_weights(&rod))?;
        Ok(Lqr { regulator })
    }

    /// Designs the regulator for an environment.
    ///
    /// # Errors
    /// As [`Lqr::new`]; [`Error::Unsuitable`] where the environment does not show the whole state.
    pub fn for_target(rod: RodDesign, observation_size: usize) -> Result<Self> {
        rod.check()?;
        needs_every_edge("Lqr", &rod, observation_size)?;
        Lqr::new(rod)
    }

    /// The feedback law.
    pub fn regulator(&self) -> &Regulator {
        &self.regulator
    }
}

/// Coordinates, then rates, of an observation, the angle followed along the rod: two for each coordinate of the chain,
/// then zeros.
pub(super) fn state_of(chain: &Chain, observation: &[f32]) -> [f64; 2 * ORDER] {
    let n = chain.edges();
    let edge = |i: usize| (observation[i] as f64, observation[n + i] as f64);
    let (cos, sin) = edge(0);
    let mut angle = libm::atan2(sin, cos);
    let angles = (0..n).map(|i| {
        if i > 0 {
            let ((c0, s0), (c1, s1)) = (edge(i - 1), edge(i));
            angle += libm::atan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1);
        }
        angle
    });
    let mut state = [0.0; 2 * ORDER];
    let (q, rates) = state.split_at_mut(chain.coordinates());
    chain.project(angles, q);
    let measured = observation[2 * n..].iter().map(|rate| *rate as f64 * RATE_SCALE);
    chain.project(measured, &mut rates[..chain.coordinates()]);
    state
}

/// Refuses observations that are not those of every edge.
pub(super) fn needs_every_edge(
    controller: &'static str,
    rod: &RodDesign,
    observation_size: usize,
) -> Result<()> {
    let needed = 3 * rod.edges();
    if observation_size == needed {
        return Ok(());
    }
    Err(Error::Unsuitable {
        controller,
        reason: format!(
            "it needs cos, sin and rate of every edge (observation='full', {needed} numbers), but \
             an observation has {observation_size}"
        ),
    })
}

impl Controller for Lqr {
    fn observation_size(&self) -> usize {
        3 * self.regulator.chain().edges()
    }
    fn state_size(&self) -> usize {
        1
    }
    fn parameters(&self) -> Vec<(&'static str, f64)> {
        self.regulator.parameters()
    }
    fn numbers(&self) -> Option<Vec<u8>> {
        saved::written(self)
    }
    fn start(&self, _observation: &[f32], state: &mut [f64]) {
        state[0] = self.regulator.start();
    }
    fn act(&self, observation: &[f32], state: &mut [f64], action: &mut [f32]) {
        let chain = self.regulator.chain();
        let x = state_of(chain, observation);
        let torque = self.regulator.torque(&x[..2 * chain.coordinates()], &mut state[0]);
        let limit = self.regulator.chain().rod().torque_limit;
        action[0] = (torque / limit).clamp(-1.0, 1.0) as f32;
    }
}
