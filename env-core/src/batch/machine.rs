//! What a machine must offer so that a batch can run it.

use crate::draw::Draw;
use crate::episodes::ResetOptions;
use crate::error::Result;
use crate::keywords::{Keyword, Parameter};
use crate::lane::{Dual, Lanewise, Real};
use crate::scene::{NodeState, Scene};
use crate::seed::Stream;
use crate::simulation::{Simulation, no_derivatives};
use crate::spec::Space;
use crate::watch::Watch;
use serde_json::{Map, Value};

/// Plants after a control step, with derivatives.
pub struct Differentiated<P> {
    /// The next state as one vector, in each group of directions.
    pub next: Vec<Vec<Dual>>,
    /// The plants themselves, a group each.
    pub plants: Vec<P>,
}

/// Gradients of one number by what a control step starts from.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// By the plant's state as one vector.
    pub state: Vec<f64>,
    /// By the components of the action.
    pub action: Vec<f64>,
    /// By the parameters that were chosen.
    pub parameters: Vec<f64>,
}

/// A machine as its keywords have it: plant, sensors, start. One value of this type serves a whole batch;
/// what differs between environments is in the plants. What is asked of it is a `Task`.
///
/// Methods marked *hot* run inside a vector kernel: implement them `#[inline(always)]`.
pub trait Machine: Clone + Send + Sync + Sized + 'static {
    /// The word that everything about this machine is looked up by.
    const NAME: &'static str;
    /// Names of the numbers that it reports at every step, whatever the task.
    const METRICS: &'static [&'static str];
    /// Its keywords beside the physical parameters.
    const KEYWORDS: &'static [Keyword];
    /// What a task asks of it beside the user's keywords.
    type Setup: Default;
    /// `R::LANES` environments side by side: parameters, state, memory for the steppers. Its numbers are all that the
    /// future depends on.
    type Plant<R: Real>: Lanewise<R> + Clone + Send + Sync;
    /// Checked reset options.
    type Start: Send + Sync + Default;

    /// The machine of a task and the user's keywords.
    ///
    /// # Errors
    /// Unknown keywords, values outside their ranges.
    fn new(setup: &Self::Setup, given: &Map<String, Value>) -> Result<Self>;
    /// What its sensors show.
    fn observation(&self) -> Space;
    /// What it is told.
    fn action(&self) -> Space;
    /// Physical parameters of an episode.
    fn parameter_table(&self) -> &[Parameter];
    /// Every keyword with its value as resolved.
    fn resolved(&self) -> &Map<String, Value>;
    /// Duration of a control step \[s\].
    fn control_dt(&self) -> f64;
    /// Duration of a physics step \[s\].
    fn physics_dt(&self) -> f64;
    /// See `Spec::error`.
    fn error(&self) -> Option<f64> {
        None
    }
    /// See `Spec::warning`.
    fn warning(&self) -> Option<String> {
        None
    }

    /// A plant whose lanes all hold a valid state with default parameters.
    fn new_plant<R: Real>(&self) -> Self::Plant<R>;
    /// How each parameter is drawn for an episode, unless a user sets it otherwise between episodes.
    fn draws(&self) -> &[Draw];
    /// Refuses draws, each within its parameter's range, that do not go together.
    ///
    /// # Errors
    /// Says what they would have to be.
    fn check_draws(&self, _draws: &[Draw]) -> Result<()> {
        Ok(())
    }
    /// Checks reset options before anything changes. `draws` are those of the environment.
    fn check(&self, options: &ResetOptions, draws: &[Draw]) -> Result<Self::Start>;
    /// Starts an episode in one lane, drawing parameters by `draws` and start state from its stream.
    fn begin<R: Real>(
        &self,
        plant: &mut Self::Plant<R>,
        lane: usize,
        draws: &[Draw],
        stream: &mut Stream,
        start: &Self::Start,
    );
    /// *Hot.* One control step of all lanes; returns where the solver succeeded. `actions` are finite and
    /// clipped, one value a component. Streams advance only in `active` lanes; what happens to the others
    /// does not matter. A long step ends soon once `watch` stops it, whatever comes of it then.
    fn step<R: Real>(
        &self,
        plant: &mut Self::Plant<R>,
        actions: &[R],
        active: R::Mask,
        streams: &mut [Stream],
        watch: Watch<'_>,
    ) -> R::Mask;
    /// The plant's whole state as one vector: all that the next step depends on.
    ///
    /// # Errors
    /// A machine without derivatives.
    fn vector(&self, _plant: &Self::Plant<f64>) -> Result<Vec<f64>> {
        Err(no_derivatives(Self::NAME))
    }
    /// A control step from this plant on, in groups of eight directions: derivatives by the state, by every component of
    /// the action, and by the parameters in the places `chosen`, in this order. `action` is finite; beyond its bounds it
    /// is clipped, and has no slope. The plant's own stays; `stream` is as in `step`. `None` where the solver gave up.
    ///
    /// # Errors
    /// A machine without derivatives.
    fn differentiate(
        &self,
        _plant: &Self::Plant<f64>,
        _action: &[f64],
        _chosen: &[usize],
        _stream: &mut Stream,
    ) -> Result<Option<Differentiated<Self::Plant<Dual>>>> {
        Err(no_derivatives(Self::NAME))
    }
    /// As few numbers as the plant's future depends on, and no fewer: its vector, unless parts of that matter together.
    ///
    /// # Errors
    /// A machine without derivatives.
    fn essence(&self, plant: &Self::Plant<f64>) -> Result<Vec<f64>> {
        self.vector(plant)
    }
    /// `differentiate` by the numbers of `essence`, which `next` then has; no parameters.
    ///
    /// # Errors
    /// A machine without derivatives.
    fn differentiate_essence(
        &self,
        plant: &Self::Plant<f64>,
        action: &[f64],
        stream: &mut Stream,
    ) -> Result<Option<Differentiated<Self::Plant<Dual>>>> {
        self.differentiate(plant, action, &[], stream)
    }
    /// Positions \[m\], then velocities \[m/s\], of the nodes that move: what quadratic costs count. Empty where there are
    /// none to choose.
    fn coordinates<R: Real>(&self, _plant: &Self::Plant<R>) -> Vec<R> {
        vec![]
    }
    /// How many numbers, beside the state, its last control step is measured by: what sensors and tasks see and the next
    /// step does not depend on.
    fn measured(&self) -> usize {
        0
    }
    /// A plant as it is, in such groups: by its state, by what its last control step is measured by, by its last action
    /// and by parameters.
    ///
    /// # Errors
    /// A machine without derivatives.
    fn variables(
        &self,
        _plant: &Self::Plant<f64>,
        _chosen: &[usize],
    ) -> Result<Vec<Self::Plant<Dual>>> {
        Err(no_derivatives(Self::NAME))
    }
    /// Brings such groups of a plant up to a later state of it, in the same episode: only values and what follows from them
    /// change, what they are differentiated by does not.
    fn renew(&self, groups: &mut [Self::Plant<Dual>], plant: &Self::Plant<f64>) {
        let mut values = vec![];
        plant.visit(&mut |x: &f64| values.push(*x));
        for group in groups {
            let mut next = values.iter();
            group.visit_mut(&mut |to: &mut Dual| {
                to.value = *next.next().expect("both have the same shape");
            });
        }
    }
    /// `step` of one plant, of which derivatives are wanted later; whether the solver succeeded.
    ///
    /// # Errors
    /// A machine without derivatives.
    fn advance(
        &self,
        _plant: &mut Self::Plant<f64>,
        _action: &[f64],
        _stream: &mut Stream,
    ) -> Result<bool> {
        Err(no_derivatives(Self::NAME))
    }
    /// The way back through the control step from this plant on: from the `gradient` of a number by the state after the
    /// step, and by what it is measured by, to those by what it starts from. The other arguments are those of `differentiate`.
    ///
    /// # Errors
    /// A machine without derivatives.
    fn pull_back(
        &self,
        _plant: &Self::Plant<f64>,
        _action: &[f64],
        _chosen: &[usize],
        _stream: &mut Stream,
        _gradient: &[f64],
    ) -> Result<Option<Gradient>> {
        Err(no_derivatives(Self::NAME))
    }
    /// *Hot.* Writes the metrics after a step.
    fn metrics<R: Real>(&self, plant: &Self::Plant<R>, metrics: &mut [R]);
    /// *Hot.* Writes what the sensors show in all lanes; noise is drawn in `lanes` only.
    fn observe<R: Real>(
        &self,
        plant: &Self::Plant<R>,
        lanes: R::Mask,
        streams: &mut [Stream],
        observation: &mut [R],
    );
    /// Writes the parameters in force in a lane, in the order of the table.
    fn parameters<R: Real>(&self, plant: &Self::Plant<R>, lane: usize, out: &mut [f64]);
    /// Fills in what there is to draw; clock, action and reward are the caller's.
    fn scene<R: Real>(&self, plant: &Self::Plant<R>, lane: usize, scene: &mut Scene);
    /// Positions and velocities of a lane.
    fn nodes<R: Real>(&self, plant: &Self::Plant<R>, lane: usize) -> NodeState;
    /// The machine by itself, from the keywords that concern its body.
    ///
    /// # Errors
    /// Unknown keywords, values outside their ranges.
    fn bare(given: &Map<String, Value>) -> Result<Box<dyn Simulation>>;
    /// An exact copy of what runs in a lane: the next step of both has the same bits.
    fn simulation<R: Real>(&self, plant: &Self::Plant<R>, lane: usize) -> Box<dyn Simulation>;
}
