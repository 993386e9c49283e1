//! Forces together with their exact derivative, for Newton's method, in one sweep along the rod.
//!
//! Elastic forces and bending damping depend on differences of neighbouring nodes alone, so the
//! derivative is made edge by edge: `own` is that of an edge's force by the edge itself, `up` that by the
//! edge after it, `down` that of the edge after by this one. Node i lies between edge i-1 and edge i, and its
//! blocks are sums and differences of theirs.

use super::{EdgeSlopes, Rod, Shape};
use crate::lane::{Real, Zero};
use crate::linear::{Banded, Block, Hook, block};
use crate::vec2::Vec2;
use crate::zeros;

/// What one edge adds to the force on the node at its start, and takes from that at its end.
#[derive(Clone, Copy, Debug)]
struct Edge<R> {
    pull: Vec2<R>,
    own: Block<R>,
    up: Block<R>,
    down: Block<R>,
}

zeros!(Edge: pull, own, up, down);

/// An edge of which the moment at its end is not yet known.
#[derive(Clone, Copy, Debug)]
struct OpenEdge<R> {
    t: Vec2<R>,
    inverse: R,
    tension: R,
    /// Gradient of the edge's angle, n/|e| \[1/m\].
    slope: Vec2<R>,
    /// Rate of the angle \[rad/s\].
    rate: R,
    /// Derivative of that rate by the edge, at constant de.
    turn: Vec2<R>,
    /// Sum of the moments about the edge: a moment M has the potential `M theta` \[N m\].
    couple: R,
    /// Of the bending forces.
    own: Block<R>,
    /// See `EdgeSlopes`.
    start: Vec2<R>,
    end: Vec2<R>,
}

zeros!(OpenEdge: t, inverse, tension, slope, rate, turn, couple, own, start, end);

impl<R: Real> OpenEdge<R> {
    #[inline(always)]
    fn new(rod: &Rod<R>, x: &[Vec2<R>], v: &[Vec2<R>], k: usize) -> Self {
        let (e, de) = (x[k + 1] - x[k], v[k + 1] - v[k]);
        let length = e.dot(e).sqrt();
        let inverse = R::one() / length;
        let t = e.scale(inverse);
        let slope = t.perp().scale(inverse);
        let rate = slope.dot(de);
        // Second derivative of the angle, -(t n' + n t')/|e|^2, applied to de.
        let turn = -(t.scale(rate) + slope.scale(t.dot(de))).scale(inverse);
        let tension = rod.stretch_rate[k] * length - rod.stretch[k];
        OpenEdge { t, inverse, tension, slope, rate, turn, ..OpenEdge::default() }
    }

    /// Adds the bending between this edge and the one `after` it. Returns `up`, `down` and `1 + cos(phi)`.
    #[inline(always)]
    fn bend(
        &mut self,
        after: &mut Self,
        bend: R,
        damping: R,
        per_time: R,
    ) -> (Block<R>, Block<R>, R) {
        let two = R::splat(2.0);
        let open = R::one() + self.t.dot(after.t);
        let closed = R::one() / open;
        let half = self.t.cross(after.t) * closed;
        // kappa = 2 half, sec^2(phi/2) = 1 + half^2 = 2/open: dE/dphi = (EI/l) kappa sec^2.
        let elastic = bend * two * closed;
        let moment = elastic * two * half + damping * (after.rate - self.rate);
        let rigid = elastic * two * (closed + half * half);
        let stiffness = rigid + damping * per_time;
        self.couple -= moment;
        after.couple += moment;
        // dphi/de is -slope for this edge and slope for the one after; damping adds that the slopes turn.
        let before = self.slope.scale(stiffness) + self.turn.scale(damping);
        let behind = after.slope.scale(stiffness) + after.turn.scale(damping);
        self.end = self.slope.scale(rigid) + self.turn.scale(damping);
        after.start = after.slope.scale(rigid) + after.turn.scale(damping);
        add(&mut self.own, outer(self.slope, before));
        after.own = outer(after.slope, behind);
        (outer(-self.slope, behind), outer(-after.slope, before), open)
    }

    /// The edge with all that acts on it; `along` is its stretching stiffness \[N/m\].
    #[inline(always)]
    fn close(mut self, along: R, up: Block<R>, down: Block<R>) -> (Edge<R>, EdgeSlopes<R>) {
        let pull = self.t.scale(self.tension) + self.slope.scale(self.couple);
        // Second derivative of the stretching energy, along t t' + across n n', and of the angle.
        let across = self.tension * self.inverse;
        let mixed = self.couple * self.inverse * self.inverse;
        let (cc, ss, cs) = (self.t.x * self.t.x, self.t.y * self.t.y, self.t.x * self.t.y);
        let xy = (along - across) * cs - mixed * (cc - ss);
        let twist = mixed * (cs + cs);
        let (xx, yy) = (along * cc + across * ss + twist, along * ss + across * cc - twist);
        add(&mut self.own, [[xx, xy], [xy, yy]]);
        let OpenEdge { slope: turn, start, end, own, .. } = self;
        (Edge { pull, own, up, down }, EdgeSlopes { pull: [xx, xy, yy], turn, start, end })
    }
}

#[inline(always)]
fn outer<R: Real>(a: Vec2<R>, b: Vec2<R>) -> Block<R> {
    [[a.x * b.x, a.x * b.y], [a.y * b.x, a.y * b.y]]
}

#[inline(always)]
fn add<R: Real>(to: &mut Block<R>, other: Block<R>) {
    *to = block(|r, c| to[r][c] + other[r][c]);
}

/// A sweep along the rod, node by node: an iterator over the force on each \[N\] as `forces` has it, with the base
/// torque, and its part of the matrix `-d(forces)/dx - rate d(forces)/dv`, where `rate = dv/dx` of the
/// time stepping (1/h for an implicit step of size h).
///
/// (An iterator and not a function of a closure: `next` is inlined whatever its size, a closure is not, and
/// what is not inlined has not the instructions of its caller.)
pub struct Linearized<'a, R> {
    rod: &'a Rod<R>,
    x: &'a [Vec2<R>],
    v: &'a [Vec2<R>],
    rate: R,
    node: usize,
    /// The edge before the node, and the one after it.
    before: Edge<R>,
    open: OpenEdge<R>,
    /// Of the edge after the node.
    pub slopes: EdgeSlopes<R>,
    /// What the sweep learned of the shape.
    pub shape: Shape<R>,
}

/// Starts the sweep. The base `torque` \[N m\] follows the first edge, with the potential `-T theta_1`.
#[inline(always)]
pub fn linearize<'a, R: Real>(
    rod: &'a Rod<R>,
    x: &'a [Vec2<R>],
    v: &'a [Vec2<R>],
    torque: R,
    rate: R,
) -> Linearized<'a, R> {
    let open = OpenEdge { couple: -torque, ..OpenEdge::new(rod, x, v, 0) };
    let shape = Shape { base: open.slope, openness: R::splat(2.0) };
    let (before, slopes) = (Edge::default(), EdgeSlopes::default());
    Linearized { rod, x, v, rate, node: 0, before, open, slopes, shape }
}

impl<R: Real> Iterator for Linearized<'_, R> {
    type Item = (Vec2<R>, Hook<R>);

    #[inline(always)]
    fn next(&mut self) -> Option<Self::Item> {
        let Linearized { rod, x, v, rate, node: i, before, open, slopes, shape } = self;
        let (i, nodes) = (*i, rod.nodes());
        if i == nodes {
            return None;
        }
        self.node += 1;
        // Node i needs the edge after it, which the moment at the end of that completes.
        let mut edge = Edge::default();
        if i + 2 < nodes {
            let mut next = OpenEdge::new(rod, x, v, i + 1);
            let (bend, damping) = (rod.bend[i + 1], rod.bend_damping[i + 1]);
            let (up, down, openness) = open.bend(&mut next, bend, damping, *rate);
            shape.openness = shape.openness.min(openness);
            (edge, *slopes) = open.close(rod.stretch_rate[i], up, down);
            *open = next;
        } else if i + 1 < nodes {
            (edge, *slopes) = open.close(rod.stretch_rate[i], Block::zeros(), Block::zeros());
        }
        let mut force = edge.pull - before.pull - v[i].scale(rod.damping);
        force.y -= rod.mass[i] * rod.gravity;
        let zeta = *rate * rod.damping;
        let mut diagonal =
            block(|r, c| before.own[r][c] - before.up[r][c] - before.down[r][c] + edge.own[r][c]);
        diagonal[0][0] += zeta;
        diagonal[1][1] += zeta;
        let right = block(|r, c| before.up[r][c] - edge.own[r][c] + edge.up[r][c]);
        let below = block(|r, c| before.down[r][c] - edge.own[r][c] + edge.down[r][c]);
        let right = [right, block(|r, c| -edge.up[r][c])];
        let below = [below, block(|r, c| -edge.down[r][c])];
        *before = edge;
        Some((force, Hook { diagonal, right, below }))
    }
}

/// Adds the matrix of `linearize` to `matrix`. Rows and columns 2i, 2i+1 belong to node `first + i`; nodes before
/// `first` are held.
#[inline(always)]
pub fn add_stiffness<R: Real>(
    rod: &Rod<R>,
    x: &[Vec2<R>],
    v: &[Vec2<R>],
    torque: R,
    rate: R,
    first: usize,
    matrix: &mut Banded<R>,
) {
    let mut sweep = linearize(rod, x, v, torque, rate);
    // (No `enumerate`: its `next` is not always inlined, and so would not be this sweep.)
    for i in 0..rod.nodes() {
        let Some((_, hook)) = sweep.next() else { break };
        if i >= first {
            matrix.add_hook(i - first, &hook);
        }
    }
}
