//! The fin with its servo, in lanes: servo, command, and what is measured over control steps.

use super::body::Body;
use super::config::Config;
use super::motion::Loads;
use super::parameters::Parameters;
use super::servo::Servo;
use crate::draw::Draw;
use crate::lane::{Lanewise, Mask, Real};
use crate::lanewise;
use crate::seed::Stream;
use crate::vec2::Vec2;
use crate::watch::Watch;

/// Positions and velocities of the nodes, and the pitch.
type Motion = (Vec<Vec2<f64>>, Vec<Vec2<f64>>, f64);

/// How an episode begins, where not drawn.
#[derive(Clone, Debug, Default)]
pub struct Start {
    /// Exact parameters, in the order of the table.
    pub parameters: Vec<Option<f64>>,
    /// Exact positions, velocities and pitch.
    pub motion: Option<Motion>,
}

/// Slowest flow that ratios are taken of \[m/s\].
const SLOW: f64 = 1e-3;
/// Time constant of the smoothed thrust \[s\].
pub const SMOOTHING: f64 = 0.5;

/// Frequency of the pitch and width of the wake, taken from the last full period of the command.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stroke<R> {
    /// Time since the last upward crossing of zero pitch \[s\].
    since: R,
    /// 1 once there has been a crossing.
    started: R,
    /// Largest and smallest y of the tail since then \[m\].
    high: R,
    low: R,
    /// Frequency of the last full period \[Hz\], 0 before there is one.
    pub frequency: R,
    /// Peak-to-peak travel of the tail in it \[m\].
    pub width: R,
}

lanewise!(Stroke: since, started, high, low, frequency, width);

/// A fin, its servo and its measurements.
#[derive(Clone, Debug)]
pub struct Plant<R: Real> {
    /// The fin in its water.
    pub body: Body<R>,
    /// The servo.
    pub servo: Servo<R>,
    /// Commands in [-1, 1], the newest first, as many as the delay reaches back.
    pub commands: Vec<R>,
    /// Mean forces and power of the last control step.
    pub mean: Loads<R>,
    /// Shed thrust smoothed over `SMOOTHING` \[N\].
    pub smooth_thrust: R,
    /// Demanded thrust \[N\].
    pub demand: R,
    /// Impulse of the thrust since the episode began \[N s\].
    pub impulse: R,
    /// Work of the servo since the episode began \[J\].
    pub work: R,
    /// Mean forward speed of the hull over the last control step, along -x \[m/s\].
    pub speed: R,
    /// Frequency and wake.
    pub stroke: Stroke<R>,
}

lanewise!(
    Plant: body, servo, commands, mean, smooth_thrust, demand, impulse, work, speed, stroke
);

impl<R: Real> Plant<R> {
    /// All lanes straight and at rest, with the first value of each parameter's range.
    pub fn new(config: &Config) -> Self {
        let body = Body::new(config.design.clone()).expect("checked with the configuration");
        let mut plant = Plant {
            body,
            servo: Servo::default(),
            commands: vec![R::zero(); config.delay / config.substeps + 2],
            mean: Loads::default(),
            smooth_thrust: R::zero(),
            demand: R::splat(config.demand.0),
            impulse: R::zero(),
            work: R::zero(),
            speed: R::zero(),
            stroke: Stroke::default(),
        };
        let parameters = values(|i| config.draws[i].bounds().0);
        for lane in 0..R::LANES {
            plant.body.begin(lane, &parameters, 0.0);
        }
        plant
    }

    /// Draws and sets the start of an episode: parameters in the table's order, pitch, demand.
    pub fn begin(
        &mut self,
        config: &Config,
        lane: usize,
        draws: &[Draw],
        stream: &mut Stream,
        start: &Start,
    ) {
        // Nothing has been measured yet.
        self.visit_mut(&mut |x| x.set(lane, 0.0));
        let drawn: [f64; Parameters::COUNT] = Draw::all(draws, stream);
        let exact = |i: usize| start.parameters.get(i).copied().flatten();
        let parameters = values(|i| exact(i).unwrap_or(drawn[i]));
        let mut pitch = stream.uniform(config.start_pitch.0, config.start_pitch.1);
        let demand = stream.uniform(config.demand.0, config.demand.1);
        self.body.begin(lane, &parameters, pitch);
        let mut rate = 0.0;
        if let Some((x, v, angle)) = &start.motion {
            self.body.set_motion(lane, x, v, *angle);
            pitch = *angle;
            let pivot = config.design.geometry.pivot;
            let (e, de) = (x[pivot + 1] - x[pivot], v[pivot + 1] - v[pivot]);
            rate = e.cross(de) / e.dot(e);
        }
        self.demand.set(lane, demand);
        // The servo stands still until it is told otherwise.
        let command = (pitch / (config.gain * config.pitch_limit)).clamp(-1.0, 1.0);
        self.servo.place(lane, pitch, rate, command * config.pitch_limit);
        self.commands.iter_mut().for_each(|c| c.set(lane, command));
    }

    /// One control step under an action in [-1, 1], and what is added to it on its way to the servo. Returns where the
    /// solver succeeded.
    #[inline(always)]
    pub fn control_step(
        &mut self,
        config: &Config,
        action: R,
        disturbance: Option<R>,
        watch: Watch<'_>,
    ) -> R::Mask {
        self.control_step_by(config, action, disturbance, &mut Swung(watch))
    }

    /// The same, the physics steps taken by a stepper of one's own.
    #[inline(always)]
    pub(super) fn control_step_by<S: Stepper<R>>(
        &mut self,
        config: &Config,
        action: R,
        disturbance: Option<R>,
        stepper: &mut S,
    ) -> R::Mask {
        self.take(action);
        let dt = config.design.physics_dt;
        let share = R::splat(1.0 / config.substeps as f64);
        let before = self.body.now.x[config.design.geometry.pivot].x;
        let mut sound = R::Mask::splat(true);
        self.mean = Loads::default();
        for step in 0..config.substeps {
            if stepper.stops() {
                break;
            }
            let pitch = self.servo.angle;
            self.servo.advance(command(config, &self.commands, step, disturbance), &config.ticks);
            sound = sound.and(stepper.step(&mut self.body, self.servo.angle));
            let loads = self.body.loads;
            self.mean.add(share, &loads);
            self.follow_stroke(pitch, dt);
        }
        self.conclude(config, before);
        sound
    }

    /// A new command comes in.
    #[inline(always)]
    pub(super) fn take(&mut self, action: R) {
        for i in (1..self.commands.len()).rev() {
            self.commands[i] = self.commands[i - 1];
        }
        self.commands[0] = action;
    }

    /// What a control step is measured by, once its physics steps are taken; `before` is where the pivot was along x.
    #[inline(always)]
    pub(super) fn conclude(&mut self, config: &Config, before: R) {
        let after = self.body.now.x[config.design.geometry.pivot].x;
        self.speed = (before - after) * R::splat(1.0 / config.control_dt);
        let duration = R::splat(config.control_dt);
        self.impulse += self.mean.thrust * duration;
        self.work += self.mean.power * duration;
        let forget = R::splat(forgets(config));
        self.smooth_thrust += forget * (self.mean.shed_thrust - self.smooth_thrust);
    }

    /// Speed of the water past the fin, along -x of its motion \[m/s\].
    #[inline(always)]
    pub fn flow(&self) -> R {
        if self.body.design.free_swimming { self.speed } else { self.body.water.flow_speed }
    }

    /// Magnitude of the flow that ratios are taken of, never 0 \[m/s\].
    #[inline(always)]
    pub fn slow_flow(&self) -> R {
        self.flow().abs().max(R::splat(SLOW))
    }

    /// Follows tail and pitch through one physics step that started at the given pitch.
    #[inline(always)]
    fn follow_stroke(&mut self, before: R, dt: f64) {
        let zero = R::zero();
        let tail = self.body.now.x[self.body.nodes() - 1].y;
        let now = self.servo.angle;
        let stroke = &mut self.stroke;
        let crossed = before.lt(zero).and(now.lt(zero).not());
        // Linear interpolation of the crossing within the step.
        let rest = R::splat(dt) * R::select(crossed, now / (now - before), zero);
        let period = stroke.since + R::splat(dt) - rest;
        let counted = crossed.and(zero.lt(stroke.started)).and(zero.lt(period));
        stroke.frequency = R::select(counted, R::one() / period, stroke.frequency);
        stroke.width = R::select(counted, stroke.high - stroke.low, stroke.width);
        stroke.since = R::select(crossed, rest, stroke.since + R::splat(dt));
        stroke.started = R::select(crossed, R::one(), stroke.started);
        stroke.high = R::select(crossed, tail, stroke.high.max(tail));
        stroke.low = R::select(crossed, tail, stroke.low.min(tail));
    }
}

/// What takes the physics steps of a control step. Its methods stand in hot loops: they must be `#[inline(always)]`.
pub(super) trait Stepper<R: Real> {
    /// Whether no more steps are wanted.
    fn stops(&self) -> bool;
    /// One physics step to a pitch \[rad\]; returns the lanes that took it.
    fn step(&mut self, body: &mut Body<R>, pitch: R) -> R::Mask;
}

/// Steps until who watches stops them.
struct Swung<'a>(Watch<'a>);

impl<R: Real> Stepper<R> for Swung<'_> {
    #[inline(always)]
    fn stops(&self) -> bool {
        self.0.stops()
    }
    #[inline(always)]
    fn step(&mut self, body: &mut Body<R>, pitch: R) -> R::Mask {
        body.step_unless(pitch, self.0)
    }
}

/// What the servo is told in a physics step of a control step \[rad\].
#[inline(always)]
pub(super) fn command<R: Real>(
    config: &Config,
    commands: &[R],
    step: usize,
    disturbance: Option<R>,
) -> R {
    let (old, part) = (config.delay / config.substeps, config.delay % config.substeps);
    // During the first part of the step the command before is still on its way.
    let mut command = commands[if step < part { old + 1 } else { old }];
    if let Some(disturbance) = disturbance {
        command = (command + disturbance).clip(-1.0, 1.0);
    }
    command * R::splat(config.pitch_limit)
}

/// Share of the smoothed thrust that a control step replaces.
#[inline(always)]
pub(super) fn forgets(config: &Config) -> f64 {
    config.control_dt / (SMOOTHING + config.control_dt)
}

/// Parameters of these values, in the order of the table.
fn values(mut value: impl FnMut(usize) -> f64) -> Parameters {
    let mut parameters = Parameters::default();
    for i in 0..Parameters::COUNT {
        parameters.set(i, value(i)).expect("drawn within the table's range");
    }
    parameters
}
