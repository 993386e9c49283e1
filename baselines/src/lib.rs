//! Classical control of flexible rods, to stand beside learning agents in the same episodes.
//!
//! `linalg` solves Riccati and Lyapunov equations for any system; `pendulum` holds the models and
//! controllers of the elastic pendulum; `fin` the gaits of the fin. Every controller is a [`Controller`]: observations of a
//! batch in, actions out, its memory in an array that the caller owns.

pub mod controller;
pub mod error;
pub mod fin;
pub mod ilqr;
pub mod linalg;
pub mod pendulum;
pub mod registry;
pub mod saved;
mod target;

pub use controller::{Controller, Quantity};
pub use error::{Error, Result};
