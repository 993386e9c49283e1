//! A rod whose first node is pinned and whose first edge bears a torque, as a system of implicit steps.
//!
//! Every stage solves `M (v - v*)/h = F(x, v)` with `v = (x - x*)/h`. It begins with the acceleration that a straight
//! line through those of the last two stages gives. Where the motion is smooth that is so close that one iteration is
//! enough.

use super::tape::{Move, Tape, Told};
use super::{Drive, FOLDED, Origin, Stage, System};
use crate::lane::{Mask, Real};
use crate::linear::{Ascent, Block, Border, Descent, Front};
use crate::rod::{Motion, Rod, Shape, linearize};
use crate::vec2::Vec2;
use crate::zeros;

/// A stage has converged when what remains is below this share of the rod's length. Convergence is quadratic: after a
/// correction d (the sum over all coordinates) no more than about d^2 over the length of an edge.
const TOLERANCE: f64 = 1e-10;

/// Memory for the elimination of one block of rods.
#[derive(Clone, Debug)]
pub struct Elimination<R> {
    /// Of each node but the first, what elimination leaves.
    rows: Vec<Row<R>>,
    /// For torques that depend on the state: corrections at constant torque, and the border that the torque is.
    at_torque: Vec<Vec2<R>>,
    border: Border<R>,
    /// Of the start of a step and of its stages: velocities, and accelerations.
    slopes: Vec<[Vec<Vec2<R>>; 2]>,
    /// By how much the acceleration of the second node jumps at the start of a step, with the torque.
    jump: Vec2<R>,
    /// Multiplies the tolerance.
    pub sharpness: f64,
}

#[derive(Clone, Copy, Debug)]
struct Row<R> {
    right: [Block<R>; 2],
    y: Vec2<R>,
}

zeros!(Row: right, y);

impl<R: Real> Elimination<R> {
    /// Memory for rods of `nodes` nodes and for schemes that keep `slopes` slopes.
    pub fn new(nodes: usize, slopes: usize) -> Self {
        let zeros = || vec![Vec2::zero(); nodes];
        Elimination {
            rows: vec![Row::default(); nodes - 1],
            at_torque: vec![Vec2::zero(); nodes],
            border: Border::new(nodes),
            slopes: (0..slopes).map(|_| [zeros(), zeros()]).collect(),
            jump: Vec2::zero(),
            sharpness: 1.0,
        }
    }
}

/// Rods in motion under a drive.
pub struct Pinned<'a, R, D> {
    /// Geometry and material.
    pub rod: &'a Rod<R>,
    /// Positions and velocities, and the accelerations of the last two stages.
    pub motion: &'a mut Motion<R>,
    /// The torque at the base.
    pub drive: &'a D,
    /// Memory.
    pub work: &'a mut Elimination<R>,
}

impl<R: Real, D: Drive<R>> System<R> for Pinned<'_, R, D> {
    type State = Motion<R>;

    #[inline(always)]
    fn state(&mut self) -> &mut Motion<R> {
        self.motion
    }

    #[inline(always)]
    fn predict(
        &mut self,
        stage: &Stage<R>,
        start: &Motion<R>,
        before: &Motion<R>,
        origin: &mut Motion<R>,
    ) {
        // A stiff law of the state throws the torque about, and the equations have several solutions: no guess
        // ahead of what was.
        let ahead = if D::FEEDBACK { R::zero() } else { stage.ahead };
        if let Origin::Slopes { from, guess } = stage.origin {
            self.predict_by_slopes(stage, ahead, from, guess, start, origin);
            return;
        }
        let Motion { x, v, a, a_before } = &mut *self.motion;
        std::mem::swap(a, a_before);
        for i in 1..x.len() {
            let x0 = stage.origin.of(start.x[i], x, &before.x, i);
            let v0 = stage.origin.of(start.v[i], v, &before.v, i);
            (origin.x[i], origin.v[i]) = (x0, v0);
            let guess = a_before[i] + (a_before[i] - a[i]).scale(ahead);
            v[i] = v0 + guess.scale(stage.h);
            x[i] = x0 + v[i].scale(stage.h);
        }
    }

    #[inline(always)]
    fn correct(&mut self, stage: &Stage<R>, origin: &Motion<R>, active: R::Mask) -> (R, R::Mask) {
        let (nodes, rate) = (self.rod.nodes(), stage.rate);
        let Elimination { rows, at_torque, border, .. } = &mut *self.work;
        let Motion { x, v, a, .. } = &mut *self.motion;
        let torque = self.drive.torque(x, v);
        let shape = reduce(self.rod, x, v, Some(origin), torque, rate, rows);
        if D::FEEDBACK {
            // A change z of the torque adds the column that a unit of it is, taken negative, and the row
            // `gradient . x = z`.
            substitute(rows, at_torque);
            reduce(self.rod, x, v, None, torque, rate, rows);
            substitute(rows, &mut border.column);
            self.drive.gradient(x, v, rate, &mut border.row);
            border.close(R::one(), R::zero(), at_torque);
            for i in 1..nodes {
                rows[i - 1] = Row { y: at_torque[i], ..Row::default() };
            }
        }
        let mut ascent = Ascent::default();
        let mut moved = R::zero();
        for i in (1..nodes).rev() {
            let correction = ascent.pass(&rows[i - 1].right, rows[i - 1].y);
            x[i] = Vec2::select(active, x[i] + correction, x[i]);
            // (`max` would drop a NaN.)
            moved += correction.x.abs() + correction.y.abs();
            v[i] = (x[i] - origin.x[i]).scale(rate);
            a[i] = (v[i] - origin.v[i]).scale(rate);
        }
        (moved, R::splat(FOLDED).lt(shape.openness))
    }

    #[inline(always)]
    fn complete(&mut self, stage: &Stage<R>, _origin: &Motion<R>) -> R::Mask {
        if let Origin::Slopes { from, .. } = stage.origin {
            if stage.last {
                // The torque may change from step to step: the place of the pinned node, which does not move, tells
                // what of the second node's acceleration is due to it.
                self.motion.a[0] = self.push();
            } else {
                self.keep(from.len());
            }
        }
        R::Mask::splat(true)
    }

    #[inline(always)]
    fn tolerance(&self) -> R {
        let length = (self.rod.nodes() - 1) as f64;
        self.rod.rest[0] * R::splat((TOLERANCE * length).sqrt() * self.work.sharpness)
    }
}

impl<D: Drive<f64>> Told for Pinned<'_, f64, D> {
    fn tell(&self, way: Move, _origin: &Motion<f64>, tape: &mut Tape) {
        tape.push(way, &self.motion.x, self.motion.v.iter().copied(), &[]);
    }
}

impl<R: Real, D: Drive<R>> Pinned<'_, R, D> {
    /// What the torque adds to the acceleration of the second node.
    #[inline(always)]
    fn push(&self) -> Vec2<R> {
        let Motion { x, v, .. } = &*self.motion;
        let e = x[1] - x[0];
        let torque = self.drive.torque(x, v);
        e.perp().scale(torque * self.rod.inverse_mass[1] / e.dot(e))
    }

    /// Keeps the slope at the present state.
    #[inline(always)]
    fn keep(&mut self, place: usize) {
        let [v, a] = &mut self.work.slopes[place];
        v.copy_from_slice(&self.motion.v);
        a.copy_from_slice(&self.motion.a);
    }

    /// `predict` for stages that start from slopes.
    #[inline(always)]
    fn predict_by_slopes(
        &mut self,
        stage: &Stage<R>,
        ahead: R,
        from: &[f64],
        guess: &[f64],
        start: &Motion<R>,
        origin: &mut Motion<R>,
    ) {
        let first = from.len() == 1;
        if first {
            let jump = self.push() - self.motion.a[0];
            self.work.jump = jump;
            self.keep(0);
            self.work.slopes[0][1][1] += jump;
        }
        let Elimination { slopes, jump, .. } = &*self.work;
        // Where the torque jumps, the slope at the start is that of the second node torn off, which says nothing of
        // where the rod goes: a guess by what was, and later by the velocities of the first stage.
        let jumps = R::zero().lt(jump.x.abs() + jump.y.abs());
        let along = R::splat(stage.end_of_part / stage.first_end);
        let Motion { x, v, a, a_before } = &mut *self.motion;
        std::mem::swap(a, a_before);
        for i in 1..x.len() {
            let (mut x0, mut v0) = (start.x[i], start.v[i]);
            let mut slope = Vec2::zero();
            for (j, (&from, &guess)) in from.iter().zip(guess).enumerate() {
                let weight = R::splat(from) * stage.dt;
                let [rate, acceleration] = &slopes[j];
                x0 += rate[i].scale(weight);
                v0 += acceleration[i].scale(weight);
                slope += acceleration[i].scale(R::splat(guess));
            }
            let steady = if first {
                let weight = R::splat(from[0]) * stage.dt;
                start.v[i] + a_before[i].scale(weight + stage.h)
            } else {
                start.v[i] + (slopes[1][0][i] - start.v[i]).scale(along)
            };
            if first {
                slope += (slope - a[i]).scale(ahead);
            }
            (origin.x[i], origin.v[i]) = (x0, v0);
            v[i] = Vec2::select(jumps, steady, v0 + slope.scale(stage.h));
            x[i] = x0 + v[i].scale(stage.h);
        }
    }
}

/// One sweep down the rod: linearizes about (x, v) and eliminates node by node. The right-hand side is the force
/// that a stage which starts from `origin` lacks; without one, the force of a unit torque at the base.
#[inline(always)]
fn reduce<R: Real>(
    rod: &Rod<R>,
    x: &[Vec2<R>],
    v: &[Vec2<R>],
    origin: Option<&Motion<R>>,
    torque: R,
    rate: R,
    rows: &mut [Row<R>],
) -> Shape<R> {
    let (mut front, mut descent) = (Front::default(), Descent::default());
    let mut sweep = linearize(rod, x, v, torque, rate);
    // The first node is pinned.
    sweep.next();
    for i in 1..rod.nodes() {
        let Some((force, mut hook)) = sweep.next() else { break };
        let inertia = rod.mass[i] * rate;
        hook.diagonal[0][0] += inertia * rate;
        hook.diagonal[1][1] += inertia * rate;
        let right = match origin {
            Some(origin) => force - (v[i] - origin.v[i]).scale(inertia),
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
