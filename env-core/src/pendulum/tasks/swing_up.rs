//! From hanging to upright, and stay.

use super::{EFFORT_WEIGHT, effort};
use crate::batch::Task;
use crate::lane::{Mask, Real};
use crate::pendulum::{Pendulum, Plant, Sensors, Setup};

/// Rate at which the rate term is full \[rad/s\].
const FULL_RATE: f64 = 20.0;
const RATE_WEIGHT: f64 = 0.05;

/// `height` (1 + y/L)/2 in [0, 1], `rate` in [-0.05, 0], `effort` in [-0.02, 0].
#[derive(Clone, Copy, Debug)]
pub struct SwingUp {
    /// What the agent sees unless asked otherwise.
    pub sensors: Sensors,
}

impl Task for SwingUp {
    type Machine = Pendulum;
    const NAME: &'static str = "swing_up";
    const MAX_EPISODE_STEPS: u32 = 500;
    const REWARD_THRESHOLD: Option<f64> = Some(400.0);
    const TERMS: &'static [&'static str] = &["height", "rate", "effort"];

    fn setup(&self) -> Setup {
        Setup { sensors: self.sensors, ..Setup::default() }
    }

    #[inline(always)]
    fn score<R: Real>(&self, _: &Pendulum, plant: &Plant<R>, terms: &mut [R]) -> R::Mask {
        let share = plant.posture.rates / R::splat(plant.edges() as f64 * FULL_RATE * FULL_RATE);
        terms[0] = ((R::one() + plant.tip_height()) * R::splat(0.5)).clip(0.0, 1.0);
        terms[1] = -(R::splat(RATE_WEIGHT) * share.min(R::one()));
        terms[2] = effort(plant);
        R::Mask::splat(false)
    }

    /// With t an edge's unit tangent, a share l/L of the height that is lost is 1 - t . up = |t - up|^2 / 2.
    fn residuals<R: Real>(&self, _: &Pendulum, plant: &Plant<R>, out: &mut Vec<R>) {
        let edges = plant.edges() as f64;
        let (height, rate) =
            (R::splat(0.5 / edges).sqrt(), R::splat(2.0 * RATE_WEIGHT / edges).sqrt());
        for k in 0..plant.edges() {
            let (t, turning) = plant.edge(k);
            out.extend([t.x * height, (t.y - R::one()) * height]);
            out.push(turning * rate * R::splat(1.0 / FULL_RATE));
        }
        out.push(plant.action * R::splat(2.0 * EFFORT_WEIGHT).sqrt());
    }
}
