//! Implicit time steps of the fin, by Newton's method in lanes.
//!
//! Added mass is part of the implicit balance (the water that moves with the tail is fifteen times
//! heavier than the tail itself: an explicit coupling diverges). A step that does not converge is cut into
//! halves, quarters, ... of backward Euler; only when the smallest parts fail is the lane reported.

use super::plant::{Instant, Loads, Plant, Scheme};
use crate::lane::{Lanewise, Mask, Real};
use crate::linear::Banded;
use crate::vec2::Vec2;

/// Newton iterations before a step is given up.
const ITERATIONS: usize = 12;
/// Newton has converged when the coordinates together move by less than this \[m\]. Convergence is quadratic: the
/// iterate after such a move is exact to rounding.
const TOLERANCE: f64 = 1e-7;
/// A failed step is tried in 2, 4, ... 2^HALVINGS parts.
const HALVINGS: u32 = 6;

/// Memory that a step needs, kept so that it allocates nothing.
#[derive(Clone, Debug)]
pub(super) struct Workspace<R> {
    star: Instant<R>,
    next: Instant<R>,
    /// Before a step that is taken in parts.
    start: Instant<R>,
    residual: Vec<Vec2<R>>,
    pub(super) momentum: Vec<Vec2<R>>,
    matrix: Banded<R>,
    right: Vec<R>,
    border: Vec<R>,
    border_row: Vec<R>,
}

impl<R: Real> Workspace<R> {
    pub(super) fn new(nodes: usize) -> Self {
        let numbers = || vec![R::zero(); 2 * nodes];
        Workspace {
            star: Instant::new(nodes),
            next: Instant::new(nodes),
            start: Instant::new(nodes),
            residual: vec![Vec2::zero(); nodes],
            momentum: vec![Vec2::zero(); nodes],
            matrix: Banded::new(nodes),
            right: numbers(),
            border: numbers(),
            border_row: numbers(),
        }
    }
}

impl<R: Real> Plant<R> {
    /// One physics step in which the driven edge comes to `pitch` \[rad\]. Returns the lanes that took it;
    /// the others keep their state.
    #[inline(always)]
    pub fn step(&mut self, pitch: R) -> R::Mask {
        let dt = self.design.physics_dt;
        let bdf2 = match self.design.scheme {
            Scheme::BackwardEuler => R::zero(),
            Scheme::Bdf2 => self.history,
        };
        let mut work = std::mem::replace(&mut self.work, Workspace::new(0));
        let (taken, loads) = self.attempt(&mut work, pitch, dt, bdf2);
        self.accept(taken, &mut work, pitch, &loads);
        self.work = work;
        if taken.all() { taken } else { taken.or(self.step_in_parts(taken.not(), pitch)) }
    }

    /// Solves for the end of a step of `dt` seconds into `work.next`; BDF2 where `bdf2` is 1, backward
    /// Euler where it is 0. Returns where Newton converged, and the loads.
    #[inline(always)]
    fn attempt(&self, work: &mut Workspace<R>, pitch: R, dt: f64, bdf2: R) -> (R::Mask, Loads<R>) {
        let nodes = self.now.x.len();
        let third = bdf2 * R::splat(1.0 / 3.0);
        let newer = R::one() + third;
        let h = R::splat(dt) * (R::one() - third);
        let rate = R::one() / h;
        let blend = |new: Vec2<R>, old: Vec2<R>| new.scale(newer) - old.scale(third);
        for i in 0..nodes {
            work.star.x[i] = blend(self.now.x[i], self.before.x[i]);
            work.star.v[i] = blend(self.now.v[i], self.before.v[i]);
            work.star.p[i] = blend(self.now.p[i], self.before.p[i]);
            work.next.x[i] = self.now.x[i] + self.now.v[i].scale(R::splat(dt));
        }
        let (pivot, driven) = (self.design.geometry.pivot, self.design.geometry.pivot + 1);
        let arm = R::splat(self.design.geometry.edge_length);
        let arm = Vec2::new(arm * pitch.cos(), arm * pitch.sin());
        if !self.design.free_swimming {
            work.next.x[pivot] = self.now.x[pivot];
        }
        work.next.x[pivot].y = self.now.x[pivot].y;
        work.next.x[driven] = work.next.x[pivot] + arm;

        let tolerance = R::splat(TOLERANCE);
        let mut active = R::Mask::splat(true);
        let mut converged = R::Mask::splat(false);
        for _ in 0..ITERATIONS {
            self.velocities(work, rate);
            let moves = self.newton_update(work, rate, active);
            let small = moves.lt(tolerance).and(active);
            converged = converged.or(small);
            active = active.and(small.not()).and(moves.is_finite());
            if !active.any() {
                break;
            }
        }
        self.velocities(work, rate);
        let mut loads = self.balance(&work.star, rate, &mut work.next, &mut work.residual);
        // The residual at the two prescribed nodes is the force of the drive.
        let (hold, push) = (work.residual[pivot], work.residual[driven]);
        loads.mount_thrust = hold.x + push.x;
        loads.torque = arm.cross(push);
        loads.power = push.dot(work.next.v[driven] - work.next.v[pivot]);
        loads.positive_power = loads.power.max(R::zero());
        (converged.and(loads.power.is_finite()).and(loads.thrust.is_finite()), loads)
    }

    /// Velocities of the iterate, `(x - x*)/h`.
    #[inline(always)]
    fn velocities(&self, work: &mut Workspace<R>, rate: R) {
        for i in 0..work.next.x.len() {
            work.next.v[i] = (work.next.x[i] - work.star.x[i]).scale(rate);
        }
    }

    /// One Newton iteration on the lanes of `active`; returns the sum of all moves \[m\].
    #[inline(always)]
    fn newton_update(&self, work: &mut Workspace<R>, rate: R, active: R::Mask) -> R {
        let nodes = self.now.x.len();
        let (pivot, driven) = (self.design.geometry.pivot, self.design.geometry.pivot + 1);
        let Workspace { star, next, residual, matrix, right, border, border_row, .. } = work;
        self.linearise(star, rate, &next.x, &next.v, residual, matrix);
        for i in 0..nodes {
            right[2 * i] = -residual[i].x;
            right[2 * i + 1] = -residual[i].y;
        }
        let hull = if self.design.free_swimming {
            // Residual and derivative of the hull's own balance,
            // M_h dV/dt + drag(V) + (reactions)_x = 0, with V that of the pivot.
            let (speed, earlier) = (next.v[pivot].x, star.v[pivot].x);
            let inertia = self.hull_mass * rate;
            let drag = self.hull_drag * speed.abs();
            let balance =
                inertia * (speed - earlier) + drag * speed + residual[pivot].x + residual[driven].x;
            let mut slope = (inertia + drag + drag) * rate;
            for j in 0..2 * nodes {
                border[j] = matrix.get(j, 2 * pivot) + matrix.get(j, 2 * driven);
                border_row[j] = matrix.get(2 * pivot, j) + matrix.get(2 * driven, j);
            }
            slope += border_row[2 * pivot] + border_row[2 * driven];
            Some((balance, slope))
        } else {
            None
        };
        for node in [pivot, driven] {
            matrix.hold(node);
            for row in [2 * node, 2 * node + 1] {
                right[row] = R::zero();
                border[row] = R::zero();
            }
        }
        matrix.factor();
        matrix.solve(right);
        if let Some((balance, slope)) = hull {
            // Bordered system: eliminate the free coordinates, then substitute back.
            matrix.solve(border);
            let (mut above, mut below) = (-balance, slope);
            for j in 0..2 * nodes {
                above -= border_row[j] * right[j];
                below -= border_row[j] * border[j];
            }
            let surge = above / below;
            for j in 0..2 * nodes {
                right[j] -= border[j] * surge;
            }
            right[2 * pivot] = surge;
            right[2 * driven] = surge;
        }
        let mut moves = R::zero();
        for i in 0..nodes {
            let x = next.x[i];
            let moved = Vec2::new(x.x + right[2 * i], x.y + right[2 * i + 1]);
            next.x[i] = Vec2::select(active, moved, x);
            // A sum, because a maximum would drop a NaN.
            moves += right[2 * i].abs() + right[2 * i + 1].abs();
        }
        moves
    }

    /// Makes `work.next` the present, where the mask is set.
    #[inline(always)]
    fn accept(&mut self, mask: R::Mask, work: &mut Workspace<R>, pitch: R, loads: &Loads<R>) {
        self.before.take(mask, &self.now);
        self.now.take(mask, &work.next);
        self.history = R::select(mask, R::one(), self.history);
        self.pitch = R::select(mask, pitch, self.pitch);
        self.loads.take(mask, loads);
    }

    /// Takes the step again where it has not been taken, in 2, 4, ... parts of backward Euler with the pitch
    /// interpolated; the loads are means over the parts. Returns where that went well; elsewhere the fin
    /// keeps its state.
    #[cold]
    #[inline(never)]
    fn step_in_parts(&mut self, failed: R::Mask, pitch: R) -> R::Mask {
        let mut work = std::mem::replace(&mut self.work, Workspace::new(0));
        let from = self.pitch;
        work.start.copy_from(&self.now);
        let mut left = failed;
        for halving in 1..=HALVINGS {
            let parts = 1u32 << halving;
            let dt = self.design.physics_dt / f64::from(parts);
            let mut mean = Loads::default();
            let mut going = left;
            for part in 1..=parts {
                let share = R::splat(f64::from(part) / f64::from(parts));
                let target = from + share * (pitch - from);
                let (taken, loads) = self.attempt(&mut work, target, dt, R::zero());
                going = going.and(taken);
                if !going.any() {
                    break;
                }
                mean.add(R::splat(1.0 / f64::from(parts)), &loads);
                self.now.take(going, &work.next);
                self.pitch = R::select(going, target, self.pitch);
            }
            self.before.take(going, &work.start);
            self.history = R::select(going, R::one(), self.history);
            self.loads.take(going, &mean);
            left = left.and(going.not());
            self.now.take(left, &work.start);
            self.pitch = R::select(left, from, self.pitch);
            if !left.any() {
                break;
            }
        }
        self.work = work;
        failed.and(left.not())
    }
}
