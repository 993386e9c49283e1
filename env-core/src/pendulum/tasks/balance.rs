//! Stay up.

use super::effort;
use crate::batch::Task;
use crate::lane::Real;
use crate::pendulum::{Pendulum, Plant, Setup};
use std::f64::consts::PI;

/// Tip height (in lengths) below which a balanced rod has fallen.
pub const FALLEN: f64 = 0.5;

/// `upright` 1 or 0, `effort` in [-0.02, 0]; over when the rod has fallen.
#[derive(Clone, Copy, Debug)]
pub struct Balance;

impl Task for Balance {
    type Machine = Pendulum;
    const NAME: &'static str = "balance";
    const MAX_EPISODE_STEPS: u32 = 1000;
    const REWARD_THRESHOLD: Option<f64> = Some(950.0);
    const TERMS: &'static [&'static str] = &["upright", "effort"];

    fn setup(&self) -> Setup {
        Setup { start_angle: (PI - 0.05, PI + 0.05), start_bend: (-0.2, 0.2), ..Setup::default() }
    }

    #[inline(always)]
    fn score<R: Real>(&self, _: &Pendulum, plant: &Plant<R>, terms: &mut [R]) -> R::Mask {
        let fallen = plant.tip_height().lt(R::splat(FALLEN));
        terms[0] = R::select(fallen, R::zero(), R::one());
        terms[1] = effort(plant);
        fallen
    }
}
