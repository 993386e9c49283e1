//! A physics step of the fin, as a system that the solver steps.
//!
//! Added mass is part of the implicit balance (the water that moves with the tail is fifteen times
//! heavier than the tail itself: an explicit coupling diverges).

use super::body::Body;
use super::motion::{Instant, Loads};
use super::residual::Elements;
use super::workspace::Workspace;
use crate::lane::{Lanewise, Mask, Real};
use crate::solver::{Move, Part, Past, Recorded, Solver, Stage, System, Tape, Told};
use crate::vec2::Vec2;
use crate::watch::Watch;

/// Newton has converged when the coordinates together move by less than this \[m\]. Convergence is quadratic: the
/// iterate after such a move is exact to rounding.
const TOLERANCE: f64 = 1e-7;

impl<R: Real> Body<R> {
    /// One physics step in which the driven edge comes to `pitch` \[rad\]. Returns the lanes that took it;
    /// the others keep their state.
    #[inline(always)]
    pub fn step(&mut self, pitch: R) -> R::Mask {
        self.step_unless(pitch, Watch::nobody())
    }

    /// The same, ending when who watches says so.
    #[inline(always)]
    pub fn step_unless(&mut self, pitch: R, watch: Watch<'_>) -> R::Mask {
        let (mut swing, solver, past) = self.swing(pitch);
        let taken = solver.step(&mut swing, past, R::Mask::splat(true), watch);
        let mean = swing.mean;
        self.swung(taken, pitch, &mean);
        taken
    }

    /// The step that comes to this pitch, and what takes it.
    #[inline(always)]
    fn swing(&mut self, to: R) -> (Swing<'_, R>, &mut Taker<R>, &mut Past<R, Instant<R>>) {
        let Body { design, rod, water, perimeter, hull_mass, hull_drag, .. } = self;
        let (hull_mass, hull_drag) = (*hull_mass, *hull_drag);
        let elements = Elements { design, rod, water, perimeter, hull_mass, hull_drag };
        let (now, work, loads) = (&mut self.now, &mut self.work, Loads::default());
        let (arm, from) = (Vec2::zero(), self.pitch);
        let swing = Swing { elements, now, work, from, to, arm, loads, mean: loads };
        (swing, &mut self.solver, &mut self.past)
    }

    /// Lanes have taken a step to a pitch.
    #[inline(always)]
    fn swung(&mut self, taken: R::Mask, pitch: R, mean: &Loads<R>) {
        self.loads.take(taken, mean);
        self.pitch = R::select(taken, pitch, self.pitch);
    }
}

impl Body<f64> {
    /// `step_unless`, to the same bits, written down on a tape. Beside positions and velocities it has of every moment
    /// the force on the driven node, and the velocities that the stage started from.
    pub(super) fn record(&mut self, pitch: f64, watch: Watch<'_>, tape: &mut Tape) -> bool {
        tape.begin_step();
        let (system, solver, past) = self.swing(pitch);
        let mut recorded = Recorded { system, tape };
        let taken = solver.step(&mut recorded, past, true, watch);
        let mean = recorded.system.mean;
        self.swung(taken, pitch, &mean);
        taken
    }
}

type Taker<R> = Solver<<R as Real>::Mask, Instant<R>>;

impl Told for Swing<'_, f64> {
    fn tell(&self, way: Move, origin: &Instant<f64>, tape: &mut Tape) {
        let Instant { x, v, .. } = &*self.now;
        let driven = self.elements.design.geometry.pivot + 1;
        let push = self.work.residual[driven];
        tape.push(way, x, v.iter().copied(), &[&[push], &origin.v[..]]);
    }
}

/// A fin whose driven edge swings from one pitch to another in a step.
struct Swing<'a, R> {
    elements: Elements<'a, R>,
    now: &'a mut Instant<R>,
    work: &'a mut Workspace<R>,
    /// Pitch at the start and at the end of the step \[rad\].
    from: R,
    to: R,
    /// The driven edge at the end of the stage \[m\].
    arm: Vec2<R>,
    /// Loads at the end of the stage, and their mean over the parts of the step that were taken.
    loads: Loads<R>,
    mean: Loads<R>,
}

impl<R: Real> Swing<'_, R> {
    /// Velocities of the iterate, `(x - x*)/h`.
    #[inline(always)]
    fn velocities(&mut self, rate: R, origin: &Instant<R>) {
        for i in 0..self.now.x.len() {
            self.now.v[i] = (self.now.x[i] - origin.x[i]).scale(rate);
        }
    }
}

impl<R: Real> System<R> for Swing<'_, R> {
    type State = Instant<R>;

    #[inline(always)]
    fn state(&mut self) -> &mut Instant<R> {
        self.now
    }

    #[inline(always)]
    fn predict(
        &mut self,
        stage: &Stage<R>,
        start: &Instant<R>,
        before: &Instant<R>,
        origin: &mut Instant<R>,
    ) {
        let Instant { x, v, p } = &mut *self.now;
        for i in 0..x.len() {
            origin.x[i] = stage.origin.of(start.x[i], x, &before.x, i);
            origin.v[i] = stage.origin.of(start.v[i], v, &before.v, i);
            origin.p[i] = stage.origin.of(start.p[i], p, &before.p, i);
            x[i] = start.x[i] + start.v[i].scale(stage.elapsed);
        }
        let mut pitch = self.to;
        if stage.end < 1.0 {
            pitch = self.from + R::splat(stage.end) * (self.to - self.from);
        }
        let design = self.elements.design;
        let (pivot, edge) = (design.geometry.pivot, R::splat(design.geometry.edge_length));
        self.arm = Vec2::new(edge * pitch.cos(), edge * pitch.sin());
        if !design.free_swimming {
            x[pivot] = start.x[pivot];
        }
        x[pivot].y = start.x[pivot].y;
        x[pivot + 1] = x[pivot] + self.arm;
    }

    #[inline(always)]
    fn correct(&mut self, stage: &Stage<R>, origin: &Instant<R>, active: R::Mask) -> (R, R::Mask) {
        let rate = stage.rate;
        self.velocities(rate, origin);
        let Swing { elements, now, work, .. } = self;
        let Workspace { residual, matrix, right, border, .. } = &mut **work;
        elements.linearize(origin, rate, &now.x, &now.v, residual, matrix);
        let nodes = now.x.len();
        for i in 0..nodes {
            right[i] = -residual[i];
        }
        let pivot = elements.design.geometry.pivot;
        let driven = pivot + 1;
        let (mut balance, mut slope) = (R::zero(), R::one());
        if elements.design.free_swimming {
            // Residual and derivative of the hull's own balance,
            // M_h dV/dt + drag(V) + (reactions)_x = 0, with V that of the pivot.
            let (speed, earlier) = (now.v[pivot].x, origin.v[pivot].x);
            let inertia = elements.hull_mass * rate;
            let drag = elements.hull_drag * speed.abs();
            balance =
                inertia * (speed - earlier) + drag * speed + residual[pivot].x + residual[driven].x;
            slope = (inertia + drag + drag) * rate;
            let (p, d) = (2 * pivot, 2 * driven);
            for j in 0..nodes {
                let column = |row: usize| matrix.get(row, p) + matrix.get(row, d);
                let row = |column: usize| matrix.get(p, column) + matrix.get(d, column);
                border.column[j] = Vec2::new(column(2 * j), column(2 * j + 1));
                border.row[j] = Vec2::new(row(2 * j), row(2 * j + 1));
            }
            slope += border.row[pivot].x + border.row[driven].x;
        }
        for node in [pivot, driven] {
            matrix.hold(node);
            right[node] = Vec2::zero();
            border.column[node] = Vec2::zero();
        }
        matrix.factor();
        matrix.solve(right);
        if elements.design.free_swimming {
            matrix.solve(&mut border.column);
            let surge = border.close(slope, -balance, right);
            right[pivot].x = surge;
            right[driven].x = surge;
        }
        let mut moved = R::zero();
        for i in 0..nodes {
            now.x[i] = Vec2::select(active, now.x[i] + right[i], now.x[i]);
            // A sum, because a maximum would drop a NaN.
            moved += right[i].x.abs() + right[i].y.abs();
        }
        (moved, R::Mask::splat(true))
    }

    #[inline(always)]
    fn tolerance(&self) -> R {
        R::splat(TOLERANCE * self.work.sharpness)
    }

    #[inline(always)]
    fn complete(&mut self, stage: &Stage<R>, origin: &Instant<R>) -> R::Mask {
        self.velocities(stage.rate, origin);
        let residual = &mut self.work.residual;
        let mut loads = self.elements.balance(origin, stage.rate, self.now, residual);
        // The residual at the two prescribed nodes is the force of the drive.
        let pivot = self.elements.design.geometry.pivot;
        let (hold, push) = (residual[pivot], residual[pivot + 1]);
        loads.mount_thrust = hold.x + push.x;
        loads.torque = self.arm.cross(push);
        loads.power = push.dot(self.now.v[pivot + 1] - self.now.v[pivot]);
        loads.positive_power = loads.power.max(R::zero());
        self.loads = loads;
        loads.power.is_finite().and(loads.thrust.is_finite())
    }

    #[inline(always)]
    fn accept(&mut self, part: &Part<R::Mask>) {
        let (lanes, share) = (part.lanes, R::splat(part.size));
        if part.from == 0.0 {
            self.mean.pair(&self.loads, &mut |mean, load| {
                *mean = R::select(lanes, share * *load, *mean);
            });
        } else {
            self.mean.pair(&self.loads, &mut |mean, load| {
                *mean = R::select(lanes, *mean + share * *load, *mean);
            });
        }
    }
}
