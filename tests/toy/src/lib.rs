//! A bead on a spring, what is asked of it, and a new task for the pendulum.

pub mod bead;
pub mod damper;
pub mod drawing;
pub mod rest;
pub mod spin;

use rodgym_core::catalog::{self, Entry};

/// Adds it all to rodgym's tables.
///
/// # Errors
/// Something of that name is there already.
pub fn register() -> rodgym_baselines::Result<()> {
    catalog::register(Entry::new("toy/BeadRest-v0", rest::Rest))?;
    catalog::register(Entry::new("toy/PendulumSpin-v0", spin::Spin))?;
    rodgym_render::register(drawing::BEAD)?;
    rodgym_baselines::registry::register(damper::DAMPER)
}
