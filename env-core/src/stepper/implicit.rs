//! Implicit steps by Newton's method: backward Euler (the thesis, Fig. 2.4) and SDIRK2.
//!
//! Every stage solves `M (v - v*)/h = F(x, v)` with `v = (x - x*)/h`. Backward Euler is one stage of
//! h = dt from the old state; SDIRK2 (Alexander 1977, second order, L-stable, stiffly accurate) two
//! stages of `h = (1 - 1/sqrt 2) dt`.
//!
//! A stage begins with the acceleration that a straight line through those of the last two stages gives. Where the
//! motion is smooth that is so close that one iteration is enough.

use super::{Drive, FOLDED};
use crate::lane::{Lanewise, Mask, Real};
use crate::linear::{Ascent, Block, Descent, Front};
use crate::rod::{Motion, Rod, Shape, linearise};
use crate::vec2::Vec2;

/// Which implicit method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// First order, the thesis' own.
    BackwardEuler,
    /// Second order, L-stable.
    Sdirk2,
}

/// Newton iterations before a stage counts as failed.
const ITERATIONS: usize = 12;
/// A stage has converged when what remains is below this share of the rod's length. Convergence is quadratic: after a
/// correction d (the sum over all coordinates) no more than about d^2 over the length of an edge.
const TOLERANCE: f64 = 1e-10;
/// 1 - 1/sqrt(2).
const GAMMA: f64 = 0.292_893_218_813_452_4;

/// Memory for the steps of one block of rods.
#[derive(Clone, Debug, Default)]
pub struct Workspace<R> {
    /// Positions and velocities before the step, and those that the second stage starts from.
    start: Vec<[Vec2<R>; 2]>,
    second: Vec<[Vec2<R>; 2]>,
    /// Of each node but the first, what elimination leaves.
    rows: Vec<Row<R>>,
    /// For torques that depend on the state: corrections at constant torque, by the torque, and its gradient.
    at_torque: Vec<Vec2<R>>,
    by_torque: Vec<Vec2<R>>,
    gradient: Vec<Vec2<R>>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Row<R> {
    right: [Block<R>; 2],
    y: Vec2<R>,
}

impl<R: Real> Workspace<R> {
    /// Memory for rods of `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        Workspace {
            start: vec![[Vec2::zero(); 2]; nodes],
            second: vec![[Vec2::zero(); 2]; nodes],
            rows: vec![Row::default(); nodes - 1],
            at_torque: vec![Vec2::zero(); nodes],
            by_torque: vec![Vec2::zero(); nodes],
            gradient: vec![Vec2::zero(); nodes],
        }
    }

    /// Reads the motion of one lane before the last step, without what the stepper knew of its acceleration.
    pub fn read_start(&self, lane: usize, motion: &mut Motion<f64>) {
        for (i, [x, v]) in self.start.iter().enumerate() {
            (motion.x[i], motion.v[i]) = (x.lane(lane), v.lane(lane));
        }
        motion.a.fill(Vec2::zero());
        motion.a_before.fill(Vec2::zero());
    }
}

/// One step of `dt` \[s\]; returns where Newton's method converged. Elsewhere the motion is not valid.
#[inline(always)]
pub fn step<R: Real, D: Drive<R>>(
    method: Method,
    rod: &Rod<R>,
    motion: &mut Motion<R>,
    drive: &D,
    dt: f64,
    work: &mut Workspace<R>,
) -> R::Mask {
    for i in 0..rod.nodes() {
        work.start[i] = [motion.x[i], motion.v[i]];
    }
    // Each stage's h, and its distance from the last stage over that between the last two.
    let stages: &[(f64, f64)] = match method {
        Method::BackwardEuler => &[(dt, 1.0)],
        Method::Sdirk2 => {
            &[(GAMMA * dt, GAMMA / (1.0 - GAMMA)), (GAMMA * dt, (1.0 - GAMMA) / GAMMA)]
        }
    };
    let mut sound = R::Mask::splat(true);
    // (One call in a loop, so that the Newton iteration is compiled once.)
    for (i, &(h, ahead)) in stages.iter().enumerate() {
        if i == 1 {
            start_second(work, motion);
        }
        sound = sound.and(stage(rod, motion, drive, h, ahead, i == 1, work));
    }
    sound
}

/// The second stage starts from `x0 + (1 - gamma) dt x1'`, where `x1' = (x1 - x0)/(gamma dt)`.
#[inline(always)]
fn start_second<R: Real>(work: &mut Workspace<R>, first: &Motion<R>) {
    let ratio = R::splat((1.0 - GAMMA) / GAMMA);
    for (i, [x0, v0]) in work.start.iter().enumerate() {
        let (x1, v1) = (first.x[i], first.v[i]);
        work.second[i] = [*x0 + (x1 - *x0).scale(ratio), *v0 + (v1 - *v0).scale(ratio)];
    }
}

/// Solves one stage of size `h` from `work.start` or `work.second`. The accelerations of the last two stages give the first guess,
/// `ahead` times their distance after the last; that of this stage becomes `motion.a`.
#[inline(always)]
fn stage<R: Real, D: Drive<R>>(
    rod: &Rod<R>,
    motion: &mut Motion<R>,
    drive: &D,
    h: f64,
    ahead: f64,
    second: bool,
    work: &mut Workspace<R>,
) -> R::Mask {
    let nodes = rod.nodes();
    // A stiff law of the state throws the torque about, and the equations have several solutions: no guess
    // ahead of what was.
    let ahead = if D::FEEDBACK { 0.0 } else { ahead };
    let (step, rate, ahead) = (R::splat(h), R::splat(1.0 / h), R::splat(ahead));
    let small = {
        let length = (nodes - 1) as f64;
        rod.rest[0] * R::splat((TOLERANCE * length).sqrt())
    };
    let Workspace { start, rows, at_torque, by_torque, gradient, .. } = work;
    let origin: &[_] = if second { &work.second } else { start };
    let Motion { x, v, a, a_before } = motion;
    std::mem::swap(a, a_before);
    for i in 1..nodes {
        let [x0, v0] = origin[i];
        let guess = a_before[i] + (a_before[i] - a[i]).scale(ahead);
        v[i] = v0 + guess.scale(step);
        x[i] = x0 + v[i].scale(step);
    }
    let mut done = R::Mask::splat(false);
    for _ in 0..ITERATIONS {
        let torque = drive.torque(x, v);
        let shape = reduce(rod, x, v, Some(origin), torque, rate, rows);
        if D::FEEDBACK {
            // The torque law adds a matrix of rank one: Sherman and Morrison's formula.
            substitute(rows, at_torque);
            reduce(rod, x, v, None, torque, rate, rows);
            substitute(rows, by_torque);
            drive.gradient(x, v, rate, gradient);
            let (mut on_torque, mut on_base) = (R::zero(), R::one());
            for i in 1..nodes {
                on_torque += gradient[i].dot(at_torque[i]);
                on_base -= gradient[i].dot(by_torque[i]);
            }
            let share = on_torque / on_base;
            for i in 1..nodes {
                let y = at_torque[i] + by_torque[i].scale(share);
                rows[i - 1] = Row { y, ..Row::default() };
            }
        }
        let mut ascent = Ascent::default();
        let mut largest = R::zero();
        for i in (1..nodes).rev() {
            let correction = ascent.pass(&rows[i - 1].right, rows[i - 1].y);
            let [x0, v0] = origin[i];
            // A converged lane stays frozen while its neighbours iterate. (`max` would drop a NaN.)
            x[i] = Vec2::select(done, x[i], x[i] + correction);
            largest += correction.x.abs() + correction.y.abs();
            v[i] = (x[i] - x0).scale(rate);
            a[i] = (v[i] - v0).scale(rate);
        }
        done = done.or(largest.lt(small).and(R::splat(FOLDED).lt(shape.openness)));
        if done.all() {
            break;
        }
    }
    done
}

/// One sweep down the rod: linearises about (x, v) and eliminates node by node. The right-hand side is the force
/// that a stage which starts from `origin` lacks; without one, the force of a unit torque at the base.
#[inline(always)]
fn reduce<R: Real>(
    rod: &Rod<R>,
    x: &[Vec2<R>],
    v: &[Vec2<R>],
    origin: Option<&[[Vec2<R>; 2]]>,
    torque: R,
    rate: R,
    rows: &mut [Row<R>],
) -> Shape<R> {
    let (mut front, mut descent) = (Front::default(), Descent::default());
    let mut sweep = linearise(rod, x, v, torque, rate);
    // The first node is pinned.
    sweep.next();
    for i in 1..rod.nodes() {
        let Some((force, mut hook)) = sweep.next() else { break };
        let inertia = rod.mass[i] * rate;
        hook.diagonal[0][0] += inertia * rate;
        hook.diagonal[1][1] += inertia * rate;
        let right = match origin {
            Some(origin) => force - (v[i] - origin[i][1]).scale(inertia),
            None if i == 1 => sweep.shape.base,
            None => Vec2::zero(),
        };
        let hook = front.eliminate(&hook);
        rows[i - 1] = Row { right: hook.right, y: descent.pass(&hook, right) };
    }
    sweep.shape
}

/// The way back up, to the solution at every node but the first.
#[inline(always)]
fn substitute<R: Real>(rows: &[Row<R>], solution: &mut [Vec2<R>]) {
    let mut ascent = Ascent::default();
    for (i, row) in rows.iter().enumerate().rev() {
        solution[i + 1] = ascent.pass(&row.right, row.y);
    }
}
