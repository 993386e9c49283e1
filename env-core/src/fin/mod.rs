//! The flexible fin: a rod of varying section, pitched near its nose, in water (thesis chapters 2 and 3).
//!
//! x points downstream, from nose to tail; the water moves along +x; thrust is the force of the water on
//! the fin along -x. The servo prescribes the edge behind the pivot node. Errata of the thesis and the
//! derivation of the forces are in `docs/physics.md`.

pub mod config;
pub mod cycle;
pub mod geometry;
mod machine;
pub mod parameters;
pub mod plant;
mod residual;
pub mod rig;
pub mod sensors;
pub mod servo;
mod sim;
mod step;
pub mod tasks;

pub use crate::solver::Scheme;
pub use config::{Config, Setup};
pub use geometry::Geometry;
pub use machine::Fin;
pub use parameters::Parameters;
pub use plant::{Design, Loads, Plant};
pub use rig::Rig;
pub use sim::{BareFin, Energies, Forces};
