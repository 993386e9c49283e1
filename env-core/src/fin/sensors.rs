//! What the agent sees of the fin, with noise.

use super::config::{Config, Sensors};
use super::plant::Plant;
use super::servo::{RATE_LIMIT, STAGES};
use crate::lane::{Mask, Real};
use crate::seed::Stream;
use crate::spec::Space;
use crate::vec2::Vec2;

/// Unit of the observed pitch and turning angles \[rad\].
pub const ANGLE_UNIT: f64 = 0.5;
/// Unit of the observed turning rates \[rad/s\].
pub const RATE_UNIT: f64 = 5.0;
/// Unit of the observed thrust \[N\].
pub const THRUST_UNIT: f64 = 0.5;
/// Unit of the observed torque \[N m\].
pub const TORQUE_UNIT: f64 = 0.1;
/// Observations are clipped to this many units.
pub const BOUND: f64 = 10.0;

/// The observation space.
pub fn space(config: &Config) -> Space {
    let mut space = Space::new();
    let nodes = config.design.geometry.nodes();
    let mut bounded = |name: String| space.push(-BOUND, BOUND, name);
    match config.sensors {
        Sensors::Full => {
            bounded("pitch / 0.5 rad".into());
            bounded(format!("pitch rate / {RATE_LIMIT} rad/s"));
            for stage in 1..=STAGES {
                bounded(format!("smoothed command, stage {stage} / 0.5 rad"));
                bounded(format!("its rate / {RATE_LIMIT} rad/s"));
            }
            (2..nodes).for_each(|i| bounded(format!("turning angle at node {i} / 0.5 rad")));
            (2..nodes).for_each(|i| bounded(format!("turning rate at node {i} / 5 rad/s")));
            bounded("mean thrust of the last step / 0.5 N".into());
            bounded("mean torque of the last step / 0.1 N m".into());
        }
        Sensors::Camera => {
            bounded("last command".into());
            (1..=nodes).for_each(|i| bounded(format!("y of node {i} / edge length")));
        }
    }
    space
}

/// Writes the observation of all lanes; draws noise where `lanes` is set, an angle and then a rate for
/// the servo and for each turning angle (camera: a sideways position a node, angle noise times edge length).
#[inline(always)]
pub fn observe<R: Real>(
    config: &Config,
    plant: &Plant<R>,
    lanes: R::Mask,
    streams: &mut [Stream],
    observation: &mut [R],
) {
    let [angle_noise, rate_noise] = config.noise;
    let mut noise = |deviation: f64| {
        if deviation == 0.0 {
            return R::zero();
        }
        R::from_fn(|lane| if lanes.get(lane) { deviation * streams[lane].normal() } else { 0.0 })
    };
    let mut slots = observation.iter_mut();
    let slots = &mut slots;
    let (x, v) = (&plant.body.now.x, &plant.body.now.v);
    match config.sensors {
        Sensors::Full => {
            put(slots, plant.servo.angle + noise(angle_noise), ANGLE_UNIT);
            put(slots, plant.servo.rate + noise(rate_noise), RATE_LIMIT);
            for stage in &plant.servo.smoothed {
                put(slots, stage.angle, ANGLE_UNIT);
                put(slots, stage.rate, RATE_LIMIT);
            }
            // Tangent of half the turning angle is what the rod knows; the angle itself is what one reads.
            let last = x.len() - 1;
            let mut before = tangent(x, v, 0).0;
            for k in 1..last {
                let after = tangent(x, v, k).0;
                let (cosine, sine) = (before.dot(after), before.cross(after));
                let half = sine / (R::one() + cosine);
                let angle = half.atan();
                put(slots, angle + angle + noise(angle_noise), ANGLE_UNIT);
                before = after;
            }
            let mut before = tangent(x, v, 0).1;
            for k in 1..last {
                let after = tangent(x, v, k).1;
                put(slots, after - before + noise(rate_noise), RATE_UNIT);
                before = after;
            }
            put(slots, plant.mean.thrust, THRUST_UNIT);
            put(slots, plant.mean.torque, TORQUE_UNIT);
        }
        Sensors::Camera => {
            put(slots, plant.commands[0], 1.0);
            let edge = config.design.geometry.edge_length;
            for node in x {
                put(slots, node.y + noise(angle_noise * edge), edge);
            }
        }
    }
}

// (Functions, since a closure is not always inlined.)

/// Writes a number as it is observed into the next slot.
#[inline(always)]
fn put<R: Real>(slots: &mut std::slice::IterMut<'_, R>, value: R, unit: f64) {
    *slots.next().expect("the space has one for each") = observed(value, unit);
}

/// Unit tangent of edge k, and the rate at which it turns.
#[inline(always)]
fn tangent<R: Real>(x: &[Vec2<R>], v: &[Vec2<R>], k: usize) -> (Vec2<R>, R) {
    let e = x[k + 1] - x[k];
    let inverse = R::one() / e.dot(e).sqrt();
    let t = e.scale(inverse);
    (t, t.cross(v[k + 1] - v[k]) * inverse)
}

/// A number as it is observed: in its unit, clipped.
#[inline(always)]
pub fn observed<R: Real>(value: R, unit: f64) -> R {
    (value * R::splat(1.0 / unit)).clip(-BOUND, BOUND)
}
