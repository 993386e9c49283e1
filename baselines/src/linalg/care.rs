//! The continuous algebraic Riccati equation, by Cayley's map and doubling.
//!
//! Chu, Fan, Lin, "A structure-preserving doubling algorithm for continuous-time algebraic Riccati
//! equations", Linear Algebra Appl. 396 (2005). Newton steps (Kleinman) polish the result.

use super::lyapunov::{geometric_mean, lyapunov};
use super::{Riccati, check, dare::doubling, spectral_abscissa, symmetric};
use crate::error::{Error, Result};
use nalgebra::DMatrix;

const EQUATION: &str = "continuous Riccati equation";

/// Solves A'X + XA - (XB + N)R^-1(B'X + N') + Q = 0 for the X that makes A - BK Hurwitz,
/// K = R^-1(B'X + N'): the regulator of the integral of z'Qz + 2z'Nu + u'Ru, thesis (4.13).
///
/// # Errors
/// Shapes that do not fit, R not positive definite; [`Error::NoSolution`] where the pair (A, B) is
/// not stabilisable or a mode on the imaginary axis does not show in the cost.
pub fn care(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<Riccati> {
    check(a, b, q, r, n)?;
    let r_chol = symmetric(r).cholesky().expect("checked above");
    let (free, weight) = match n {
        Some(n) => {
            let shift = r_chol.solve(&n.transpose());
            (a - b * &shift, q - n * shift)
        }
        None => (a.clone(), q.clone()),
    };
    let g = symmetric(&(b * r_chol.solve(&b.transpose())));
    let weight = symmetric(&weight);
    let (x, error) = best_over_shifts(&free, &g, &weight).ok_or(Error::NoSolution {
        equation: EQUATION,
        reason: "doubling did not converge; is (A, B) stabilisable, and does the cost see every \
                 mode on the imaginary axis?"
            .into(),
    })?;

    let mut rhs = b.tr_mul(&x);
    if let Some(n) = n {
        rhs += n.transpose();
    }
    let gain = r_chol.solve(&rhs);
    let closed_loop = a - b * &gain;
    let abscissa = spectral_abscissa(&closed_loop);
    if abscissa.is_nan() || abscissa >= 0.0 {
        return Err(Error::NoSolution {
            equation: EQUATION,
            reason: format!("the closed loop has a pole of real part {abscissa:.3e}"),
        });
    }
    if error.is_nan() || error > 1e-7 {
        return Err(Error::NoSolution {
            equation: EQUATION,
            reason: format!("the residual stays at {error:.2e} of its terms"),
        });
    }
    Ok(Riccati { cost: x, gain, closed_loop })
}

/// The best solution over several shifts of Cayley's map, with its residual relative to the
/// equation's terms: any shift will do in exact arithmetic, but where the solution is huge one
/// shift may keep digits that another loses.
fn best_over_shifts(
    a: &DMatrix<f64>,
    g: &DMatrix<f64>,
    q: &DMatrix<f64>,
) -> Option<(DMatrix<f64>, f64)> {
    let n = a.nrows();
    let mut hamiltonian = DMatrix::zeros(2 * n, 2 * n);
    hamiltonian.view_mut((0, 0), (n, n)).copy_from(a);
    hamiltonian.view_mut((0, n), (n, n)).copy_from(&-g);
    hamiltonian.view_mut((n, 0), (n, n)).copy_from(&-q);
    hamiltonian.view_mut((n, n), (n, n)).copy_from(&-a.transpose());
    // The geometric mean of the poles brings slow and fast ones equally far into the disc.
    let mean = geometric_mean(&hamiltonian)?;
    let mut best: Option<(DMatrix<f64>, f64)> = None;
    for factor in [1.0, 2.5, 0.4, 10.0, 0.1] {
        let Some(x) = cayley(a, g, q, mean * factor) else { continue };
        let (x, error) = polish(a, g, q, x);
        if best.as_ref().is_none_or(|b| error < b.1) {
            best = Some((x, error));
        }
        if error < 1e-12 {
            break;
        }
    }
    best
}

/// Newton's steps (Kleinman) as long as they help; the residual is relative to the equation's terms,
/// infinite where the closed loop is not stable.
fn polish(
    a: &DMatrix<f64>,
    g: &DMatrix<f64>,
    q: &DMatrix<f64>,
    mut x: DMatrix<f64>,
) -> (DMatrix<f64>, f64) {
    let measure = |x: &DMatrix<f64>| {
        let xa = x * a;
        let xgx = x * g * x;
        let scale = q.norm() + 2.0 * xa.norm() + xgx.norm();
        let residual = symmetric(&(&xa + xa.transpose() - xgx + q));
        let error = residual.norm() / scale;
        (residual, error)
    };
    let (mut residual, mut error) = measure(&x);
    for _ in 0..6 {
        let Ok(step) = lyapunov(&(a - g * &x), &residual) else {
            return (x, f64::INFINITY);
        };
        let next = symmetric(&(&x + step));
        let (next_residual, next_error) = measure(&next);
        let better = next_error < 0.7 * error;
        if !better {
            break;
        }
        (x, residual, error) = (next, next_residual, next_error);
    }
    (x, error)
}

/// Maps the Hamiltonian's half planes to inside and outside of the unit circle and doubles there.
/// `None` where the shift is an eigenvalue of A or the doubling does not converge.
fn cayley(
    a: &DMatrix<f64>,
    g: &DMatrix<f64>,
    q: &DMatrix<f64>,
    shift: f64,
) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let shifted = a - DMatrix::identity(n, n) * shift;
    let inverse = shifted.clone().try_inverse()?;
    let ag = &inverse * g;
    let w = (shifted.transpose() + q * &ag).try_inverse()?;
    let a0 = DMatrix::identity(n, n) + w.transpose() * (2.0 * shift);
    let g0 = symmetric(&(ag * &w * (2.0 * shift)));
    let h0 = symmetric(&(&w * q * &inverse * (2.0 * shift)));
    doubling(a0, g0, h0)
}
