//! The continuous algebraic Riccati equation, by Cayley's map and doubling.
//!
//! Chu, Fan, Lin, "A structure-preserving doubling algorithm for continuous-time algebraic Riccati
//! equations", Linear Algebra Appl. 396 (2005). Newton steps (Kleinman) polish the result. All of it
//! happens in units of the states in which the equation is balanced.

use super::lyapunov::{geometric_mean, lyapunov};
use super::{Riccati, check, dare::doubling, eigenvalues, spectral_abscissa, symmetric};
use crate::error::{Error, Result};
use nalgebra::{DMatrix, DVector};

const EQUATION: &str = "continuous Riccati equation";

/// Solves A'X + XA - (XB + N)R^-1(B'X + N') + Q = 0 for the X that makes A - BK Hurwitz,
/// K = R^-1(B'X + N'): the regulator of the integral of z'Qz + 2z'Nu + u'Ru, thesis (4.13).
///
/// # Errors
/// Shapes that do not fit, R not positive definite; [`Error::NoSolution`] where the pair (A, B) is
/// not stabilisable or a mode on the imaginary axis does not show in the cost;
/// [`Error::Inaccurate`] where rounding leaves too few digits.
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
    let units = units(&free, &g, &weight);
    let inverse = units.map(|unit| 1.0 / unit);
    let hamiltonian = Hamiltonian {
        a: scaled(&free, &inverse, &units),
        g: scaled(&g, &inverse, &inverse),
        q: scaled(&weight, &units, &units),
    };
    let (x, error) = hamiltonian.best_over_shifts().ok_or(Error::NoSolution {
        equation: EQUATION,
        reason: "doubling did not converge; is (A, B) stabilisable, and does the cost see every \
                 mode on the imaginary axis?"
            .into(),
    })?;
    let x = scaled(&x, &inverse, &inverse);

    let mut rhs = b.tr_mul(&x);
    if let Some(n) = n {
        rhs += n.transpose();
    }
    let gain = r_chol.solve(&rhs);
    let closed_loop = a - b * &gain;
    let abscissa = spectral_abscissa(&closed_loop);
    if abscissa.is_nan() || abscissa >= 0.0 {
        let found = format!("the closed loop found has a pole of real part {abscissa:.3e}");
        // Half of the Hamiltonian's modes would be those of the closed loop.
        let margin = hamiltonian.margin();
        return Err(if margin > 1e-8 {
            let reason =
                format!("{found}; (A, B) is hardly stabilisable, or the weights are too far apart");
            Error::Inaccurate { equation: EQUATION, reason }
        } else {
            Error::NoSolution { equation: EQUATION, reason: found }
        });
    }
    if error.is_nan() || error > 1e-7 {
        return Err(Error::Inaccurate {
            equation: EQUATION,
            reason: format!("the residual stays at {error:.1e} of its terms, allowed are 1e-7"),
        });
    }
    Ok(Riccati { cost: x, gain, closed_loop })
}

/// Units of the states, powers of two, in which each row of the Hamiltonian [A, -G; -Q, -A'] is as
/// large as its column (Parlett and Reinsch's balancing, with the same unit for a state and, inverted,
/// for its costate, so that the Hamiltonian stays one).
fn units(a: &DMatrix<f64>, g: &DMatrix<f64>, q: &DMatrix<f64>) -> DVector<f64> {
    let n = a.nrows();
    let mut units = DVector::from_element(n, 1.0);
    for _ in 0..SWEEPS {
        let mut settled = true;
        for i in 0..n {
            let (mut row, mut column) = (0.0, 0.0);
            for j in 0..n {
                let ratio: f64 = units[j] / units[i];
                let product: f64 = units[j] * units[i];
                if j != i {
                    row += (a[(i, j)] * ratio).powi(2);
                    column += (a[(j, i)] / ratio).powi(2);
                }
                row += (g[(i, j)] / product).powi(2);
                column += (q[(i, j)] * product).powi(2);
            }
            // The unit u multiplies the column by u and the row by 1/u.
            let power = (0.25 * libm::log2(row / column)).round();
            if power.is_finite() && power != 0.0 {
                units[i] *= libm::exp2(power);
                settled = false;
            }
        }
        if settled {
            break;
        }
    }
    units
}

/// Sweeps over all states; a few settle the units.
const SWEEPS: usize = 100;

/// Row i times `rows[i]`, column j times `columns[j]`.
fn scaled(m: &DMatrix<f64>, rows: &DVector<f64>, columns: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] * rows[i] * columns[j])
}

/// Shifts to try, in units of the geometric mean of the poles, until one keeps all digits.
const SHIFTS: [f64; 9] = [1.0, 2.5, 0.4, 10.0, 0.1, 30.0, 0.03, 100.0, 0.01];

/// Blocks of [A, -G; -Q, -A'], in the units in which it is balanced.
struct Hamiltonian {
    a: DMatrix<f64>,
    g: DMatrix<f64>,
    q: DMatrix<f64>,
}

impl Hamiltonian {
    fn matrix(&self) -> DMatrix<f64> {
        let n = self.a.nrows();
        let mut whole = DMatrix::zeros(2 * n, 2 * n);
        whole.view_mut((0, 0), (n, n)).copy_from(&self.a);
        whole.view_mut((0, n), (n, n)).copy_from(&-&self.g);
        whole.view_mut((n, 0), (n, n)).copy_from(&-&self.q);
        whole.view_mut((n, n), (n, n)).copy_from(&-self.a.transpose());
        whole
    }

    /// Distance of the nearest mode from the imaginary axis, as a share of the largest mode.
    fn margin(&self) -> f64 {
        let modes = eigenvalues(&self.matrix());
        let nearest = modes.iter().map(|z| z.re.abs()).fold(f64::INFINITY, f64::min);
        nearest / modes.iter().map(|z| libm::hypot(z.re, z.im)).fold(0.0, f64::max)
    }

    /// The best solution over several shifts of Cayley's map, with its residual relative to the
    /// equation's terms: any shift will do in exact arithmetic, but where the solution is huge one
    /// shift may keep digits that another loses.
    fn best_over_shifts(&self) -> Option<(DMatrix<f64>, f64)> {
        let Hamiltonian { a, g, q } = self;
        // The geometric mean of the poles brings slow and fast ones equally far into the disc.
        let mean = geometric_mean(&self.matrix())?;
        let mut best: Option<(DMatrix<f64>, f64)> = None;
        for factor in SHIFTS {
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
