//! Resistive forces: drag across and friction along each edge (thesis 2.25 with the minus that makes
//! it resist), integrated with three Gauss points over velocities that are linear along the edge.

use super::edge::{EdgeLinear, EdgeMotion};
use super::term::{Kind, Term};
use crate::lane::Real;

/// Places of the three Gauss points on \[0, 1\]: `1/2 -+ sqrt(3/5)/2`.
const POINT: [f64; 3] = [0.112_701_665_379_258_3, 0.5, 0.887_298_334_620_741_7];
/// Their weights.
const WEIGHT: [f64; 3] = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];

/// `-c x |x|` integrated over an edge for a velocity that goes linearly from `a` to `b`: shares of the
/// first and second node, for unit length.
#[inline(always)]
fn quadratic<R: Real>(c: R, [a, b]: [R; 2]) -> [R; 2] {
    let mut shares = [R::zero(); 2];
    for (point, weight) in POINT.into_iter().zip(WEIGHT) {
        let x = R::splat(1.0 - point) * a + R::splat(point) * b;
        let f = c * x * x.abs();
        shares[0] += -(R::splat(weight * (1.0 - point)) * f);
        shares[1] += -(R::splat(weight * point) * f);
    }
    shares
}

/// The same with its symmetric derivative `[d0/da, d0/db = d1/da, d1/db]`.
#[inline(always)]
fn quadratic_linear<R: Real>(c: R, [a, b]: [R; 2]) -> ([R; 2], [R; 3]) {
    let mut shares = [R::zero(); 2];
    let mut slope = [R::zero(); 3];
    for (point, weight) in POINT.into_iter().zip(WEIGHT) {
        let x = R::splat(1.0 - point) * a + R::splat(point) * b;
        let cx = c * x.abs();
        let f = cx * x;
        shares[0] += -(R::splat(weight * (1.0 - point)) * f);
        shares[1] += -(R::splat(weight * point) * f);
        slope[0] += -(R::splat(2.0 * weight * (1.0 - point) * (1.0 - point)) * cx);
        slope[1] += -(R::splat(2.0 * weight * point * (1.0 - point)) * cx);
        slope[2] += -(R::splat(2.0 * weight * point * point) * cx);
    }
    (shares, slope)
}

/// Drag and friction on an edge, per unit of length.
#[derive(Clone, Copy, Debug)]
pub struct Resistance<R> {
    /// Multiplies `w |w|` \[kg/m^2\].
    pub drag: R,
    /// Multiplies `u |u|`, perimeter included \[kg/m^2\].
    pub friction: R,
}

impl<R: Real> Term<R> for Resistance<R> {
    const KIND: Kind = Kind::Resistance;

    #[inline(always)]
    fn force(&self, edge: &EdgeMotion<R>) -> [R; 4] {
        let along = quadratic(self.friction, edge.u);
        let across = quadratic(self.drag, edge.w);
        let l = edge.length;
        [l * along[0], l * across[0], l * along[1], l * across[1]]
    }

    #[inline(always)]
    fn add_linear(&self, _rate: R, edge: &EdgeMotion<R>, out: &mut EdgeLinear<R>) {
        let (along, along_slope) = quadratic_linear(self.friction, edge.u);
        let (across, across_slope) = quadratic_linear(self.drag, edge.w);
        let l = edge.length;
        for end in 0..2 {
            let (t, n) = (2 * end, 2 * end + 1);
            out.force[t] += -(l * along[end]);
            out.force[n] += -(l * across[end]);
            out.by_length[t] += -along[end];
            out.by_length[n] += -across[end];
            for other in 0..2 {
                out.by_u[other][t] += -(l * along_slope[end + other]);
                out.by_w[other][n] += -(l * across_slope[end + other]);
            }
        }
    }
}
