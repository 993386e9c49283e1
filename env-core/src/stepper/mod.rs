//! Time steppers of a rod whose first node is pinned and whose first edge bears a torque.
//!
//! `verlet` is explicit and by far the most accurate for its cost where its step limit allows; `implicit` holds
//! the thesis' backward Euler and a second-order method for stiff rods. `Integrator` chooses among them,
//! and retries a step that fails in smaller parts.

mod drive;
mod implicit;
mod integrator;
mod verlet;

pub use drive::{Constant, Drive, Feedback};
pub use implicit::{Method, Workspace};
pub use integrator::{Integrator, Scheme};
pub use verlet::{prepare, verlet};

/// Smallest `1 + cos(phi)` of a joint that counts as a rod and not as a failure: a turning angle of 168.5
/// degrees, where the bending energy of the default rod is 8 J, a thousand times what its motor gives.
pub const FOLDED: f64 = 0.02;
