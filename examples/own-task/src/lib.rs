//! A task of one's own for the pendulum: hold the rod level, its tip as high as its hinge.
//!
//! Copy this crate, change `score`, and call `register` before you make an environment.

use rodgym_core::batch::Task;
use rodgym_core::catalog::{self, Entry};
use rodgym_core::error::Result;
use rodgym_core::lane::{Mask, Real};
use rodgym_core::pendulum::{Pendulum, Plant, Setup};

/// Id of the environment.
pub const LEVEL: &str = "example/PendulumLevel-v0";

/// `level`: 1 minus the tip's distance from the hinge's height, over the length, in \[0, 1\]; `effort`: -0.02 a^2.
#[derive(Clone, Copy, Debug)]
pub struct Level;

impl Task for Level {
    type Machine = Pendulum;
    const NAME: &'static str = "level";
    const MAX_EPISODE_STEPS: u32 = 300;
    const TERMS: &'static [&'static str] = &["level", "effort"];

    fn setup(&self) -> Setup {
        Setup::default()
    }

    // It runs for eight rods at once: no branch on a number, and always inlined.
    #[inline(always)]
    fn score<R: Real>(&self, _: &Pendulum, plant: &Plant<R>, terms: &mut [R]) -> R::Mask {
        terms[0] = (R::one() - plant.tip_height().abs()).clip(0.0, 1.0);
        terms[1] = -(R::splat(0.02) * plant.action * plant.action);
        R::Mask::splat(false)
    }
}

/// Adds the environment to the catalogue.
///
/// # Errors
/// Something of that name is there already.
pub fn register() -> Result<()> {
    catalog::register(Entry::new(LEVEL, Level))
}
