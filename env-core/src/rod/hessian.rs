//! Exact derivative of the elastic and bending-damping forces, for Newton's method.

use super::Rod;
use crate::lane::Real;
use crate::linear::Banded;
use crate::vec2::Vec2;

/// A symmetric or general 2 x 2 block.
type Block<R> = [[R; 2]; 2];

/// Adds `-d(forces)/dx - rate d(forces)/dv` to `matrix`, where `rate = dv/dx` of the time stepping (1/h for
/// an implicit step of size h). Gravity adds nothing; nodal damping adds `rate zeta` on the diagonal.
///
/// `torque` is the base torque \[N m\]: it follows the first edge, with the potential `-T theta_1`.
/// Rows and columns 2i, 2i+1 of the matrix belong to node `first + i`; nodes before `first` are held.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "these are the arguments of the mathematics")]
pub fn add_stiffness<R: Real>(
    rod: &Rod<R>,
    x: &[Vec2<R>],
    v: &[Vec2<R>],
    torque: R,
    rate: R,
    first: usize,
    matrix: &mut Banded<R>,
) {
    let nodes = x.len();
    let (one, two) = (R::one(), R::splat(2.0));
    let mut t0 = Vec2::zero();
    let mut slope0 = Vec2::zero();
    let mut inverse0 = R::zero();
    let mut de0 = Vec2::zero();
    let mut tension0 = R::zero();
    // Coefficient of the second derivative of the angle of the edge before: its moments so far.
    let mut couple0 = R::zero();
    for k in 0..nodes - 1 {
        let e = x[k + 1] - x[k];
        let length = e.dot(e).sqrt();
        let inverse = one / length;
        let t = e.scale(inverse);
        let slope = t.perp().scale(inverse);
        let de = v[k + 1] - v[k];
        let tension = rod.stretch_rate[k] * length - rod.stretch[k];
        let mut couple = if k == 0 { -torque } else { R::zero() };
        if k > 0 {
            let open = one + t0.dot(t);
            let half = t0.cross(t) / open;
            let sec2 = two / open;
            let kappa2 = R::splat(4.0) * half * half;
            let bend = rod.bend[k];
            let damping = rod.bend_damping[k];
            let moment = bend * two * half * sec2 + damping * (slope.dot(de) - slope0.dot(de0));
            let stiffness = bend * (sec2 * sec2 + R::splat(0.5) * kappa2 * sec2) + damping * rate;
            couple += moment;
            couple0 -= moment;
            // dphi/dx of the three nodes, and what damping adds because dphi/dx turns with the edges.
            let gradient = [slope0, -(slope0 + slope), slope];
            let turn0 = angle_hessian(t0, inverse0, de0);
            let turn = angle_hessian(t, inverse, de);
            let change = [turn0, -(turn0 + turn), turn];
            for r in 0..3 {
                for c in 0..3 {
                    if k - 1 + r < first || k - 1 + c < first {
                        continue;
                    }
                    let row = gradient[r];
                    let column = gradient[c].scale(stiffness) + change[c].scale(damping);
                    let block = [
                        [row.x * column.x, row.x * column.y],
                        [row.y * column.x, row.y * column.y],
                    ];
                    matrix.add_block(k - 1 + r - first, k - 1 + c - first, block);
                }
            }
            add_edge(
                matrix,
                first,
                k - 1,
                edge_block(t0, inverse0, rod.stretch_rate[k - 1], tension0, couple0),
            );
        }
        t0 = t;
        slope0 = slope;
        inverse0 = inverse;
        de0 = de;
        tension0 = tension;
        couple0 = couple;
    }
    let last = nodes - 2;
    let block = edge_block(t0, inverse0, rod.stretch_rate[last], tension0, couple0);
    add_edge(matrix, first, last, block);
    for i in first..nodes {
        let zero = R::zero();
        let zeta = rate * rod.damping;
        matrix.add_block(i - first, i - first, [[zeta, zero], [zero, zeta]]);
    }
}

/// Second derivative of an edge's angle, `-(t n' + n t')/|e|^2`, applied to a vector.
#[inline(always)]
fn angle_hessian<R: Real>(t: Vec2<R>, inverse: R, u: Vec2<R>) -> Vec2<R> {
    let n = t.perp();
    -(t.scale(n.dot(u)) + n.scale(t.dot(u))).scale(inverse * inverse)
}

/// Second derivative by the edge vector of stretching energy plus `couple` times the edge's angle.
#[inline(always)]
fn edge_block<R: Real>(t: Vec2<R>, inverse: R, rate: R, tension: R, couple: R) -> Block<R> {
    let n = t.perp();
    let along = rate;
    let across = tension * inverse;
    let mixed = -(couple * inverse * inverse);
    let xy = along * t.x * t.y + across * n.x * n.y + mixed * (t.x * n.y + n.x * t.y);
    let two = R::splat(2.0);
    [
        [along * t.x * t.x + across * n.x * n.x + two * mixed * t.x * n.x, xy],
        [xy, along * t.y * t.y + across * n.y * n.y + two * mixed * t.y * n.y],
    ]
}

/// Spreads the block of edge k over its two nodes.
#[inline(always)]
fn add_edge<R: Real>(matrix: &mut Banded<R>, first: usize, k: usize, block: Block<R>) {
    let minus = [[-block[0][0], -block[0][1]], [-block[1][0], -block[1][1]]];
    if k >= first {
        matrix.add_block(k - first, k - first, block);
        matrix.add_block(k - first, k + 1 - first, minus);
        matrix.add_block(k + 1 - first, k - first, minus);
    }
    if k + 1 >= first {
        matrix.add_block(k + 1 - first, k + 1 - first, block);
    }
}
