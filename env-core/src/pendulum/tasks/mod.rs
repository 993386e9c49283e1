//! Tasks of the pendulum, one a file.

mod balance;
mod swing_up;

pub use balance::{Balance, FALLEN};
pub use swing_up::SwingUp;

use super::Plant;
use crate::lane::Real;

const EFFORT_WEIGHT: f64 = 0.02;

/// What the action costs, in [-0.02, 0].
#[inline(always)]
fn effort<R: Real>(plant: &Plant<R>) -> R {
    -(R::splat(EFFORT_WEIGHT) * plant.action * plant.action)
}
