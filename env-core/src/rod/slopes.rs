//! The derivative of the forces as a map, edge by edge: of changes of the motion to changes of the forces, and back.
//!
//! Forces depend on the edges `e` and on how fast they change. An edge pulls by `S de + n/|e| dC`, where S is symmetric and
//! C the couple of the moments at its start and its end, each of which follows the two edges beside it. That takes two
//! thirds of the products that the blocks of the matrix take (`linear`), and differences come before products, so that
//! little cancels.

use super::Rod;
use crate::lane::Real;
use crate::vec2::Vec2;
use crate::zeros;

/// The derivative of what one edge does.
#[derive(Clone, Copy, Debug)]
pub struct EdgeSlopes<R> {
    /// Of its pull by itself at constant moments: xx, xy and yy of a symmetric block \[N/m\].
    pub pull: [R; 3],
    /// Of its angle: n/|e| \[1/m\].
    pub turn: Vec2<R>,
    /// Of the moments at its start, and at its end with the opposite sign, by it at a constant rate \[N\].
    pub start: Vec2<R>,
    /// See `start`.
    pub end: Vec2<R>,
}

zeros!(EdgeSlopes: pull, turn, start, end);

impl<R: Real> EdgeSlopes<R> {
    /// Those of one lane, the same in every lane of `T`.
    #[inline(always)]
    fn of_lane<T: Real>(&self, lane: usize) -> EdgeSlopes<T> {
        let one = |x: &R| T::splat(x.get(lane));
        let two = |p: &Vec2<R>| Vec2::new(one(&p.x), one(&p.y));
        let [xx, xy, yy] = &self.pull;
        EdgeSlopes {
            pull: [one(xx), one(xy), one(yy)],
            turn: two(&self.turn),
            start: two(&self.start),
            end: two(&self.end),
        }
    }

    /// The symmetric block, applied.
    #[inline(always)]
    fn stiffen(&self, e: Vec2<R>) -> Vec2<R> {
        let [xx, xy, yy] = self.pull;
        Vec2::new(xx * e.x + xy * e.y, xy * e.x + yy * e.y)
    }
}

/// By how much forces change with changes `x` of the positions and `v` of the velocities, about what is in one lane of
/// `edges`. The first node is held: what it bears is left out.
#[inline(always)]
pub fn force_changes<R: Real, T: Real>(
    rod: &Rod<f64>,
    edges: &[EdgeSlopes<R>],
    lane: usize,
    [x, v]: [&[Vec2<T>]; 2],
    forces: &mut [Vec2<T>],
) {
    let last = edges.len();
    let (x, v, forces) = (&x[..=last], &v[..=last], &mut forces[..=last]);
    // Of the edge before: the gradient of its angle, its pull but for the moment at its end, and how fast it turns. And
    // the pull of the one before that.
    let mut turn = Vec2::zero();
    let (mut pull, mut rate, mut moment_of_before) = (Vec2::zero(), T::zero(), T::zero());
    let mut pull_before = Vec2::zero();
    for k in 0..last {
        let edge = edges[k].of_lane::<T>(lane);
        let (e, de) = (x[k + 1] - x[k], v[k + 1] - v[k]);
        let own_rate = edge.turn.dot(de);
        let mut own = edge.stiffen(e);
        if k > 0 {
            let damping = T::splat(rod.bend_damping[k]);
            let moment = edge.start.dot(e) - moment_of_before + damping * (own_rate - rate);
            own += edge.turn.scale(moment);
            pull -= turn.scale(moment);
            forces[k - 1] = pull - pull_before;
            pull_before = pull;
        }
        moment_of_before = edge.end.dot(e);
        (turn, pull, rate) = (edge.turn, own, own_rate);
    }
    forces[last - 1] = pull - pull_before;
    forces[last] = -pull;
    forces[0] = Vec2::zero();
    if rod.damping != 0.0 {
        for i in 1..=last {
            forces[i] -= v[i].scale(T::splat(rod.damping));
        }
    }
}

/// The transposed map: from the gradient by the forces, of which the first node's is zero, to those by positions and by
/// velocities.
#[inline(always)]
pub fn force_gradients<R: Real, T: Real>(
    rod: &Rod<f64>,
    edges: &[EdgeSlopes<R>],
    lane: usize,
    forces: &[Vec2<T>],
    [x, v]: [&mut [Vec2<T>]; 2],
) {
    let last = edges.len();
    let (x, v, forces) = (&mut x[..=last], &mut v[..=last], &forces[..=last]);
    // Of the edge before: two of its slopes, and the gradients by it, by its rate and by the couple that bends it. And
    // those by the one before that.
    let (mut turn, mut end) = (Vec2::zero(), Vec2::zero());
    let (mut e, mut rate, mut couple) = (Vec2::zero(), T::zero(), T::zero());
    let (mut e_before, mut de_before) = (Vec2::zero(), Vec2::zero());
    for k in 0..last {
        let edge = edges[k].of_lane::<T>(lane);
        let pull = forces[k] - forces[k + 1];
        let mut own = edge.stiffen(pull);
        let mut own_rate = T::zero();
        let own_couple = edge.turn.dot(pull);
        if k > 0 {
            let moment = own_couple - couple;
            let damped = T::splat(rod.bend_damping[k]) * moment;
            own += edge.start.scale(moment);
            own_rate = damped;
            e -= end.scale(moment);
            let de = turn.scale(rate - damped);
            (x[k - 1], v[k - 1]) = (e_before - e, de_before - de);
            (e_before, de_before) = (e, de);
        }
        (turn, end, e, rate, couple) = (edge.turn, edge.end, own, own_rate, own_couple);
    }
    let de = turn.scale(rate);
    (x[last - 1], v[last - 1]) = (e_before - e, de_before - de);
    (x[last], v[last]) = (e, de);
    (x[0], v[0]) = (Vec2::zero(), Vec2::zero());
    if rod.damping != 0.0 {
        for i in 1..=last {
            v[i] -= forces[i].scale(T::splat(rod.damping));
        }
    }
}
