//! The discrete algebraic Riccati equation, by structure-preserving doubling.
//!
//! Chu, Fan, Lin, Wang, "Structure-preserving algorithms for periodic discrete-time algebraic
//! Riccati equations", Int. J. Control 77 (2004): pass k holds the optimal cost of 2^k steps, so the
//! horizon doubles at each pass. One Newton step (Hewer) afterwards removes what rounding left.

use super::{Riccati, check, lyapunov::stein, spectral_radius, symmetric};
use crate::error::{Error, Result};
use nalgebra::DMatrix;

/// Solves A'XA - X - (A'XB + N)(R + B'XB)^-1(B'XA + N') + Q = 0 for the X that makes A - BK stable,
/// K = (R + B'XB)^-1(B'XA + N'): the regulator of sum z'Qz + 2z'Nu + u'Ru.
///
/// # Errors
/// Shapes that do not fit, R not positive definite; [`Error::NoSolution`] where the pair (A, B) is
/// not stabilisable or an eigenvalue on the unit circle does not show in the cost;
/// [`Error::Inaccurate`] where rounding leaves too few digits.
pub fn dare(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<Riccati> {
    check(a, b, q, r, n)?;
    let r_chol = symmetric(r).cholesky().expect("checked above");
    // The cross term is removed by u = v - R^-1 N' z.
    let (free, weight) = match n {
        Some(n) => {
            let shift = r_chol.solve(&n.transpose());
            (a - b * &shift, q - n * shift)
        }
        None => (a.clone(), q.clone()),
    };
    let x = doubling(free.clone(), b * r_chol.solve(&b.transpose()), symmetric(&weight)).ok_or(
        Error::NoSolution {
            equation: EQUATION,
            reason: "doubling did not converge; is (A, B) stabilisable, and does the cost see \
                     every mode on the unit circle?"
                .into(),
        },
    )?;
    let mut best = solution(a, b, r, n, x)?;
    let mut error = residual(a, b, q, n, &best).norm();
    // Newton's correction solves a Stein equation with the closed loop.
    for _ in 0..3 {
        let Ok(step) = stein(&best.closed_loop, &residual(a, b, q, n, &best)) else { break };
        let next = solution(a, b, r, n, symmetric(&(&best.cost + step)))?;
        let next_error = residual(a, b, q, n, &next).norm();
        let better = next_error < 0.5 * error;
        if !better {
            break;
        }
        (best, error) = (next, next_error);
    }
    verify(&best, error, a, q)
}

const EQUATION: &str = "discrete Riccati equation";

/// The doubling iteration from (A, G, H); `None` where it does not converge. Also the engine of the
/// continuous equation.
pub(super) fn doubling(
    mut a: DMatrix<f64>,
    mut g: DMatrix<f64>,
    mut h: DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let size = a.nrows();
    for _ in 0..60 {
        let w = (DMatrix::identity(size, size) + &g * &h).lu();
        let wa = w.solve(&a)?;
        let wg = w.solve(&g)?;
        let step = symmetric(&(a.tr_mul(&h) * &wa));
        g = symmetric(&(&g + &a * wg * a.transpose()));
        a = &a * wa;
        h += &step;
        let change = step.norm();
        if !change.is_finite() || !h.norm().is_finite() {
            return None;
        }
        if change <= 1e-16 * h.norm() {
            return Some(h);
        }
    }
    None
}

/// Gain and closed loop of a cost matrix.
fn solution(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
    x: DMatrix<f64>,
) -> Result<Riccati> {
    let xb = &x * b;
    let mut rhs = xb.tr_mul(a);
    if let Some(n) = n {
        rhs += n.transpose();
    }
    let gain = symmetric(&(r + b.tr_mul(&xb)))
        .cholesky()
        .ok_or_else(|| Error::NoSolution {
            equation: EQUATION,
            reason: "R + B'XB is not positive definite".into(),
        })?
        .solve(&rhs);
    Ok(Riccati { closed_loop: a - b * &gain, cost: x, gain })
}

/// Left side of the equation.
fn residual(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
    s: &Riccati,
) -> DMatrix<f64> {
    let mut cross = a.tr_mul(&s.cost) * b;
    if let Some(n) = n {
        cross += n;
    }
    symmetric(&(a.tr_mul(&s.cost) * a - &s.cost - cross * &s.gain + q))
}

/// Refuses what is not a stabilising solution.
fn verify(s: &Riccati, error: f64, a: &DMatrix<f64>, q: &DMatrix<f64>) -> Result<Riccati> {
    let radius = spectral_radius(&s.closed_loop);
    // The terms of the equation are what the residual is small against.
    let scale = s.cost.norm() + q.norm() + 2.0 * (a.tr_mul(&s.cost) * a).norm();
    if radius.is_nan() || radius >= 1.0 {
        return Err(Error::NoSolution {
            equation: EQUATION,
            reason: format!("the closed loop has spectral radius {radius:.9}"),
        });
    }
    if error.is_nan() || error > 1e-7 * scale {
        let left = error / scale;
        return Err(Error::Inaccurate {
            equation: EQUATION,
            reason: format!("the residual stays at {left:.1e} of its terms, allowed are 1e-7"),
        });
    }
    Ok(s.clone())
}
