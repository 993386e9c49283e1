//! What a filter knows of its rods, and how that lies in a caller's row of numbers.

use super::rods::{STATE, State};
use rodgym_core::lane::Real;

/// Numbers of a symmetric matrix of the state.
pub(super) const HALF: usize = STATE * (STATE + 1) / 2;

/// What a filter knows: one a lane.
#[derive(Clone, Copy, Debug)]
pub struct Belief<R> {
    /// Coordinates and rates.
    pub mean: State<R>,
    /// Logarithms of stiffness and mobility over the design's.
    pub(super) feel: [R; 2],
    /// Covariance of the state, lower half by rows.
    pub(super) covariance: [R; HALF],
    /// Covariance of state and feel.
    pub(super) cross: [R; 2 * STATE],
    /// Covariance of the feel: stiffness, both, mobility.
    pub(super) spread: [R; 3],
}

/// Row and column of the lower half.
#[inline(always)]
pub(super) const fn half(i: usize, j: usize) -> usize {
    if i >= j { i * (i + 1) / 2 + j } else { j * (j + 1) / 2 + i }
}

/// Does something with every number of a belief in turn. (Loops, for what is not inlined has no vector instructions.)
macro_rules! each {
    ($belief:ident, $number:ident => $body:block) => {
        each!($number => $body; $belief.mean, $belief.feel, $belief.covariance, $belief.cross, $belief.spread)
    };
    ($number:ident => $body:block; $($field:expr),*) => {
        $(for i in 0..$field.len() {
            let $number = &mut $field[i];
            $body
        })*
    };
}

impl<R: Real> Belief<R> {
    /// Numbers of a lane.
    pub const SIZE: usize = STATE + 2 + HALF + 2 * STATE + 3;

    /// Reads it from `SIZE` rows of numbers, one number a lane in each.
    #[inline(always)]
    pub fn read(rows: &[f64]) -> Self {
        let zero = R::zero();
        let mut belief = Belief {
            mean: [zero; STATE],
            feel: [zero; 2],
            covariance: [zero; HALF],
            cross: [zero; 2 * STATE],
            spread: [zero; 3],
        };
        let mut row = 0;
        each!(belief, number => {
            for lane in 0..R::LANES {
                number.set(lane, rows[row + lane]);
            }
            row += R::LANES;
        });
        belief
    }

    /// Writes what `read` reads.
    #[inline(always)]
    pub fn write(mut self, rows: &mut [f64]) {
        let mut row = 0;
        each!(self, number => {
            for lane in 0..R::LANES {
                rows[row + lane] = number.get(lane);
            }
            row += R::LANES;
        });
    }

    /// The numbers of `other` where the mask is set.
    #[inline(always)]
    pub fn replace(&mut self, mask: R::Mask, other: &Self) {
        for i in 0..STATE {
            self.mean[i] = R::select(mask, other.mean[i], self.mean[i]);
        }
        for i in 0..2 {
            self.feel[i] = R::select(mask, other.feel[i], self.feel[i]);
        }
        for i in 0..HALF {
            self.covariance[i] = R::select(mask, other.covariance[i], self.covariance[i]);
        }
        for i in 0..2 * STATE {
            self.cross[i] = R::select(mask, other.cross[i], self.cross[i]);
        }
        for i in 0..3 {
            self.spread[i] = R::select(mask, other.spread[i], self.spread[i]);
        }
    }

    /// What a lane has learned: logarithms of stiffness and mobility over the design's, and their covariance.
    #[inline(always)]
    pub fn learned(&self, lane: usize) -> ([f64; 2], [f64; 3]) {
        let [stiffness, mobility] = self.feel;
        let [a, b, c] = self.spread;
        ([stiffness.get(lane), mobility.get(lane)], [a.get(lane), b.get(lane), c.get(lane)])
    }
}
