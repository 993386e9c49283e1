//! What every controller offers: the signature of an SB3 policy, in plain slices.

use crate::error::{Result, shape};

/// An estimate of a number, with the interval that holds it in nine of ten cases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    /// Name, that of the keyword where the environment has one.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Best value.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// A control law for one environment, applied to any number of them at once.
///
/// The law itself never changes; what it remembers between steps (a clock, an estimate) is one row
/// of `state` an environment, owned by the caller. Row `i` of every array belongs to environment
/// `i`, and the rows do not influence each other.
pub trait Controller: Send + Sync {
    /// Length of an observation.
    fn observation_size(&self) -> usize;
    /// Length of an action.
    fn action_size(&self) -> usize {
        1
    }
    /// Numbers that an environment's row of `state` holds; 0 for a static law.
    fn state_size(&self) -> usize;
    /// Whether a NaN in an observation counts as a lost sample instead of an error.
    fn takes_lost_samples(&self) -> bool {
        false
    }
    /// What the design settled on, by name, for reports; empty where there is nothing to say.
    fn parameters(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }
    /// Tells what a row of `state` says of the machine's parameters, always the same quantities in the same order;
    /// nothing of a law that learns nothing.
    fn estimate(&self, _state: &[f64], _tell: &mut dyn FnMut(Quantity)) {}
    /// The design as bytes that its entry in the registry can read; nothing where it cannot be saved.
    fn numbers(&self) -> Option<Vec<u8>> {
        None
    }
    /// Where an observation holds what this law cannot take: infinity, or NaN where that is no lost sample.
    fn unreadable(&self, observations: &[f32]) -> Option<usize> {
        let lost = |x: &f32| x.is_nan() && self.takes_lost_samples();
        observations.iter().position(|x| !(x.is_finite() || lost(x)))
    }
    /// Fills a row of `state` for an episode that begins with this observation.
    fn start(&self, observation: &[f32], state: &mut [f64]);
    /// Reads one observation, advances its row of `state` by a control step and writes the action,
    /// each component in [-1, 1].
    fn act(&self, observation: &[f32], state: &mut [f64], action: &mut [f32]);

    /// Actions for a batch: `observations` (n, d), `state` (n, s), `episode_start` (n), `actions`
    /// (n, a), row-major.
    ///
    /// # Errors
    /// Slices whose lengths do not belong together, or an observation that is not finite; nothing
    /// is written then.
    fn predict(
        &self,
        observations: &[f32],
        state: &mut [f64],
        episode_start: &[bool],
        actions: &mut [f32],
    ) -> Result<()> {
        let (d, s, a) = (self.observation_size(), self.state_size(), self.action_size());
        let n = episode_start.len();
        for (name, got, width) in [
            ("observation", observations.len(), d),
            ("state", state.len(), s),
            ("action", actions.len(), a),
        ] {
            if got != n * width {
                return Err(shape(name, format!("({got},)"), format!("({n}, {width})")));
            }
        }
        if let Some(i) = self.unreadable(observations) {
            return Err(crate::error::parameter(
                &format!("observation[{}, {}]", i / d, i % d),
                observations[i],
                "finite",
            ));
        }
        for i in 0..n {
            let observation = &observations[i * d..(i + 1) * d];
            let state = &mut state[i * s..(i + 1) * s];
            if episode_start[i] {
                self.start(observation, state);
            }
            self.act(observation, state, &mut actions[i * a..(i + 1) * a]);
        }
        Ok(())
    }
}
