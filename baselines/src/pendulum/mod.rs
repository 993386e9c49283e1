//! The elastic pendulum: models and controllers.

mod analysis;
mod chain;
mod design;
mod estimator;
mod hybrid;
mod linear;
mod lqg;
mod lqr;
mod regulator;
mod thesis;
mod thesis_lqg;

pub use analysis::{Reach, buckling_width, discrete_buckling_width, reach};
pub use chain::{Chain, ChainEnergy, MAX_COORDINATES};
pub use design::RodDesign;
pub use estimator::{Estimator, Noise};
pub use hybrid::HybridLqr;
pub(crate) use hybrid::RATE_SCALE;
pub use linear::{LinearModel, Weights, upright};
pub use lqg::{Lqg, ORDER};
pub use lqr::Lqr;
pub use regulator::{Regulator, gentle_weights};
pub use thesis::{ProcessNoise, ThesisDesign, ThesisRun, ThesisStep};
pub use thesis_lqg::ThesisLqg;
