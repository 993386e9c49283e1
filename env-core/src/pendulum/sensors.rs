//! What the agent sees of the pendulum, with noise.

use super::config::{Config, Sensors, at};
use super::plant::Plant;
use crate::lane::{Mask, Real};
use crate::seed::Stream;
use crate::spec::Space;

/// Rates are observed in units of this \[rad/s\].
pub const RATE_UNIT: f64 = 10.0;
/// Bound of an observed rate, in units of `RATE_UNIT`; faster rods are clipped.
pub const RATE_BOUND: f64 = 20.0;
/// Bound of an observed tip position, in lengths of the rod.
const TIP_BOUND: f64 = 2.0;

/// The observation space.
pub fn space(config: &Config) -> Space {
    let mut space = Space::new();
    let edges = match config.sensors {
        Sensors::Full => config.nodes - 1,
        Sensors::Base => 1,
        Sensors::Tip => {
            for name in ["tip x / length", "tip y / length"] {
                space.push(-TIP_BOUND, TIP_BOUND, name);
            }
            for name in ["x", "y"] {
                let name = format!("tip {name} velocity / (length 10 rad/s)");
                space.push(-RATE_BOUND, RATE_BOUND, name);
            }
            return space;
        }
    };
    for k in 1..=edges {
        space.push(-1.0, 1.0, format!("cos(theta_{k})"));
    }
    for k in 1..=edges {
        space.push(-1.0, 1.0, format!("sin(theta_{k})"));
    }
    for k in 1..=edges {
        space.push(-RATE_BOUND, RATE_BOUND, format!("rate of theta_{k} / (10 rad/s)"));
    }
    space
}

/// Writes the observation of all lanes; draws noise where `lanes` is set: an angle and a rate for each
/// observed edge, or position (x, y) and velocity (x, y) of the tip.
#[inline(always)]
pub fn observe<R: Real>(
    config: &Config,
    plant: &Plant<R>,
    lanes: R::Mask,
    streams: &mut [Stream],
    observation: &mut [R],
) {
    let [angle_noise, rate_noise] = config.noise;
    let noisy = angle_noise > 0.0 || rate_noise > 0.0;
    let mut draw = |deviation: f64| {
        R::from_fn(|lane| if lanes.get(lane) { deviation * streams[lane].normal() } else { 0.0 })
    };
    let per_unit = R::splat(1.0 / RATE_UNIT);
    let edges = match config.sensors {
        Sensors::Full => config.nodes - 1,
        Sensors::Base => 1,
        Sensors::Tip => {
            let last = config.nodes - 1;
            let (x, v) = (plant.motion.x[last], plant.motion.v[last]);
            let inverse = R::one() / plant.parameters[at::LENGTH];
            let mut tip = [x.x * inverse, x.y * inverse, v.x * inverse, v.y * inverse];
            if noisy {
                for (i, value) in tip.iter_mut().enumerate() {
                    *value += draw(if i < 2 { angle_noise } else { rate_noise });
                }
            }
            observation[0] = tip[0].clip(-TIP_BOUND, TIP_BOUND);
            observation[1] = tip[1].clip(-TIP_BOUND, TIP_BOUND);
            observation[2] = (tip[2] * per_unit).clip(-RATE_BOUND, RATE_BOUND);
            observation[3] = (tip[3] * per_unit).clip(-RATE_BOUND, RATE_BOUND);
            return;
        }
    };
    for k in 0..edges {
        let (t, mut rate) = plant.edge(k);
        let (mut cos, mut sin) = (-t.y, t.x);
        if noisy {
            let error = draw(angle_noise);
            rate += draw(rate_noise);
            let (turned_sin, turned_cos) = (error.sin(), error.cos());
            (cos, sin) = (cos * turned_cos - sin * turned_sin, sin * turned_cos + cos * turned_sin);
        }
        observation[k] = cos.clip(-1.0, 1.0);
        observation[edges + k] = sin.clip(-1.0, 1.0);
        observation[2 * edges + k] = (rate * per_unit).clip(-RATE_BOUND, RATE_BOUND);
    }
}
