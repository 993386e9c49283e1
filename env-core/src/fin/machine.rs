//! The fin as a machine that a batch can run.

use super::config::{self, Config, Setup};
use super::derivative;
use super::parameters::{Parameters, WATER_DENSITY};
use super::plant::{Plant, Start};
use super::sensors;
use super::sim::BareFin;
use crate::batch::{Differentiated, Gradient, Machine};
use crate::draw::{Draw, exact_parameters};
use crate::episodes::ResetOptions;
use crate::error::{Error, Result};
use crate::fluid::terms::ByKind;
use crate::keywords::{Keyword, Parameter};
use crate::lane::{Dual, Lanewise, Mask, Real};
use crate::rod::curvature;
use crate::scene::{NodeState, Scene};
use crate::seed::Stream;
use crate::simulation::Simulation;
use crate::spec::Space;
use crate::vec2::Vec2;
use crate::watch::Watch;
use serde_json::{Map, Value, json};

/// Work of the servo since the episode began below which no efficiency is told \[J\]: that of a fin which hardly
/// moves is drag over nothing.
const LEAST_WORK: f64 = 1e-3;

/// The fin as its keywords have it.
#[derive(Clone, Debug)]
pub struct Fin {
    config: Config,
    table: [Parameter; Parameters::COUNT],
}

impl Fin {
    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Draws what is added to a command on its way, if anything is.
    #[inline(always)]
    fn disturbance<R: Real>(&self, active: R::Mask, streams: &mut [Stream]) -> Option<R> {
        let deviation = self.config.disturbance;
        let draw = |lane: usize| {
            if active.get(lane) { deviation * streams[lane].normal() } else { 0.0 }
        };
        (deviation > 0.0).then(|| R::from_fn(draw))
    }

    /// What a control step is told.
    fn told(&self, action: &[f64], stream: &mut Stream) -> derivative::Told {
        let disturbance = self.disturbance(true, std::slice::from_mut(stream));
        let clipped = action[0].clamp(-1.0, 1.0);
        derivative::Told { action: clipped, inside: clipped == action[0], disturbance }
    }
}

impl Machine for Fin {
    const NAME: &'static str = "fin";
    const METRICS: &'static [&'static str] = &[
        "thrust",
        "mount_thrust",
        "shed_thrust",
        "torque",
        "power",
        "pitch",
        "efficiency",
        "strouhal",
        "thrust_coefficient",
    ];
    const KEYWORDS: &'static [Keyword] = config::KEYWORDS;
    type Setup = Setup;
    type Plant<R: Real> = Plant<R>;
    type Start = Start;

    fn new(setup: &Setup, given: &Map<String, Value>) -> Result<Self> {
        let table = Parameters::table_of(setup.free_swimming);
        Ok(Fin { config: Config::new(setup, given)?, table })
    }

    fn observation(&self) -> Space {
        sensors::space(&self.config)
    }

    fn action(&self) -> Space {
        let mut action = Space::new();
        action.push(-1.0, 1.0, "pitch command / pitch_limit");
        action
    }

    fn parameter_table(&self) -> &[Parameter] {
        &self.table
    }

    fn resolved(&self) -> &Map<String, Value> {
        &self.config.resolved
    }

    fn control_dt(&self) -> f64 {
        self.config.control_dt
    }

    fn physics_dt(&self) -> f64 {
        self.config.design.physics_dt
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

    fn check(&self, options: &ResetOptions, _draws: &[Draw]) -> Result<Start> {
        let parameters = exact_parameters(&options.parameters, &self.table)?;
        let read = |value: &Value| {
            let allowed = "{'positions': (n, 2), 'velocities': (n, 2)}";
            let refuse = || Error::parameter("state", value, allowed);
            let state: NodeState = serde_json::from_value(value.clone()).map_err(|_| refuse())?;
            self.config.design.check_motion(&state.positions, &state.velocities)
        };
        let motion = options.state.as_ref().map(read).transpose()?;
        Ok(Start { parameters, motion })
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

    fn vector(&self, plant: &Plant<f64>) -> Result<Vec<f64>> {
        Ok(derivative::plant_vector(&self.config, plant))
    }

    fn measured(&self) -> usize {
        derivative::measured()
    }

    fn differentiate(
        &self,
        plant: &Plant<f64>,
        action: &[f64],
        chosen: &[usize],
        stream: &mut Stream,
    ) -> Result<Option<Differentiated<Plant<Dual>>>> {
        derivative::differentiate(&self.config, plant, self.told(action, stream), chosen)
    }

    fn variables(&self, plant: &Plant<f64>, chosen: &[usize]) -> Result<Vec<Plant<Dual>>> {
        Ok(derivative::variables(&self.config, plant, chosen))
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
        let mean = &plant.mean;
        let slow = plant.slow_flow();
        let geometry = &self.config.design.geometry;
        let area = geometry.length() * geometry.height;
        let pressure = R::splat(0.5 * WATER_DENSITY * area) * slow * slow;
        let worked = R::splat(LEAST_WORK).lt(plant.work);
        let efficiency = R::select(worked, plant.flow() * plant.impulse / plant.work, R::zero());
        let numbers = [
            mean.thrust,
            mean.mount_thrust,
            mean.shed_thrust,
            mean.torque,
            mean.power,
            plant.servo.angle,
            efficiency,
            plant.stroke.frequency * plant.stroke.width / slow,
            mean.thrust / pressure,
        ];
        metrics.copy_from_slice(&numbers);
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
        let mut rows = out.iter_mut();
        plant.body.parameters.visit(&mut |value| {
            if let Some(row) = rows.next() {
                *row = value.get(lane);
            }
        });
    }

    fn scene<R: Real>(&self, plant: &Plant<R>, lane: usize, scene: &mut Scene) {
        let state = self.nodes(plant, lane);
        let geometry = &self.config.design.geometry;
        let x = &state.positions;
        scene.thickness = geometry.widths.clone();
        scene.curvature = vec![0.0; x.len()];
        let tangent = |k: usize| {
            let e = Vec2::new(x[k + 1][0] - x[k][0], x[k + 1][1] - x[k][1]);
            e.scale(1.0 / e.dot(e).sqrt())
        };
        for i in 1..x.len() - 1 {
            scene.curvature[i] = curvature(tangent(i - 1), tangent(i));
        }
        let mut value = |name: &str, number: f64| {
            scene.values.insert(name.into(), json!(number));
        };
        value("pitch", plant.servo.angle.get(lane));
        value("pitch_target", plant.commands[0].get(lane) * self.config.pitch_limit);
        value("thrust", plant.mean.thrust.get(lane));
        value("torque", plant.mean.torque.get(lane));
        value("power", plant.mean.power.get(lane));
        value("flow_speed", plant.body.water.flow_speed.get(lane));
        value("length", geometry.length());
        let fin = plant.body.lane(lane);
        let (at, v) = (&fin.now.x, &fin.now.v);
        let mut water = ByKind::new(at.len());
        fin.elements().gather_water(at, v, &mut water);
        // What the water does apart from being accelerated: drag, friction, and momentum shed at the tail.
        let shed = water.resistance.iter().zip(&water.tail_flux);
        let force: Vec<_> = shed.map(|(&a, &b)| a + b).map(|f| [f.x, f.y]).collect();
        scene.arrows.insert("fluid_force".into(), json!(force));
        scene.nodes = state.positions;
    }

    fn nodes<R: Real>(&self, plant: &Plant<R>, lane: usize) -> NodeState {
        let pick = |v: &[Vec2<R>]| v.iter().map(|p| [p.x.get(lane), p.y.get(lane)]).collect();
        NodeState { positions: pick(&plant.body.now.x), velocities: pick(&plant.body.now.v) }
    }
    fn bare(given: &Map<String, Value>) -> Result<Box<dyn Simulation>> {
        Ok(Box::new(BareFin::from_keywords(given)?))
    }

    fn simulation<R: Real>(&self, plant: &Plant<R>, lane: usize) -> Box<dyn Simulation> {
        Box::new(BareFin::copy_of(&self.config, plant, lane))
    }
}
