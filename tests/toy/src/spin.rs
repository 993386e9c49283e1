//! A new task for the pendulum: go round and round.

use rodgym_core::batch::Task;
use rodgym_core::lane::{Mask, Real};
use rodgym_core::pendulum::{Pendulum, Plant, Setup};

/// `spin`: rate of the first edge over 10 rad/s, in [-1, 1].
#[derive(Clone, Copy, Debug)]
pub struct Spin;

impl Task for Spin {
    type Machine = Pendulum;
    const NAME: &'static str = "spin";
    const MAX_EPISODE_STEPS: u32 = 300;
    const TERMS: &'static [&'static str] = &["spin"];
    const METRICS: &'static [&'static str] = &["base_rate"];
    const OBSERVATION: &'static [(&'static str, f64)] = &[("torque / torque_limit", 1.0)];

    fn setup(&self) -> Setup {
        Setup::default()
    }

    #[inline(always)]
    fn score<R: Real>(&self, _: &Pendulum, plant: &Plant<R>, terms: &mut [R]) -> R::Mask {
        terms[0] = (plant.edge(0).1 * R::splat(0.1)).clip(-1.0, 1.0);
        R::Mask::splat(false)
    }

    #[inline(always)]
    fn metrics<R: Real>(&self, _: &Pendulum, plant: &Plant<R>, metrics: &mut [R]) {
        metrics[0] = plant.edge(0).1;
    }

    #[inline(always)]
    fn observe<R: Real>(&self, plant: &Plant<R>, observation: &mut [R]) {
        observation[0] = plant.action;
    }
}
