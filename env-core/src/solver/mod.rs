//! Time stepping, in lanes.
//!
//! Schemes are tables (`scheme`); `implicit` solves their stages by Newton's method for any `System`, freezes lanes
//! that have converged, and takes steps that fail in halves. It knows no equation: a system predicts, corrects and
//! accepts. `pinned` is the system of a rod whose first node is pinned and whose first edge bears a torque;
//! `Integrator` steps it, by `verlet` where that is asked for: explicit, and by far the most accurate for its cost
//! where its step limit allows. `tape` writes down what one rod did, `tangent` carries derivatives
//! along, `adjoint` back.

mod adjoint;
mod drive;
mod implicit;
mod integrator;
mod moment;
mod pinned;
mod scheme;
mod tangent;
mod tape;
mod verlet;

pub use adjoint::pull_back;
pub use drive::{Constant, Drive, Feedback};
pub use implicit::{Part, Past, Solver, System};
pub use integrator::Integrator;
pub(crate) use moment::{slopes, splat};
pub use scheme::{Origin, Row, Scheme, Stage, Table};
pub use tangent::{Carried, Phase, carry};
pub use tape::{Move, Tape};
pub(crate) use tape::{Recorded, Told};
pub use verlet::{Witness, prepare, verlet};

/// Smallest `1 + cos(phi)` of a joint that counts as a rod and not as a failure: a turning angle of 168.5
/// degrees, where the bending energy of the default rod is 8 J, a thousand times what its motor gives.
pub const FOLDED: f64 = 0.02;
