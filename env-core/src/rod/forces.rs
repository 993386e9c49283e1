//! Elastic, damping and gravity forces on the nodes, in one sweep along the rod.

use super::Rod;
use crate::lane::Real;
use crate::vec2::Vec2;

/// What a sweep learns about the shape beside the forces.
#[derive(Clone, Copy, Debug)]
pub struct Shape<R> {
    /// Gradient of the first edge's angle with its end node: n/|e| \[1/m\]. A base torque T puts
    /// the force T n/|e| on node 1 (counting from 0).
    pub base: Vec2<R>,
    /// Smallest `1 + cos(phi)` over the inner nodes: 2 for a straight rod, 0 for one folded flat.
    pub openness: R,
}

/// Forces on all nodes \[N\]: `-dE/dx - zeta v`, bending damping and gravity (thesis 2.12-2.15, indices
/// and signs corrected: with `g = dE/de`, node i gets `g_i - g_{i-1}`).
///
/// The moment at an inner node is `dE/dphi + (EI/l) beta phi'`; since `dphi/de = -n/|e|` for the edge
/// before and `n/|e|` for the edge after, each edge carries `g = tension t + (M_before - M_after) n/|e|`.
#[inline(always)]
pub fn forces<R: Real>(
    rod: &Rod<R>,
    x: &[Vec2<R>],
    v: &[Vec2<R>],
    force: &mut [Vec2<R>],
) -> Shape<R> {
    let nodes = x.len();
    let edges = nodes - 1;
    let (one, four) = (R::one(), R::splat(4.0));
    let mut shape = Shape { base: Vec2::zero(), openness: R::splat(2.0) };

    // Of the edge before: vector, length and its inverse, n/|e|, rate of turn, and its gradient without the moment
    // at its end.
    let (mut e0, mut length0, mut inverse0) = (Vec2::zero(), one, one);
    let mut slope0 = Vec2::zero();
    let mut rate0 = R::zero();
    let mut g0 = Vec2::zero();
    for k in 0..edges {
        let e = x[k + 1] - x[k];
        let length = e.dot(e).sqrt();
        // Divisions cost most: 1/|e| and 1/(|e0||e| + e0.e) come from one of their product.
        let (inverse, closed) = if k == 0 {
            (one / length, one)
        } else {
            let spread = length0 * length + e0.dot(e);
            let both = one / (length * spread);
            (both * spread, both * length)
        };
        let t = e.scale(inverse);
        let slope = t.perp().scale(inverse);
        let rate = slope.dot(v[k + 1] - v[k]);
        let mut g = t.scale(rod.stretch_rate[k] * length - rod.stretch[k]);
        if k == 0 {
            shape.base = slope;
        } else {
            // kappa = 2 half and sec^2(phi/2) = 1 + half^2 = 2/open, open = 1 + cos(phi), give
            // dE/dphi = (EI/l) 4 half/open.
            let half = e0.cross(e) * closed;
            let open_inverse = length0 * length * closed;
            let moment =
                rod.bend[k] * (four * half * open_inverse) + rod.bend_damping[k] * (rate - rate0);
            g += slope.scale(moment);
            g0 -= slope0.scale(moment);
            let open = (length0 * length + e0.dot(e)) * (inverse0 * inverse);
            shape.openness = shape.openness.min(open);
            if k == 1 {
                force[0] = g0;
            } else {
                force[k - 1] += g0;
            }
            force[k] = -g0;
        }
        (e0, length0, inverse0) = (e, length, inverse);
        slope0 = slope;
        rate0 = rate;
        g0 = g;
    }
    if edges == 1 {
        force[0] = g0;
    } else {
        force[edges - 1] += g0;
    }
    force[edges] = -g0;
    for i in 0..nodes {
        force[i].y -= rod.mass[i] * rod.gravity;
        force[i] -= v[i].scale(rod.damping);
    }
    shape
}
