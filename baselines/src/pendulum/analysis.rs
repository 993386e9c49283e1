//! How well a rod can be moved and seen from its base, and when it buckles, as functions of geometry
//! and stiffness.

use super::{RodDesign, upright};
use crate::error::Result;
use crate::linalg::{sample_cost, symmetric};
use nalgebra::DMatrix;

/// First zero of the Bessel function J of order -1/3, thesis (4.16).
const BESSEL_ZERO: f64 = 1.866_350_858_7;

/// Controllability and observability about up over a time sqrt(L/g), without units: time counts in
/// sqrt(L/g), torque in m g L / 2, angles in radians.
#[derive(Clone, Debug, PartialEq)]
pub struct Reach {
    /// Number of states, 2(N - 1).
    pub states: usize,
    /// Numerical rank of the controllability Gramian.
    pub controllable: usize,
    /// Numerical rank of the observability Gramian (base angle and rate).
    pub observable: usize,
    /// Singular values of the map from past torque to future readings, largest first.
    pub hankel: Vec<f64>,
    /// Smallest singular value of (lambda - A, B) over the poles lambda: how far the nearest
    /// uncontrollable system is.
    pub distance: f64,
}

/// Analyses a rod about up.
///
/// # Errors
/// A rod that is not allowed.
pub fn reach(rod: &RodDesign) -> Result<Reach> {
    rod.check()?;
    let n = rod.edges();
    let time = libm::sqrt(rod.length / rod.gravity.max(1e-3));
    let weight = 0.5 * rod.node_mass() * n as f64 * rod.gravity.max(1e-3) * rod.length;
    let model = upright(rod);
    // Rates in units of 1/time, time in units of itself.
    let scale = |i: usize| if i < n { 1.0 } else { time };
    let a = DMatrix::from_fn(2 * n, 2 * n, |i, j| model.a[(i, j)] * time * scale(i) / scale(j));
    let b = DMatrix::from_fn(2 * n, 1, |i, _| model.b[(i, 0)] * time * weight * scale(i));
    let c = DMatrix::from_fn(2, 2 * n, |i, j| {
        model.c[(i, j)] * if i == 0 { 1.0 } else { time } / scale(j)
    });
    let gramian = |a: &DMatrix<f64>, b: &DMatrix<f64>| {
        let still = DMatrix::zeros(2 * n, 1);
        let none = DMatrix::zeros(1, 1);
        symmetric(&sample_cost(a, &still, &(b * b.transpose()), &none, 1.0).q)
    };
    let to = gramian(&a.transpose(), &b);
    let from = gramian(&a, &c.transpose());
    let rank = |m: &DMatrix<f64>| {
        let values = m.clone().symmetric_eigenvalues();
        let floor = values.max() * 2.0 * n as f64 * f64::EPSILON;
        values.iter().filter(|v| **v > floor).count()
    };
    // Hankel values by the symmetric root of one Gramian: no eigenvalues of a product.
    let root = {
        let eigen = to.clone().symmetric_eigen();
        let roots = eigen.eigenvalues.map(|v| libm::sqrt(v.max(0.0)));
        &eigen.eigenvectors * DMatrix::from_diagonal(&roots)
    };
    let mut hankel: Vec<f64> = symmetric(&(root.transpose() * &from * &root))
        .symmetric_eigenvalues()
        .iter()
        .map(|v| libm::sqrt(v.max(0.0)))
        .collect();
    hankel.sort_by(|x, y| y.total_cmp(x));
    Ok(Reach {
        states: 2 * n,
        controllable: rank(&to),
        observable: rank(&from),
        hankel,
        distance: distance(&a, &b),
    })
}

/// min over poles of the smallest singular value of (lambda - A, B) (Popov, Belevitch, Hautus).
fn distance(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    let n = a.nrows();
    let mut least = f64::INFINITY;
    for pole in crate::linalg::eigenvalues(a).iter() {
        let mut pencil = DMatrix::from_element(n, n + 1, nalgebra::Complex::new(0.0, 0.0));
        for i in 0..n {
            for j in 0..n {
                pencil[(i, j)].re = -a[(i, j)];
            }
            pencil[(i, i)] += pole;
            pencil[(i, n)].re = b[(i, 0)];
        }
        least = least.min(pencil.singular_values().min());
    }
    least
}

/// Width below which the continuous rod, clamped at its base, buckles under its own weight \[m\], thesis
/// (4.16).
pub fn buckling_width(rod: &RodDesign) -> f64 {
    let cube = rod.length * rod.length * rod.length;
    let ratio = rod.density * rod.gravity / rod.youngs_modulus;
    libm::sqrt(16.0 * cube * ratio / (3.0 * BESSEL_ZERO * BESSEL_ZERO))
}

/// The same for the chain with its first edge clamped \[m\]: what the discrete rod does.
///
/// 0 for a single edge, which cannot bend. Stiffness goes with w^4 and weight with w^2, so the width squared is an eigenvalue.
pub fn discrete_buckling_width(rod: &RodDesign) -> f64 {
    let n = rod.edges() - 1;
    if n == 0 {
        // One rigid edge.
        return 0.0;
    }
    let unit = RodDesign { width: 1.0, ..rod.clone() };
    let stiffness = unit.bending_stiffness() / unit.edge_length();
    // Angles of the free edges; edge 0 stands still.
    let bend = DMatrix::from_fn(n, n, |i, j| match i.abs_diff(j) {
        0 if i + 1 == n => stiffness,
        0 => 2.0 * stiffness,
        1 => -stiffness,
        _ => 0.0,
    });
    let weight = DMatrix::from_fn(n, n, |i, j| {
        if i == j { unit.gravity * unit.edge_length() * unit.mass_beyond(i + 1) } else { 0.0 }
    });
    let inverse = bend.cholesky().expect("a clamped chain is stiff").l().try_inverse();
    let inverse = inverse.expect("a Cholesky factor has an inverse");
    libm::sqrt(symmetric(&(&inverse * weight * inverse.transpose())).symmetric_eigenvalues().max())
}
