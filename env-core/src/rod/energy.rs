//! Energies by kind.

use super::Rod;
use crate::lane::Real;
use crate::vec2::Vec2;

/// Energies of a rod \[J\].
#[derive(Clone, Copy, Debug, Default)]
pub struct Energy<R> {
    /// Stretching, `sum EA l (|e|/l - 1)^2 / 2`.
    pub stretch: R,
    /// Bending, `sum (EI/l) kappa^2 / 2`.
    pub bend: R,
    /// Gravity, `g sum m y`.
    pub gravity: R,
    /// Kinetic, `sum m v^2 / 2`.
    pub kinetic: R,
}

impl<R: Real> Energy<R> {
    /// Sum of all kinds.
    pub fn total(&self) -> R {
        self.stretch + self.bend + self.gravity + self.kinetic
    }
}

/// Energies of a rod in the given motion (thesis 2.10, 2.11).
pub fn energy<R: Real>(rod: &Rod<R>, x: &[Vec2<R>], v: &[Vec2<R>]) -> Energy<R> {
    let half = R::splat(0.5);
    let mut sum = Energy::default();
    let mut before = Vec2::zero();
    for k in 0..x.len() - 1 {
        let e = x[k + 1] - x[k];
        let length = e.dot(e).sqrt();
        let t = e.scale(R::one() / length);
        let strain = length / rod.rest[k] - R::one();
        sum.stretch += half * rod.stretch[k] * rod.rest[k] * strain * strain;
        if k > 0 {
            let kappa = curvature(before, t);
            sum.bend += half * rod.bend[k] * kappa * kappa;
        }
        before = t;
    }
    for i in 0..x.len() {
        sum.gravity += rod.gravity * rod.mass[i] * x[i].y;
        sum.kinetic += half * rod.mass[i] * v[i].dot(v[i]);
    }
    sum
}

/// Signed curvature `2 tan(phi/2)` between two unit tangents (thesis 2.3, with its sign).
#[inline(always)]
pub fn curvature<R: Real>(before: Vec2<R>, after: Vec2<R>) -> R {
    R::splat(2.0) * before.cross(after) / (R::one() + before.dot(after))
}
