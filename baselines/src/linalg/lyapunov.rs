//! Lyapunov and Stein equations by Smith's doubling: each pass doubles the number of summed terms.

use super::symmetric;
use crate::error::{Error, Result};
use nalgebra::DMatrix;

/// X = A' X A + Q for a stable A (all eigenvalues inside the unit circle).
///
/// # Errors
/// [`Error::NoSolution`] where A is not stable.
pub fn stein(a: &DMatrix<f64>, q: &DMatrix<f64>) -> Result<DMatrix<f64>> {
    let mut power = a.clone();
    let mut x = symmetric(q);
    for _ in 0..64 {
        let term = power.tr_mul(&x) * &power;
        x += &term;
        power = &power * &power;
        let size = term.norm();
        if !size.is_finite() {
            break;
        }
        if size <= 1e-18 * x.norm() {
            return Ok(symmetric(&x));
        }
    }
    Err(Error::NoSolution {
        equation: "Stein equation X = A'XA + Q",
        reason: format!("A has an eigenvalue of modulus {:.6}", super::spectral_radius(a)),
    })
}

/// A' X + X A + Q = 0 for a Hurwitz A, through Cayley's map of the half plane onto the disc.
///
/// # Errors
/// [`Error::NoSolution`] where A is not Hurwitz.
pub fn lyapunov(a: &DMatrix<f64>, q: &DMatrix<f64>) -> Result<DMatrix<f64>> {
    let n = a.nrows();
    let no_solution = || Error::NoSolution {
        equation: "Lyapunov equation A'X + XA + Q = 0",
        reason: format!("A has an eigenvalue of real part {:.6e}", super::spectral_abscissa(a)),
    };
    // The geometric mean of the eigenvalues brings slow and fast ones equally far into the disc.
    let shift = geometric_mean(a).ok_or_else(no_solution)?;
    let minus = (DMatrix::identity(n, n) * shift - a).try_inverse().ok_or_else(no_solution)?;
    let cayley = (DMatrix::identity(n, n) * shift + a) * &minus;
    stein(&cayley, &(minus.tr_mul(q) * &minus * (2.0 * shift))).map_err(|_| no_solution())
}

/// Geometric mean of the moduli of the eigenvalues, from the pivots of an LU decomposition; `None`
/// for a singular matrix.
pub(super) fn geometric_mean(m: &DMatrix<f64>) -> Option<f64> {
    let lu = m.clone().lu();
    let mut log = 0.0;
    for pivot in lu.u().diagonal().iter() {
        if *pivot == 0.0 || !pivot.is_finite() {
            return None;
        }
        log += libm::log(pivot.abs());
    }
    Some(libm::exp(log / m.nrows() as f64))
}
