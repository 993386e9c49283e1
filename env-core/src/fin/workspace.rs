//! Memory of a step.

use crate::lane::Real;
use crate::linear::{Banded, Border};
use crate::vec2::Vec2;

/// Memory that a step needs, kept so that it allocates nothing.
#[derive(Clone, Debug)]
pub(super) struct Workspace<R> {
    pub(super) residual: Vec<Vec2<R>>,
    pub(super) momentum: Vec<Vec2<R>>,
    pub(super) matrix: Banded<R>,
    pub(super) right: Vec<Vec2<R>>,
    pub(super) border: Border<R>,
    /// Multiplies the tolerance.
    pub(super) sharpness: f64,
}

impl<R: Real> Workspace<R> {
    pub(super) fn new(nodes: usize) -> Self {
        let zeros = || vec![Vec2::zero(); nodes];
        let (matrix, border) = (Banded::new(nodes), Border::new(nodes));
        let (residual, momentum, right) = (zeros(), zeros(), zeros());
        Workspace { residual, momentum, matrix, right, border, sharpness: 1.0 }
    }
}
