//! Trajectories by iterated linear-quadratic regulators (iLQR): of a nonlinear machine with one action within bounds.
//!
//! An iteration expands dynamics (to first order) and losses (to second) about a trajectory, solves that problem backwards
//! for changes of the actions and for feedback (`sweep`), and follows both forwards. Bounds are kept as control-limited
//! differential dynamic programming does (Tassa, Mansard, Todorov 2014, doi:10.1109/ICRA.2014.6907001), whose box-constrained
//! programme is, of one action, a clip.

mod cost;
mod search;
mod sweep;

pub use cost::{Cost, Quadratic};
pub use search::{Options, Search, Status};
pub use sweep::{Model, Policy, sweep};
