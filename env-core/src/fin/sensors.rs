//! What the agent sees of the fin, with noise.

use super::config::{Config, Sensors};
use super::plant::Plant;
use super::servo::{RATE_LIMIT, STAGES};
use crate::lane::{Mask, Real};
use crate::seed::Stream;
use crate::spec::Space;

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
    let mut at = 0;
    let mut put = |value: R, unit: f64| {
        observation[at] = observed(value, unit);
        at += 1;
    };
    let (x, v) = (&plant.body.now.x, &plant.body.now.v);
    match config.sensors {
        Sensors::Full => {
            put(plant.servo.angle + noise(angle_noise), ANGLE_UNIT);
            put(plant.servo.rate + noise(rate_noise), RATE_LIMIT);
            for stage in &plant.servo.smoothed {
                put(stage.angle, ANGLE_UNIT);
                put(stage.rate, RATE_LIMIT);
            }
            // Tangent of half the turning angle is what the rod knows; the angle itself is what one reads.
            let tangent = |k: usize| {
                let e = x[k + 1] - x[k];
                let inverse = R::one() / e.dot(e).sqrt();
                let t = e.scale(inverse);
                (t, t.cross(v[k + 1] - v[k]) * inverse)
            };
            let last = x.len() - 1;
            let mut before = tangent(0).0;
            for k in 1..last {
                let after = tangent(k).0;
                let (cosine, sine) = (before.dot(after), before.cross(after));
                let half = sine / (R::one() + cosine);
                let angle = half.atan();
                put(angle + angle + noise(angle_noise), ANGLE_UNIT);
                before = after;
            }
            let mut before = tangent(0).1;
            for k in 1..last {
                let after = tangent(k).1;
                put(after - before + noise(rate_noise), RATE_UNIT);
                before = after;
            }
            put(plant.mean.thrust, THRUST_UNIT);
            put(plant.mean.torque, TORQUE_UNIT);
        }
        Sensors::Camera => {
            put(plant.commands[0], 1.0);
            let edge = config.design.geometry.edge_length;
            for node in x {
                put(node.y + noise(angle_noise * edge), edge);
            }
        }
    }
}

/// A number as it is observed: in its unit, clipped.
#[inline(always)]
pub fn observed<R: Real>(value: R, unit: f64) -> R {
    (value * R::splat(1.0 / unit)).clip(-BOUND, BOUND)
}
