//! Linear algebra in lanes: only what the implicit steppers need.

mod banded;

pub use banded::Banded;
