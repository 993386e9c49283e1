//! Planar discrete elastic rods as reinforcement-learning environments: the core.
//!
//! Physics is written once, generic over the number of environments computed side by side (`lane`);
//! machines (`pendulum`, `fin`) are plants with tasks; `batch` runs many of them with autoreset and threads.
//! No Python, no sockets, no printing here.

pub mod batch;
pub mod catalog;
mod directions;
pub mod draw;
pub mod env;
mod episodes;
pub mod error;
pub mod fault;
pub mod fin;
pub mod fluid;
pub mod given;
pub mod isa;
pub mod keywords;
pub mod lane;
pub mod linear;
pub mod pendulum;
pub mod reader;
pub mod results;
pub mod rod;
mod scene;
pub mod seed;
mod settings;
pub mod simulation;
pub mod snapshot;
pub mod solver;
mod spec;
pub mod vec2;
pub mod watch;

pub use error::{Error, Result};
