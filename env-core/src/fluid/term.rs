//! A term of force on an edge, and who gathers terms: a residual, its derivative, loads or arrows.

use super::edge::{EdgeLinear, EdgeMotion};
use crate::lane::Real;

/// Which term of force it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Drag and friction.
    Resistance,
    /// What the water that moves with the body gives back; the rate of its momentum comes beside the force.
    AddedMass,
    /// Momentum shed at the tail.
    TailFlux,
}

/// A force on the two nodes of an edge.
pub trait Term<R: Real> {
    /// Which it is.
    const KIND: Kind;

    /// Force on both nodes, `(t, n)` of the first, then of the second \[N\], without the rate of `momentum`.
    fn force(&self, edge: &EdgeMotion<R>) -> [R; 4];
    /// Normal momentum of the water that belongs to the first and second node \[kg m/s\].
    #[inline(always)]
    fn momentum(&self, _edge: &EdgeMotion<R>) -> [R; 2] {
        [R::zero(); 2]
    }
    /// Kinetic energy of that water \[J\].
    #[inline(always)]
    fn energy(&self, _edge: &EdgeMotion<R>) -> R {
        R::zero()
    }
    /// Adds `rate * momentum - force` and its derivatives: what the term contributes to the residual of an implicit
    /// step whose time derivative is `rate (momentum - earlier momentum)`.
    fn add_linear(&self, rate: R, edge: &EdgeMotion<R>, out: &mut EdgeLinear<R>);
}

/// Who gathers the terms. Its methods stand in hot loops: they must be `#[inline(always)]`.
pub trait Gather<R: Real> {
    /// Edge `k` begins.
    #[inline(always)]
    fn open(&mut self) {}
    /// A term that acts on edge `k`.
    fn add<T: Term<R>>(&mut self, k: usize, edge: &EdgeMotion<R>, term: &T);
    /// All that acts on edge `k` was added.
    #[inline(always)]
    fn close(&mut self, _k: usize, _edge: &EdgeMotion<R>) {}
}
