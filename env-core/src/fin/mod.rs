//! The flexible fin: a rod of varying section, pitched near its nose, in water (thesis chapters 2 and 3).
//!
//! x points downstream, from nose to tail; the water moves along +x; thrust is the force of the water on
//! the fin along -x. The servo prescribes the edge behind the pivot node. Errata of the thesis and the
//! derivation of the forces are in `docs/physics.md`.

mod body;
pub mod config;
pub mod cycle;
mod derivative;
mod design;
pub mod geometry;
mod machine;
mod motion;
pub mod parameters;
pub mod plant;
mod residual;
pub mod sensors;
pub mod servo;
mod sim;
mod step;
pub mod tasks;
mod workspace;

pub use crate::solver::Scheme;
pub use body::Body;
pub use config::{Config, Setup};
pub use design::Design;
pub use geometry::Geometry;
pub use machine::Fin;
pub use motion::Loads;
pub use parameters::Parameters;
pub use plant::Plant;
pub use sim::{BareFin, Energies, Forces};
