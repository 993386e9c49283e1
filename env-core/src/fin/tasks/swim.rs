//! Swim forward with a hull.

use super::{cost, earning};
use crate::batch::Task;
use crate::fin::sensors::{BOUND, observed};
use crate::fin::{Fin, Plant, Setup};
use crate::lane::{Mask, Real};
use crate::scene::Scene;
use serde_json::json;

/// Speed that earns 1 \[m/s\].
const SPEED_SCALE: f64 = 0.1;
/// Power that costs 1 \[W\].
const POWER_SCALE: f64 = 0.05;
/// Unit of the observed hull speed \[m/s\].
const SPEED_UNIT: f64 = 0.5;
/// Standard gravity, for the cost of transport \[m/s^2\].
const GRAVITY: f64 = 9.81;

/// `speed` in [-4, 4], `power` in [-16, 0].
#[derive(Clone, Copy, Debug)]
pub struct Swim;

impl Task for Swim {
    type Machine = Fin;
    const NAME: &'static str = "swim";
    const MAX_EPISODE_STEPS: u32 = 250;
    const TERMS: &'static [&'static str] = &["speed", "power"];
    const METRICS: &'static [&'static str] = &["hull_speed", "cost_of_transport"];
    const OBSERVATION: &'static [(&'static str, f64)] = &[("hull speed / 0.5 m/s", BOUND)];

    fn setup(&self) -> Setup {
        Setup { free_swimming: true, ..Setup::default() }
    }

    #[inline(always)]
    fn score<R: Real>(&self, fin: &Fin, plant: &Plant<R>, terms: &mut [R]) -> R::Mask {
        terms[0] = earning(plant.speed, SPEED_SCALE);
        terms[1] = -cost(fin, plant, R::splat(POWER_SCALE));
        R::Mask::splat(false)
    }

    #[inline(always)]
    fn metrics<R: Real>(&self, _: &Fin, plant: &Plant<R>, metrics: &mut [R]) {
        let mut mass = plant.body.hull_mass;
        for &node in &plant.body.rod.mass {
            mass += node;
        }
        metrics[0] = plant.speed;
        metrics[1] = plant.mean.positive_power / (mass * R::splat(GRAVITY) * plant.slow_flow());
    }

    #[inline(always)]
    fn observe<R: Real>(&self, plant: &Plant<R>, observation: &mut [R]) {
        observation[0] = observed(plant.speed, SPEED_UNIT);
    }

    fn scene<R: Real>(&self, plant: &Plant<R>, lane: usize, scene: &mut Scene) {
        let pivot = plant.body.design.geometry.pivot;
        scene.values.insert("hull_position".into(), json!(plant.body.now.x[pivot].x.get(lane)));
        scene.values.insert("hull_speed".into(), json!(plant.speed.get(lane)));
    }
}
