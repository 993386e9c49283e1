//! The frame of an edge, and forces that are known there together with their derivatives.

use crate::lane::Real;
use crate::lanewise;
use crate::vec2::Vec2;
use crate::zeros;

/// Motion of one edge relative to the water, in its own frame: `t` from first to second node, `n` to
/// the left of it.
#[derive(Clone, Copy, Debug)]
pub struct EdgeMotion<R> {
    /// Length \[m\].
    pub length: R,
    /// 1 / length.
    pub inverse_length: R,
    /// Unit tangent; the unit normal is `tangent.perp()`.
    pub tangent: Vec2<R>,
    /// Tangential velocity of first and second node \[m/s\].
    pub u: [R; 2],
    /// Normal velocity of first and second node \[m/s\].
    pub w: [R; 2],
}

impl<R: Real> EdgeMotion<R> {
    /// The edge from `a` to `b` whose ends move with `va` and `vb` relative to the water.
    #[inline(always)]
    pub fn new(a: Vec2<R>, b: Vec2<R>, va: Vec2<R>, vb: Vec2<R>) -> Self {
        let e = b - a;
        let length = e.dot(e).sqrt();
        let inverse_length = R::one() / length;
        let tangent = e.scale(inverse_length);
        EdgeMotion {
            length,
            inverse_length,
            tangent,
            u: [va.dot(tangent), vb.dot(tangent)],
            w: [tangent.cross(va), tangent.cross(vb)],
        }
    }

    /// A vector given by its components along `t` and `n`, in x and y.
    #[inline(always)]
    pub fn to_world(&self, along: R, across: R) -> Vec2<R> {
        self.tangent.scale(along) + self.tangent.perp().scale(across)
    }

    /// Forces on both nodes, from edge components `(t, n)` of the first, then of the second.
    #[inline(always)]
    pub fn forces_to_world(&self, force: &[R; 4]) -> [Vec2<R>; 2] {
        [self.to_world(force[0], force[1]), self.to_world(force[2], force[3])]
    }
}

/// Forces on the two nodes of an edge, `(t, n)` of the first, then of the second, with their partial
/// derivatives by length and end velocities **in the edge's frame**.
#[derive(Clone, Copy, Debug)]
pub struct EdgeLinear<R> {
    /// The force components.
    pub force: [R; 4],
    /// Derivative by the edge's length.
    pub by_length: [R; 4],
    /// Derivatives by the tangential velocities of both nodes.
    pub by_u: [[R; 4]; 2],
    /// Derivatives by the normal velocities of both nodes.
    pub by_w: [[R; 4]; 2],
}

zeros!(EdgeLinear: force, by_length, by_u, by_w);

lanewise!(EdgeLinear: force, by_length, by_u, by_w);

impl<R: Real> EdgeLinear<R> {
    /// Derivative of the world force on node `i` by the world position of node `j`, as
    /// `blocks[i][j][row][column]`, where velocities follow positions with `dv/dq = rate`.
    ///
    /// A displaced node changes the length, turns the frame (so the force turns with it, and the same
    /// velocity has other components) and changes its own velocity.
    #[inline(always)]
    pub fn jacobian(&self, motion: &EdgeMotion<R>, rate: R) -> [[[[R; 2]; 2]; 2]; 2] {
        let mut local = [[R::zero(); 4]; 4];
        for c in 0..4 {
            let turned = if c % 2 == 0 { -self.force[c + 1] } else { self.force[c - 1] };
            let mut turn = turned;
            for end in 0..2 {
                turn += motion.w[end] * self.by_u[end][c] - motion.u[end] * self.by_w[end][c];
            }
            let turn = turn * motion.inverse_length;
            local[c] = [
                rate * self.by_u[0][c] - self.by_length[c],
                rate * self.by_w[0][c] - turn,
                rate * self.by_u[1][c] + self.by_length[c],
                rate * self.by_w[1][c] + turn,
            ];
        }
        let Vec2 { x: c, y: s } = motion.tangent;
        let (cos2, sin2) = (c * c - s * s, (c + c) * s);
        let mut blocks = [[[[R::zero(); 2]; 2]; 2]; 2];
        for i in 0..2 {
            for j in 0..2 {
                let block = [
                    [local[2 * i][2 * j], local[2 * i][2 * j + 1]],
                    [local[2 * i + 1][2 * j], local[2 * i + 1][2 * j + 1]],
                ];
                blocks[i][j] = rotate(block, cos2, sin2);
            }
        }
        blocks
    }
}

/// `Q B Q^T` for the rotation Q by the angle whose double has this cosine and sine.
#[inline(always)]
fn rotate<R: Real>(b: [[R; 2]; 2], cos2: R, sin2: R) -> [[R; 2]; 2] {
    let half = R::splat(0.5);
    let mean = half * (b[0][0] + b[1][1]);
    let stretch = half * (b[0][0] - b[1][1]);
    let shear = half * (b[0][1] + b[1][0]);
    let skew = half * (b[0][1] - b[1][0]);
    let diagonal = stretch * cos2 - shear * sin2;
    let cross = stretch * sin2 + shear * cos2;
    [[mean + diagonal, cross + skew], [cross - skew, mean - diagonal]]
}
