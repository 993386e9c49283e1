//! The fin environments, for `batch::Batch`.

use super::config::{Config, Task};
use super::parameters::Parameters;
use super::rig::{Rig, Start};
use super::{sensors, task};
use crate::batch::{Machine, Outcome};
use crate::catalog::Entry;
use crate::env::{NodeState, ResetOptions, Scene, Space, Spec};
use crate::error::{Error, Result};
use crate::fluid::{reactive, resistive};
use crate::keywords::exact_parameters;
use crate::lane::{Mask, Real};
use crate::rod::curvature;
use crate::seed::Stream;
use crate::vec2::Vec2;
use serde_json::{Map, Value, json};

/// A fin with its task.
#[derive(Clone, Debug)]
pub struct FinTask {
    config: Config,
    spec: Spec,
}

impl FinTask {
    /// The environment of a row of the catalogue, with a task and the user's keywords.
    ///
    /// # Errors
    /// See `Config::new`.
    pub fn new(entry: &Entry, task: Task, given: &Map<String, Value>) -> Result<Self> {
        let config = Config::new(task, given)?;
        let mut action = Space::new();
        action.push(-1.0, 1.0, "pitch command / pitch_limit");
        let spec = Spec {
            id: entry.id.into(),
            machine: entry.machine,
            task: entry.task,
            observation: sensors::space(&config),
            action,
            reward_terms: task::terms(task),
            metrics: task::metrics(task),
            parameters: Parameters::table_of(task).to_vec(),
            config: config.resolved.clone(),
            default_max_episode_steps: entry.max_episode_steps,
            control_dt: config.control_dt,
            physics_dt: config.design.physics_dt,
        };
        Ok(FinTask { config, spec })
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }
}

impl Machine for FinTask {
    type Plant<R: Real> = Rig<R>;
    type Start = Start;

    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn new_plant<R: Real>(&self) -> Rig<R> {
        Rig::new(&self.config)
    }

    fn check(&self, options: &ResetOptions) -> Result<Start> {
        let parameters =
            exact_parameters(&options.parameters, &Parameters::table_of(self.config.task))?;
        let read = |value: &Value| {
            let allowed = "{'positions': (n, 2), 'velocities': (n, 2)}";
            let refuse = || Error::parameter("state", value, allowed);
            let state: NodeState = serde_json::from_value(value.clone()).map_err(|_| refuse())?;
            self.config.design.check_motion(&state.positions, &state.velocities)
        };
        let motion = options.state.as_ref().map(read).transpose()?;
        Ok(Start { parameters, motion })
    }

    fn begin<R: Real>(&self, rig: &mut Rig<R>, lane: usize, stream: &mut Stream, start: &Start) {
        rig.begin(&self.config, lane, stream, start);
    }

    #[inline(always)]
    fn step<R: Real>(
        &self,
        rig: &mut Rig<R>,
        actions: &[R],
        _active: R::Mask,
        _streams: &mut [Stream],
        out: &mut Outcome<R>,
    ) {
        let sound = rig.control_step(&self.config, actions[0]);
        out.reward = task::score(&self.config, rig, &mut out.terms);
        out.terminated = R::Mask::splat(false);
        out.failed = sound.not();
    }

    #[inline(always)]
    fn observe<R: Real>(
        &self,
        rig: &mut Rig<R>,
        lanes: R::Mask,
        streams: &mut [Stream],
        observation: &mut [R],
    ) {
        sensors::observe(&self.config, rig, lanes, streams, observation);
    }

    fn visit<R: Real>(rig: &mut Rig<R>, f: &mut dyn FnMut(&mut R)) {
        rig.visit(f);
    }

    fn parameters<R: Real>(&self, rig: &Rig<R>, lane: usize, out: &mut [f64]) {
        for (to, from) in out.iter_mut().zip(&rig.parameters) {
            *to = from.get(lane);
        }
    }

    fn scene<R: Real>(&self, rig: &Rig<R>, lane: usize, scene: &mut Scene) {
        let state = self.nodes(rig, lane);
        let geometry = &self.config.design.geometry;
        let x = &state.positions;
        scene.machine = "fin".into();
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
        value("pitch", rig.servo.angle.get(lane));
        value("pitch_target", rig.commands[0].get(lane) * self.config.pitch_limit);
        value("thrust", rig.mean.thrust.get(lane));
        value("torque", rig.mean.torque.get(lane));
        value("power", rig.mean.power.get(lane));
        value("flow_speed", rig.fin.water.flow_speed.get(lane));
        value("length", geometry.length());
        match self.config.task {
            Task::Thrust => {}
            Task::Efficiency => value("demand", rig.demand.get(lane)),
            Task::Swim => {
                value("hull_position", x[geometry.pivot][0]);
                value("hull_speed", rig.speed.get(lane));
            }
        }
        let fin = rig.fin.lane(lane);
        let (at, v) = (&fin.now.x, &fin.now.v);
        let mut force = vec![[0.0; 2]; at.len()];
        let mut add = |node: usize, f: Vec2<f64>| {
            force[node][0] += f.x;
            force[node][1] += f.y;
        };
        // What the water does apart from being accelerated: drag, friction, and momentum shed at the tail.
        let model = fin.design.hydrodynamics;
        for k in 0..at.len() - 1 {
            let edge = fin.edge(k, at, v);
            if model.has_resistance() {
                let water = resistive::force(fin.water.drag, fin.friction(k), &edge);
                let [first, second] = edge.forces_to_world(&water);
                add(k, first);
                add(k + 1, second);
            }
            if model.has_tail_flux() && k + 2 == at.len() {
                let [along, across] = reactive::tail_flux(fin.water.added_mass, &edge);
                add(k + 1, edge.to_world(along, across));
            }
        }
        scene.arrows.insert("fluid_force".into(), json!(force));
        scene.nodes = state.positions;
    }

    fn nodes<R: Real>(&self, rig: &Rig<R>, lane: usize) -> NodeState {
        let pick = |v: &[Vec2<R>]| v.iter().map(|p| [p.x.get(lane), p.y.get(lane)]).collect();
        NodeState { positions: pick(&rig.fin.now.x), velocities: pick(&rig.fin.now.v) }
    }
}
