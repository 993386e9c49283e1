//! Matrix equations of linear control, for any system; dense, for orders up to some hundreds.

mod care;
mod dare;
mod discretize;
mod lyapunov;

pub use care::care;
pub use dare::dare;
pub use discretize::{Sampled, sample, sample_cost};
pub use lyapunov::{lyapunov, stein};

use nalgebra::{DMatrix, DVector};

/// The stabilising solution of a Riccati equation.
#[derive(Clone, Debug, PartialEq)]
pub struct Riccati {
    /// Cost-to-go matrix P: the cost from state z is z'Pz.
    pub cost: DMatrix<f64>,
    /// Feedback gain K of u = -K z.
    pub gain: DMatrix<f64>,
    /// A - B K.
    pub closed_loop: DMatrix<f64>,
}

/// Half the sum of a matrix and its transpose: removes the asymmetry of rounding.
pub fn symmetric(m: &DMatrix<f64>) -> DMatrix<f64> {
    (m + m.transpose()) * 0.5
}

/// Largest modulus of an eigenvalue: below 1 for a stable sampled system.
pub fn spectral_radius(m: &DMatrix<f64>) -> f64 {
    eigenvalue_fold(m, libm::hypot)
}

/// Largest real part of an eigenvalue: below 0 for a stable continuous system.
pub fn spectral_abscissa(m: &DMatrix<f64>) -> f64 {
    eigenvalue_fold(m, |re, _| re)
}

fn eigenvalue_fold(m: &DMatrix<f64>, f: impl Fn(f64, f64) -> f64) -> f64 {
    eigenvalues(m).iter().map(|z| f(z.re, z.im)).fold(f64::NEG_INFINITY, f64::max)
}

/// Eigenvalues of a square matrix, balanced first (the companion-like matrices of mechanics hold
/// numbers of very different size); NaN where the iteration did not converge.
pub fn eigenvalues(m: &DMatrix<f64>) -> DVector<nalgebra::Complex<f64>> {
    let unknown = || DVector::from_element(m.nrows(), nalgebra::Complex::new(f64::NAN, f64::NAN));
    if m.is_empty() || m.iter().any(|x| !x.is_finite()) {
        return unknown();
    }
    // Balancing squares its numbers, and never ends where a square is infinite.
    let largest = m.amax();
    let usual = largest == 0.0 || (1e-100..1e100).contains(&largest);
    let unit = if usual { 1.0 } else { libm::exp2(libm::floor(libm::log2(largest))) };
    let mut balanced = m / unit;
    nalgebra::linalg::balancing::balance_parlett_reinsch(&mut balanced);
    match nalgebra::linalg::Schur::try_new(balanced, f64::EPSILON, 100 * m.nrows().max(10)) {
        Some(schur) => schur.complex_eigenvalues().map(|z| z.scale(unit)),
        None => unknown(),
    }
}

/// Checks the shapes of A (n, n), B (n, m), Q (n, n), R (m, m), N (n, m) and that R is positive definite.
fn check(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> crate::Result<()> {
    let (states, inputs) = b.shape();
    if b.is_empty() {
        let wanted = "(n, m) with at least one state and one input";
        return Err(crate::error::shape("B", format!("{:?}", b.shape()), wanted));
    }
    let wanted = [
        ("A", Some(a), (states, states)),
        ("Q", Some(q), (states, states)),
        ("R", Some(r), (inputs, inputs)),
        ("N", n, (states, inputs)),
    ];
    for (name, matrix, shape) in wanted {
        if let Some(matrix) = matrix
            && matrix.shape() != shape
        {
            return Err(crate::error::shape(
                name,
                format!("{:?}", matrix.shape()),
                format!("{shape:?}"),
            ));
        }
    }
    let all = [Some(a), Some(b), Some(q), Some(r), n];
    if all.into_iter().flatten().any(|m| m.iter().any(|x| !x.is_finite())) {
        return Err(crate::error::parameter("A, B, Q, R, N", "NaN or infinity", "finite"));
    }
    if symmetric(r).cholesky().is_none() {
        let rows: Vec<Vec<f64>> = r.row_iter().map(|row| row.iter().copied().collect()).collect();
        return Err(crate::error::parameter("R", format!("{rows:?}"), "positive definite"));
    }
    Ok(())
}
