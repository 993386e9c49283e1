//! The inverted elastic pendulum (thesis chapter 4): a rod pinned at its base, a torque on its first edge.

pub mod accuracy;
pub mod config;
mod derivative;
mod linear;
mod plant;
mod sensors;
mod sim;
pub mod tasks;
mod vector;

pub use config::{Config, PARAMETERS, Sensors, Setup};
pub use linear::Linear;
pub use plant::{Plant, Start, State};
pub use sensors::{RATE_BOUND, RATE_UNIT};
pub use sim::BarePendulum;

use crate::batch::{Differentiated, Gradient, Machine};
use crate::draw::{Draw, exact_parameters};
use crate::episodes::ResetOptions;
use crate::error::{Error, Result};
use crate::keywords::{Keyword, Parameter};
use crate::lane::{Dual, Lanewise, Mask, Real};
use crate::rod::curvature;
use crate::scene::{NodeState, Scene};
use crate::seed::Stream;
use crate::simulation::Simulation;
use crate::solver::Scheme;
use crate::spec::Space;
use crate::watch::Watch;
use config::{at, verlet_limit};
use derivative::By;
use serde_json::{Map, Value, json};

/// The pendulum as its keywords have it.
#[derive(Clone, Debug)]
pub struct Pendulum {
    config: Config,
}

impl Pendulum {
    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Refuses parameters within these bounds for which the Verlet stepper's step, which stays as it is, is too long.
    fn check_stable(&self, bounds: &[(f64, f64)]) -> Result<()> {
        let config = &self.config;
        if config.scheme != Scheme::Verlet {
            return Ok(());
        }
        let limit = verlet_limit(config.nodes, bounds);
        if config.physics_dt <= limit {
            return Ok(());
        }
        let shown = |(p, &(low, high)): (&Parameter, &(f64, f64))| {
            (p.name.to_owned(), if low == high { json!(low) } else { json!([low, high]) })
        };
        let given: Map<_, _> = PARAMETERS.iter().zip(bounds).map(shown).collect();
        let allowed = format!(
            "such that the verlet stepper is stable: its limit would be {limit:.3e} s, but physics_dt is {:.3e} s (make the environment with stepper='implicit' or a smaller physics_dt)",
            config.physics_dt
        );
        Err(Error::parameter("parameters", Value::Object(given), allowed))
    }

    /// Draws the torque that disturbs a control step \[N m\].
    #[inline(always)]
    fn disturbance<R: Real>(&self, active: R::Mask, streams: &mut [Stream]) -> R {
        if self.config.disturbance == 0.0 {
            return R::zero();
        }
        R::from_fn(|lane| {
            if active.get(lane) { self.config.disturbance * streams[lane].normal() } else { 0.0 }
        })
    }

    /// What a control step is told.
    fn told(&self, action: &[f64], stream: &mut Stream) -> derivative::Told {
        let disturbance = self.disturbance(true, std::slice::from_mut(stream));
        let clipped = action[0].clamp(-1.0, 1.0);
        derivative::Told { action: clipped, inside: clipped == action[0], disturbance }
    }

    fn check_state(&self, value: &Value) -> Result<State> {
        let edges = self.config.nodes - 1;
        let allowed = format!(
            "{{'angles': {edges} numbers, 'rates': {edges} numbers}} or {{'positions': ({n}, 2), 'velocities': ({n}, 2)}}, the first node at rest at the origin",
            n = edges + 1
        );
        let refuse = || Error::parameter("state", value, allowed.clone());
        let map = value.as_object().ok_or_else(refuse)?;
        let read = |name: &str| map.get(name).cloned().ok_or_else(refuse);
        let finite = |x: &f64| x.is_finite();
        if map.contains_key("angles") {
            let numbers = |name| {
                let list: Vec<f64> = serde_json::from_value(read(name)?).map_err(|_| refuse())?;
                if list.len() == edges { Ok(list) } else { Err(refuse()) }
            };
            return Ok(State::Edges(numbers("angles")?, numbers("rates")?));
        }
        let points = |name| {
            let list: Vec<[f64; 2]> = serde_json::from_value(read(name)?).map_err(|_| refuse())?;
            let fits = list.len() == edges + 1 && list.iter().flatten().all(finite);
            if fits && list[0] == [0.0, 0.0] { Ok(list) } else { Err(refuse()) }
        };
        let (positions, velocities) = (points("positions")?, points("velocities")?);
        if positions.windows(2).any(|pair| pair[0] == pair[1]) {
            return Err(refuse());
        }
        Ok(State::Nodes(positions, velocities))
    }
}

impl Machine for Pendulum {
    const NAME: &'static str = "pendulum";
    const METRICS: &'static [&'static str] = &["tip_height", "upright_error", "torque"];
    const KEYWORDS: &'static [Keyword] = config::KEYWORDS;
    type Setup = Setup;
    type Plant<R: Real> = Plant<R>;
    type Start = Start;

    fn new(setup: &Setup, given: &Map<String, Value>) -> Result<Self> {
        Ok(Pendulum { config: Config::new(setup, given)? })
    }

    fn observation(&self) -> Space {
        sensors::space(&self.config)
    }

    fn action(&self) -> Space {
        let mut action = Space::new();
        action.push(-1.0, 1.0, "base torque / torque_limit");
        action
    }

    fn parameter_table(&self) -> &[Parameter] {
        PARAMETERS
    }

    fn resolved(&self) -> &Map<String, Value> {
        &self.config.resolved
    }

    fn control_dt(&self) -> f64 {
        self.config.control_dt
    }

    fn physics_dt(&self) -> f64 {
        self.config.physics_dt
    }

    fn error(&self) -> Option<f64> {
        self.config.error
    }

    fn warning(&self) -> Option<String> {
        self.config.warning()
    }

    fn new_plant<R: Real>(&self) -> Plant<R> {
        Plant::new(&self.config)
    }

    fn draws(&self) -> &[Draw] {
        &self.config.draws
    }

    fn check_draws(&self, draws: &[Draw]) -> Result<()> {
        let bounds: Vec<_> = draws.iter().map(Draw::bounds).collect();
        self.check_stable(&bounds)
    }

    fn check(&self, options: &ResetOptions, draws: &[Draw]) -> Result<Start> {
        let parameters = exact_parameters(&options.parameters, PARAMETERS)?;
        if parameters.iter().any(Option::is_some) {
            let bounds = |(draw, exact): (&Draw, &Option<f64>)| {
                exact.map_or(draw.bounds(), |value| (value, value))
            };
            let bounds: Vec<_> = draws.iter().zip(&parameters).map(bounds).collect();
            self.check_stable(&bounds)?;
        }
        let state = options.state.as_ref().map(|value| self.check_state(value)).transpose()?;
        Ok(Start { parameters, state })
    }

    fn begin<R: Real>(
        &self,
        plant: &mut Plant<R>,
        lane: usize,
        draws: &[Draw],
        stream: &mut Stream,
        start: &Start,
    ) {
        plant.begin(&self.config, lane, draws, stream, start);
    }

    #[inline(always)]
    fn step<R: Real>(
        &self,
        plant: &mut Plant<R>,
        actions: &[R],
        active: R::Mask,
        streams: &mut [Stream],
        watch: Watch<'_>,
    ) -> R::Mask {
        let disturbance = self.disturbance(active, streams);
        plant.control_step(&self.config, actions[0], disturbance, watch)
    }

    fn differentiate(
        &self,
        plant: &Plant<f64>,
        action: &[f64],
        chosen: &[usize],
        stream: &mut Stream,
    ) -> Result<Option<Differentiated<Plant<Dual>>>> {
        let told = self.told(action, stream);
        derivative::differentiate(&self.config, plant, told, By::Vector, chosen)
    }

    fn essence(&self, plant: &Plant<f64>) -> Result<Vec<f64>> {
        Ok(derivative::essence(&self.config, plant))
    }

    fn differentiate_essence(
        &self,
        plant: &Plant<f64>,
        action: &[f64],
        stream: &mut Stream,
    ) -> Result<Option<Differentiated<Plant<Dual>>>> {
        derivative::differentiate(&self.config, plant, self.told(action, stream), By::Essence, &[])
    }

    fn coordinates<R: Real>(&self, plant: &Plant<R>) -> Vec<R> {
        derivative::coordinates(&self.config, plant)
    }

    fn vector(&self, plant: &Plant<f64>) -> Result<Vec<f64>> {
        Ok(derivative::plant_vector(&self.config, plant))
    }

    fn variables(&self, plant: &Plant<f64>, chosen: &[usize]) -> Result<Vec<Plant<Dual>>> {
        Ok(derivative::variables(&self.config, plant, By::Vector, chosen))
    }

    fn renew(&self, groups: &mut [Plant<Dual>], plant: &Plant<f64>) {
        for group in groups {
            group.pair(plant, &mut |to: &mut Dual, from: &f64| to.value = *from);
            group.posture = group.take_posture();
        }
    }

    fn advance(&self, plant: &mut Plant<f64>, action: &[f64], stream: &mut Stream) -> Result<bool> {
        let told = self.told(action, stream);
        Ok(derivative::advance(&self.config, plant, told).is_some())
    }

    fn pull_back(
        &self,
        plant: &Plant<f64>,
        action: &[f64],
        chosen: &[usize],
        stream: &mut Stream,
        gradient: &[f64],
    ) -> Result<Option<Gradient>> {
        let told = self.told(action, stream);
        derivative::pull_back_step(&self.config, plant, told, chosen, gradient)
    }

    #[inline(always)]
    fn metrics<R: Real>(&self, plant: &Plant<R>, metrics: &mut [R]) {
        metrics[0] = plant.tip_height();
        // Root mean square of the distances: near up the rms angle from it [rad]; 2 when hanging.
        metrics[1] = (plant.posture.off / R::splat(plant.edges() as f64)).sqrt();
        metrics[2] = plant.torque;
    }

    #[inline(always)]
    fn observe<R: Real>(
        &self,
        plant: &Plant<R>,
        lanes: R::Mask,
        streams: &mut [Stream],
        observation: &mut [R],
    ) {
        sensors::observe(&self.config, plant, lanes, streams, observation);
    }

    fn parameters<R: Real>(&self, plant: &Plant<R>, lane: usize, out: &mut [f64]) {
        for (to, from) in out.iter_mut().zip(&plant.parameters) {
            *to = from.get(lane);
        }
    }

    fn scene<R: Real>(&self, plant: &Plant<R>, lane: usize, scene: &mut Scene) {
        let state = self.nodes(plant, lane);
        let nodes = state.positions.len();
        let tangent = |k: usize| plant.edge(k).0.lane(lane);
        scene.thickness = vec![plant.parameters[at::WIDTH].get(lane); nodes];
        scene.curvature = vec![0.0; nodes];
        for i in 1..nodes - 1 {
            scene.curvature[i] = curvature(tangent(i - 1), tangent(i));
        }
        scene.nodes = state.positions;
        let value = |x: R| json!(x.get(lane));
        scene.values.insert("torque".into(), value(plant.torque));
        scene.values.insert("torque_limit".into(), value(plant.parameters[at::TORQUE_LIMIT]));
        scene.values.insert("length".into(), value(plant.parameters[at::LENGTH]));
        scene.values.insert("tip_height".into(), value(plant.tip_height()));
    }

    fn nodes<R: Real>(&self, plant: &Plant<R>, lane: usize) -> NodeState {
        let pick =
            |v: &[crate::vec2::Vec2<R>]| v.iter().map(|p| [p.x.get(lane), p.y.get(lane)]).collect();
        NodeState { positions: pick(&plant.motion.x), velocities: pick(&plant.motion.v) }
    }

    fn bare(given: &Map<String, Value>) -> Result<Box<dyn Simulation>> {
        Ok(Box::new(BarePendulum::new(given)?))
    }

    fn simulation<R: Real>(&self, plant: &Plant<R>, lane: usize) -> Box<dyn Simulation> {
        Box::new(BarePendulum::copy_of(&self.config, plant, lane))
    }
}
