//! Bring the bead to rest.

use crate::bead::{Bead, Plant};
use rodgym_core::batch::Task;
use rodgym_core::lane::Real;

/// `rest` in [0, 1]; over when the bead is far out.
#[derive(Clone, Copy, Debug)]
pub struct Rest;

impl Task for Rest {
    type Machine = Bead;
    const NAME: &'static str = "rest";
    const MAX_EPISODE_STEPS: u32 = 100;
    const TERMS: &'static [&'static str] = &["rest"];

    fn setup(&self) {}

    #[inline(always)]
    fn score<R: Real>(&self, _: &Bead, plant: &Plant<R>, terms: &mut [R]) -> R::Mask {
        terms[0] = R::one() / (R::one() + plant.x * plant.x + plant.v * plant.v);
        R::splat(5.0).lt(plant.x.abs())
    }
}
