//! What a plant with its task must offer so that a batch can run it.

use crate::env::{NodeState, ResetOptions, Scene, Spec};
use crate::error::Result;
use crate::lane::{Mask, Real};
use crate::seed::Stream;

/// A machine (rod, sensors, actuator) with a task (reward, start, end). One value of this type serves a
/// whole batch; what differs between environments is in the plants.
///
/// Methods marked *hot* run inside a vector kernel: implement them `#[inline(always)]`.
pub trait Machine: Send + Sync + Sized + 'static {
    /// `R::LANES` environments side by side: parameters, state, memory for the steppers.
    type Plant<R: Real>: Clone + Send;
    /// Checked reset options.
    type Start: Send + Sync + Default;

    /// What users can ask.
    fn spec(&self) -> &Spec;
    /// A plant whose lanes all hold a valid state with default parameters.
    fn new_plant<R: Real>(&self) -> Self::Plant<R>;
    /// Checks reset options before anything changes.
    fn check(&self, options: &ResetOptions) -> Result<Self::Start>;
    /// Starts an episode in one lane, drawing parameters and start state from its stream.
    fn begin<R: Real>(
        &self,
        plant: &mut Self::Plant<R>,
        lane: usize,
        stream: &mut Stream,
        start: &Self::Start,
    );
    /// *Hot.* One control step of all lanes. `actions` are finite and clipped, one value a component.
    /// Streams advance only in `active` lanes; what happens to the others does not matter.
    fn step<R: Real>(
        &self,
        plant: &mut Self::Plant<R>,
        actions: &[R],
        active: R::Mask,
        streams: &mut [Stream],
        out: &mut Outcome<R>,
    );
    /// *Hot.* Writes the observation of all lanes; noise is drawn in `lanes` only.
    fn observe<R: Real>(
        &self,
        plant: &mut Self::Plant<R>,
        lanes: R::Mask,
        streams: &mut [Stream],
        observation: &mut [R],
    );
    /// Calls `f` with every number that the future depends on, always in the same order.
    fn visit<R: Real>(plant: &mut Self::Plant<R>, f: &mut dyn FnMut(&mut R));
    /// The same for reading.
    fn numbers<R: Real>(plant: &Self::Plant<R>, f: &mut dyn FnMut(R)) {
        Self::visit(&mut plant.clone(), &mut |x| f(*x));
    }
    /// Writes the parameters in force in a lane, in the order of the spec.
    fn parameters<R: Real>(&self, plant: &Self::Plant<R>, lane: usize, out: &mut [f64]);
    /// Fills in what there is to draw; clock, action and reward are the caller's.
    fn scene<R: Real>(&self, plant: &Self::Plant<R>, lane: usize, scene: &mut Scene);
    /// Positions and velocities of a lane.
    fn nodes<R: Real>(&self, plant: &Self::Plant<R>, lane: usize) -> NodeState;
}

/// What a step says beside the observation.
#[derive(Clone, Debug)]
pub struct Outcome<R: Real> {
    /// Reward.
    pub reward: R,
    /// Where the task ended the episode.
    pub terminated: R::Mask,
    /// Where the solver gave up.
    pub failed: R::Mask,
    /// Reward terms, then metrics, as the spec names them.
    pub terms: Vec<R>,
}

impl<R: Real> Outcome<R> {
    /// Memory for the given number of terms and metrics.
    pub fn new(terms: usize) -> Self {
        Outcome {
            reward: R::zero(),
            terminated: R::Mask::splat(false),
            failed: R::Mask::splat(false),
            terms: vec![R::zero(); terms],
        }
    }
}
