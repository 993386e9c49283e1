//! Continuous systems and costs seen through a zero-order hold.

use super::symmetric;
use nalgebra::DMatrix;

/// A sampled system z' = A z + B u and its exact cost z'Qz + 2z'Nu + u'Ru a sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampled {
    /// State matrix of one period.
    pub a: DMatrix<f64>,
    /// Input matrix of one period, input held.
    pub b: DMatrix<f64>,
    /// Cost of the state.
    pub q: DMatrix<f64>,
    /// Cost of the input.
    pub r: DMatrix<f64>,
    /// Cross cost (states, inputs).
    pub n: DMatrix<f64>,
}

/// State and input matrix over one period `dt` \[s\] with the input held.
pub fn sample(a: &DMatrix<f64>, b: &DMatrix<f64>, dt: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let (n, m) = b.shape();
    let mut block = DMatrix::zeros(n + m, n + m);
    block.view_mut((0, 0), (n, n)).copy_from(&(a * dt));
    block.view_mut((0, n), (n, m)).copy_from(&(b * dt));
    let e = block.exp();
    (e.view((0, 0), (n, n)).into(), e.view((0, n), (n, m)).into())
}

/// System and cost over one period `dt` \[s\] with the input held: the sampled cost is the integral of
/// z'Qz + u'Ru along the motion, exactly.
///
/// Van Loan, "Computing integrals involving the matrix exponential", IEEE Trans. Autom. Control 23
/// (1978). The period is halved until the exponential of -A' stays tame, then doubled back, since
/// Van Loan's block holds growing and decaying modes side by side.
pub fn sample_cost(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    dt: f64,
) -> Sampled {
    let (n, m) = b.shape();
    let size = n + m;
    // State and held input together: x = (z, u), x' = F x, cost x'Wx.
    let mut f = DMatrix::zeros(size, size);
    f.view_mut((0, 0), (n, n)).copy_from(a);
    f.view_mut((0, n), (n, m)).copy_from(b);
    let mut w = DMatrix::zeros(size, size);
    w.view_mut((0, 0), (n, n)).copy_from(q);
    w.view_mut((n, n), (m, m)).copy_from(r);

    let mut halvings = 0;
    let mut step = dt;
    while f.norm() * step > 1.0 && halvings < 60 {
        step *= 0.5;
        halvings += 1;
    }
    let mut block = DMatrix::zeros(2 * size, 2 * size);
    block.view_mut((0, 0), (size, size)).copy_from(&(f.transpose() * -step));
    block.view_mut((0, size), (size, size)).copy_from(&(&w * step));
    block.view_mut((size, size), (size, size)).copy_from(&(&f * step));
    let e = block.exp();
    let mut phi: DMatrix<f64> = e.view((size, size), (size, size)).into();
    let mut cost = symmetric(&(phi.tr_mul(&e.view((0, size), (size, size)).into_owned())));
    for _ in 0..halvings {
        cost = symmetric(&(&cost + phi.tr_mul(&cost) * &phi));
        phi = &phi * &phi;
    }
    Sampled {
        a: phi.view((0, 0), (n, n)).into(),
        b: phi.view((0, n), (n, m)).into(),
        q: cost.view((0, 0), (n, n)).into(),
        r: cost.view((n, n), (m, m)).into(),
        n: cost.view((0, n), (n, m)).into(),
    }
}
