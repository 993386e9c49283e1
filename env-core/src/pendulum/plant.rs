//! The pendulum itself: rod, motor and sensors of `R::LANES` environments.

use super::config::{COUNT, Config, at, uniform};
use crate::draw::Draw;
use crate::lane::{Lanewise, Mask, Real};
use crate::lanewise;
use crate::rod::{Motion, Rod};
use crate::seed::Stream;
use crate::solver::{Constant, Integrator};
use crate::vec2::Vec2;
use crate::watch::Watch;

/// Pendulums side by side.
#[derive(Clone, Debug)]
pub struct Plant<R: Real> {
    /// Parameters, in the order of the table.
    pub parameters: [R; COUNT],
    /// Geometry and material.
    pub rod: Rod<R>,
    /// Positions and velocities.
    pub motion: Motion<R>,
    /// Torques that were asked for: the newest first, as many as the delay reaches back \[N m\].
    pub commands: Vec<R>,
    /// Torque at the base during the last physics step \[N m\].
    pub torque: R,
    /// Action of the last control step.
    pub action: R,
    /// Control steps since the episode began.
    pub steps: R,
    /// How the rod stood and moved after the last control step.
    pub posture: Posture<R>,
    pub(super) integrator: Integrator<R>,
    /// Where the start of one lane is made, so that an episode begins without taking memory.
    draft: (Rod<f64>, Motion<f64>),
}

/// What one sweep over the edges tells of a pendulum, for rewards and metrics.
#[derive(Clone, Copy, Debug, Default)]
pub struct Posture<R> {
    /// Sum of the squared rates of the edges \[rad^2/s^2\].
    pub rates: R,
    /// Sum of the squared distances between tangent and up.
    pub off: R,
}

/// How an episode begins, where not drawn.
#[derive(Clone, Debug, Default)]
pub struct Start {
    /// Exact parameters, in the order of the table.
    pub parameters: Vec<Option<f64>>,
    /// Exact positions and velocities.
    pub state: Option<State>,
}

/// An exact start.
#[derive(Clone, Debug)]
pub enum State {
    /// Angles from hanging \[rad\] and rates \[rad/s\] of the edges, which have their rest lengths.
    Edges(Vec<f64>, Vec<f64>),
    /// Positions \[m\] and velocities \[m/s\] of the nodes.
    Nodes(Vec<[f64; 2]>, Vec<[f64; 2]>),
}

lanewise!(Plant: parameters, rod, motion, integrator, commands, torque, action, steps);

impl<R: Real> Plant<R> {
    /// All lanes hang straight down at rest, with the first value of each parameter's range.
    pub fn new(config: &Config) -> Self {
        let mut plant = Plant {
            parameters: [R::zero(); COUNT],
            rod: Rod::new(config.nodes),
            motion: Motion::new(config.nodes),
            commands: vec![R::zero(); config.delay / config.substeps + 2],
            torque: R::zero(),
            action: R::zero(),
            steps: R::zero(),
            posture: Posture::default(),
            integrator: Integrator::new(config.scheme, config.physics_dt, config.nodes),
            draft: (Rod::new(config.nodes), Motion::new(config.nodes)),
        };
        let values: Vec<f64> = config.draws.iter().map(|draw| draw.bounds().0).collect();
        for lane in 0..R::LANES {
            plant.place(config, lane, &values, |rod, motion| bend(rod, motion, |_| (0.0, 0.0)));
        }
        plant
    }

    /// Draws and sets the start of an episode: parameters in the table's order, angle, bend, rate.
    pub fn begin(
        &mut self,
        config: &Config,
        lane: usize,
        draws: &[Draw],
        stream: &mut Stream,
        start: &Start,
    ) {
        let mut values = [0.0; COUNT];
        for (i, drawn) in Draw::all::<COUNT>(draws, stream).into_iter().enumerate() {
            values[i] = start.parameters.get(i).copied().flatten().unwrap_or(drawn);
        }
        let angle = stream.uniform(config.start_angle.0, config.start_angle.1);
        let curve = stream.uniform(config.start_bend.0, config.start_bend.1);
        let (slowest, fastest) = config.start_rate;
        // Rods that start at rest draw nothing here: the stream goes on to the noise of the sensors.
        let rate = if slowest < fastest { stream.uniform(slowest, fastest) } else { slowest };
        let edges = config.nodes - 1;
        let along = |k: usize| if edges > 1 { k as f64 / (edges - 1) as f64 } else { 0.0 };
        match &start.state {
            None => self.place(config, lane, &values, |rod, motion| {
                bend(rod, motion, |k| (angle + curve * along(k), rate));
            }),
            Some(State::Edges(angles, rates)) => {
                self.place(config, lane, &values, |rod, motion| {
                    bend(rod, motion, |k| (angles[k], rates[k]));
                })
            }
            Some(State::Nodes(positions, velocities)) => {
                self.place(config, lane, &values, |_, motion| {
                    for i in 0..config.nodes {
                        motion.x[i] = Vec2::new(positions[i][0], positions[i][1]);
                        motion.v[i] = Vec2::new(velocities[i][0], velocities[i][1]);
                    }
                });
            }
        }
    }

    /// Sets parameters of a lane, and its state as `pose` makes it.
    fn place(
        &mut self,
        config: &Config,
        lane: usize,
        values: &[f64],
        pose: impl FnOnce(&Rod<f64>, &mut Motion<f64>),
    ) {
        for (parameter, value) in self.parameters.iter_mut().zip(values) {
            parameter.set(lane, *value);
        }
        uniform(config.nodes, &self.parameters).shape(&mut self.rod);
        let (rod, motion) = &mut self.draft;
        self.rod.read_lane(lane, rod);
        pose(rod, motion);
        Integrator::<f64>::prepare(config.scheme, rod, motion);
        self.motion.set_lane(lane, motion);
        self.integrator.forget(lane, &self.motion);
        for command in &mut self.commands {
            command.set(lane, 0.0);
        }
        self.torque.set(lane, 0.0);
        self.action.set(lane, 0.0);
        self.steps.set(lane, 0.0);
    }

    /// One control step under an action in [-1, 1] and a disturbing torque \[N m\]. Returns where the solver
    /// succeeded.
    #[inline(always)]
    pub fn control_step(
        &mut self,
        config: &Config,
        action: R,
        disturbance: R,
        watch: Watch<'_>,
    ) -> R::Mask {
        let mut sound = R::Mask::splat(true);
        // (One loop, so that the steppers are compiled into this function once.)
        for (torque, steps) in self.take(config, action, disturbance) {
            self.torque = torque;
            let Plant { rod, motion, integrator, .. } = self;
            if steps > 0 {
                let drive = Constant(self.torque);
                sound = sound.and(integrator.advance_unless(rod, motion, &drive, steps, watch));
            }
        }
        self.posture = self.take_posture();
        sound
    }

    /// Takes an action; returns the torques of the control step to come, pushes and disturbance included \[N m\], and how
    /// many physics steps each acts.
    #[inline(always)]
    pub(super) fn take(&mut self, config: &Config, action: R, disturbance: R) -> [(R, usize); 2] {
        self.action = action;
        let command = action * self.parameters[at::TORQUE_LIMIT] * R::splat(config.gain);
        let mut disturbance = disturbance;
        if config.push.torque != 0.0 {
            disturbance += config.push.mean(self.steps, config.control_dt);
        }
        self.steps += R::one();
        let (old, part) = (config.delay / config.substeps, config.delay % config.substeps);
        for i in (1..self.commands.len()).rev() {
            self.commands[i] = self.commands[i - 1];
        }
        self.commands[0] = command;
        // During the first part of the step the command before is still on its way.
        [(old + 1, part), (old, config.substeps - part)]
            .map(|(age, steps)| (self.commands[age] + disturbance, steps))
    }

    #[inline(always)]
    pub(super) fn take_posture(&self) -> Posture<R> {
        let up = Vec2::new(R::zero(), R::one());
        let mut posture = Posture { rates: R::zero(), off: R::zero() };
        for k in 0..self.edges() {
            let (t, rate) = self.edge(k);
            let off = t - up;
            posture.rates += rate * rate;
            posture.off += off.dot(off);
        }
        posture
    }

    /// Number of edges.
    #[inline(always)]
    pub fn edges(&self) -> usize {
        self.motion.x.len() - 1
    }

    /// Height of the tip over the pivot, in lengths of the rod.
    #[inline(always)]
    pub fn tip_height(&self) -> R {
        let last = self.motion.x.len() - 1;
        self.motion.x[last].y / self.parameters[at::LENGTH]
    }

    /// Unit tangent and rate \[rad/s\] of an edge: cos(theta) = -t.y, sin(theta) = t.x.
    #[inline(always)]
    pub fn edge(&self, k: usize) -> (Vec2<R>, R) {
        let e = self.motion.x[k + 1] - self.motion.x[k];
        let inverse = R::one() / e.dot(e).sqrt();
        let t = e.scale(inverse);
        let rate = t.cross(self.motion.v[k + 1] - self.motion.v[k]) * inverse;
        (t, rate)
    }
}

/// Puts the nodes where edges at rest length with these angles \[rad\] and rates \[rad/s\] have them.
fn bend(rod: &Rod<f64>, motion: &mut Motion<f64>, edge: impl Fn(usize) -> (f64, f64)) {
    (motion.x[0], motion.v[0]) = (Vec2::zero(), Vec2::zero());
    for (k, &rest) in rod.rest.iter().enumerate() {
        let (angle, rate) = edge(k);
        let (sin, cos) = libm::sincos(angle);
        let (t, n) = (Vec2::new(sin, -cos), Vec2::new(cos, sin));
        motion.x[k + 1] = motion.x[k] + t.scale(rest);
        motion.v[k + 1] = motion.v[k] + n.scale(rest * rate);
    }
}
