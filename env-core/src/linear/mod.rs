//! Linear algebra in lanes: only what the implicit steppers need.

mod banded;
mod border;
mod elimination;

pub use banded::Banded;
pub use border::Border;
pub use elimination::{Ascent, Block, Descent, Front, Hook, block, multiply, multiply_row, solve};
