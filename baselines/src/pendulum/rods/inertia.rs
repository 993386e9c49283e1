//! Cholesky's decomposition of the inertia, in every lane at once.

use super::{Coordinates, ORDER};
use rodgym_core::lane::Real;

/// Cholesky's decomposition of the inertia, in place; coordinates beyond `used` get an inertia of 1.
#[inline(always)]
pub fn factor<R: Real>(used: usize, m: &mut [Coordinates<R>; ORDER]) {
    for i in used..ORDER {
        m[i][i] = R::one();
    }
    for i in 0..ORDER {
        for j in 0..i {
            let mut sum = m[i][j];
            for c in 0..j {
                sum += -(m[i][c] * m[j][c]);
            }
            m[i][j] = sum * m[j][j];
        }
        let mut sum = m[i][i];
        for c in 0..i {
            sum += -(m[i][c] * m[i][c]);
        }
        // The diagonal holds inverses.
        m[i][i] = R::one() / sum.sqrt();
    }
}

/// Solves with a decomposition that `factor` made.
#[inline(always)]
pub fn solve<R: Real>(m: &[Coordinates<R>; ORDER], f: &mut Coordinates<R>) {
    for i in 0..ORDER {
        for c in 0..i {
            f[i] -= m[i][c] * f[c];
        }
        f[i] *= m[i][i];
    }
    for i in (0..ORDER).rev() {
        for c in i + 1..ORDER {
            f[i] -= m[c][i] * f[c];
        }
        f[i] *= m[i][i];
    }
}
