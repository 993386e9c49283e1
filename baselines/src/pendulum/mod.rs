//! The elastic pendulum: models and controllers.

mod adaptive;
mod analysis;
mod arrival;
mod bank;
mod belief;
mod chain;
mod design;
mod filter;
mod hybrid;
mod linear;
mod lqg;
mod lqr;
mod noise;
mod prior;
mod regulator;
mod rods;
mod schedule;
mod thesis;
mod thesis_lqg;

pub use adaptive::LqgAdaptive;
pub use analysis::{Reach, buckling_width, discrete_buckling_width, reach};
pub use arrival::Arrival;
pub use chain::{Chain, ChainEnergy, MAX_COORDINATES};
pub use design::RodDesign;
pub use hybrid::HybridLqr;
pub(crate) use hybrid::RATE_SCALE;
pub use linear::{LinearModel, Weights, upright};
pub use lqg::Lqg;
pub use lqr::Lqr;
pub use noise::Noise;
pub use prior::Prior;
pub use regulator::{Regulator, gentle_weights};
pub use rods::ORDER;
pub use thesis::{ProcessNoise, ThesisDesign, ThesisRun, ThesisStep};
pub use thesis_lqg::ThesisLqg;
