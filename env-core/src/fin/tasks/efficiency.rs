//! A demanded thrust at the least power.

use super::cost;
use crate::batch::Task;
use crate::fin::sensors::{BOUND, THRUST_UNIT, observed};
use crate::fin::{Fin, Plant, Setup};
use crate::lane::{Mask, Real};
use crate::scene::Scene;
use serde_json::json;

/// Relative error of the thrust at which the tracking term is a half.
const TRACKING_WIDTH: f64 = 0.25;
/// Power for a newton of demanded thrust that costs a half \[W/N\].
const POWER_PER_THRUST: f64 = 0.2;

/// Name of the number of an observation that is the demanded thrust.
pub const DEMAND: &str = "demanded thrust / 0.5 N";

/// `tracking` in [0, 1], `power` in [-16, 0].
#[derive(Clone, Copy, Debug)]
pub struct Efficiency;

impl Task for Efficiency {
    type Machine = Fin;
    const NAME: &'static str = "efficiency";
    const MAX_EPISODE_STEPS: u32 = 200;
    const TERMS: &'static [&'static str] = &["tracking", "power"];
    const METRICS: &'static [&'static str] = &["demand", "smooth_thrust"];
    const OBSERVATION: &'static [(&'static str, f64)] =
        &[(DEMAND, BOUND), ("thrust smoothed over 0.5 s / 0.5 N", BOUND)];

    fn setup(&self) -> Setup {
        Setup::default()
    }

    #[inline(always)]
    fn score<R: Real>(&self, fin: &Fin, plant: &Plant<R>, terms: &mut [R]) -> R::Mask {
        let relative =
            (plant.smooth_thrust - plant.demand) / (R::splat(TRACKING_WIDTH) * plant.demand);
        let relative = relative.clip(-1e100, 1e100);
        terms[0] = R::one() / (R::one() + relative * relative);
        terms[1] = -cost(fin, plant, R::splat(2.0 * POWER_PER_THRUST) * plant.demand);
        R::Mask::splat(false)
    }

    #[inline(always)]
    fn metrics<R: Real>(&self, _: &Fin, plant: &Plant<R>, metrics: &mut [R]) {
        metrics[0] = plant.demand;
        metrics[1] = plant.smooth_thrust;
    }

    #[inline(always)]
    fn observe<R: Real>(&self, plant: &Plant<R>, observation: &mut [R]) {
        observation[0] = observed(plant.demand, THRUST_UNIT);
        observation[1] = observed(plant.smooth_thrust, THRUST_UNIT);
    }

    fn scene<R: Real>(&self, plant: &Plant<R>, lane: usize, scene: &mut Scene) {
        scene.values.insert("demand".into(), json!(plant.demand.get(lane)));
    }
}
