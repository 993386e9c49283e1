//! Derivatives of a fin's steps, carried along what a tape has: directions of its state, of the pitches and of its
//! material in lanes, eight to a `Flow`. At every stage one solution with Newton's matrix, where the iteration has ended.

use super::linear::{Linear, Maps};
use super::material::{Effect, effects};
use crate::directions::moves;
use crate::error::Result;
use crate::fin::motion::{Instant, Loads};
use crate::fin::{Body, Parameters};
use crate::isa::{ForLanes, Isa, with_lanes};
use crate::lane::{Dual, Kernel, Lanewise, Real};
use crate::linear::{multiply, multiply_row, solve};
use crate::solver::{Move, Stage, Tape, slopes, splat};
use crate::vec2::Vec2;

/// Eight directions of one fin. Values are those at the start, and stay.
pub(super) struct Carried<'a> {
    /// Material, motion, the step before, and the pitch at the start.
    pub body: &'a mut Body<Dual>,
    /// Pitch at the end of each step \[rad\].
    pub pitches: Vec<Dual>,
    /// Slopes of the sum of the loads over the steps.
    pub loads: Loads<Dual>,
}

/// Carries the slopes in all directions through the steps of a tape of `values`, whose own motion does not matter. The
/// number type is the fastest that this machine has; bits do not depend on it.
///
/// # Errors
/// See `Isa::current`.
pub(super) fn carry(values: &Body<f64>, tape: &Tape, carried: &mut [Carried<'_>]) -> Result<()> {
    struct Work<'a, 'b>(&'a Body<f64>, &'a Tape, &'a mut [Carried<'b>]);
    impl ForLanes for Work<'_, '_> {
        type Output = ();
        fn make<R: Real>(self) {
            let Work(values, tape, carried) = self;
            let linear = &mut Linear::new(values, false);
            let mut flows: Vec<Flow<R>> = carried.iter().map(|one| Flow::new(one, tape)).collect();
            R::run(Run { values, tape, linear, flows: &mut flows });
            for (flow, one) in flows.iter().zip(carried) {
                flow.write(one);
            }
        }
    }
    with_lanes(Isa::current()?, Work(values, tape, carried));
    Ok(())
}

struct Run<'a, 'b, R> {
    values: &'a Body<f64>,
    tape: &'a Tape,
    linear: &'a mut Linear<'b, R>,
    flows: &'a mut [Flow<R>],
}

impl<R: Real> Kernel for Run<'_, '_, R> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Run { values, tape, linear, flows } = self;
        let count = tape.moves().len();
        for first in (0..count).step_by(R::LANES) {
            linear.look(|lane| look(tape, (first + lane).min(count - 1)));
            for at in first..count.min(first + R::LANES) {
                linear.pick(at - first);
                for flow in flows.iter_mut() {
                    flow.stage(values, &linear.maps, tape, at);
                }
            }
        }
    }
}

/// A moment of a tape, and its rate.
#[inline(always)]
pub(super) fn look(tape: &Tape, at: usize) -> (&[Vec2<f64>], &[Vec2<f64>], f64) {
    let (x, v) = tape.moment(at);
    (x, v, stage(tape, at).0.rate)
}

/// How a moment was come to: the stage, and whether it is the first of a part, and of a step.
#[inline(always)]
pub(super) fn stage(tape: &Tape, at: usize) -> (&Stage<f64>, bool, bool) {
    let Move::Stage { stage, part_begins, step_begins } = &tape.moves()[at] else {
        unreachable!("fins are stepped implicitly")
    };
    (stage, *part_begins, *step_begins)
}

/// Eight directions on their way.
struct Flow<R> {
    now: Instant<R>,
    /// The motion a step before; empty for schemes that do not look back.
    before: Instant<R>,
    /// The motion at the start of the part, and what the stage starts from.
    start: Instant<R>,
    origin: Instant<R>,
    /// Pitches at the start and at the end of the step, and at the ends of those to come, the next one last.
    from: R,
    to: R,
    pitches: Vec<R>,
    loads: Loads<R>,
    effects: Vec<Effect>,
    /// Memory: what is solved for.
    moved: Vec<Vec2<R>>,
}

impl<R: Real> Flow<R> {
    fn new(from: &Carried<'_>, tape: &Tape) -> Self {
        let body = &from.body;
        let memory = || Instant::new(body.nodes());
        let (mut now, mut before) = (memory(), Instant::new(body.past.before.x.len()));
        now.pair(&body.now, &mut |to: &mut R, from| *to = slopes(from));
        before.pair(&body.past.before, &mut |to: &mut R, from| *to = slopes(from));
        let mut changes = false;
        let parameters: &Parameters<Dual> = &body.parameters;
        parameters.visit(&mut |x| changes |= moves(x));
        Flow {
            now,
            before,
            start: memory(),
            origin: memory(),
            from: R::zero(),
            to: slopes(&body.pitch),
            pitches: from.pitches.iter().rev().map(slopes).collect(),
            loads: Loads::default(),
            effects: if changes { effects(body, tape) } else { vec![] },
            moved: vec![Vec2::zero(); body.nodes()],
        }
    }

    fn write(&self, to: &mut Carried<'_>) {
        let write = &mut |to: &mut Dual, from: &R| {
            to.slopes = std::array::from_fn(|k| from.get(k));
        };
        to.body.now.pair(&self.now, write);
        to.body.past.before.pair(&self.before, write);
        to.body.pitch.pair(&self.to, write);
        to.loads.pair(&self.loads, write);
    }

    /// A stage.
    #[inline(always)]
    fn stage(&mut self, values: &Body<f64>, maps: &Maps<f64>, tape: &Tape, at: usize) {
        let (stage, part_begins, step_begins) = stage(tape, at);
        let nodes = values.nodes();
        let pivot = values.design.geometry.pivot;
        let driven = pivot + 1;
        if step_begins {
            self.from = self.to;
            self.to = self.pitches.pop().expect("there is one for every step");
        }
        let (x, v) = tape.moment(at);
        let push = tape.more(at)[0];
        let effect = self.effects.get(at);
        let Flow { now, before, start, origin, from, to, loads, moved, .. } = self;
        if part_begins {
            start.copy_from(now);
        }
        let source = stage.origin.splat();
        for i in 0..nodes {
            origin.x[i] = source.of(start.x[i], &now.x, &before.x, i);
            origin.v[i] = source.of(start.v[i], &now.v, &before.v, i);
            origin.p[i] = source.of(start.p[i], &now.p, &before.p, i);
        }
        if step_begins && !before.x.is_empty() {
            before.copy_from(start);
        }
        // The residual is `of_move u - rest`.
        let rate = R::splat(stage.rate);
        moved.fill(Vec2::zero());
        multiply(maps.residual.of_start.hooks(), &origin.x, moved);
        for i in 0..nodes {
            let lent = origin.v[i].scale(R::splat(values.rod.mass[i])) + origin.p[i];
            moved[i] = lent.scale(rate) - moved[i];
            if let Some(effect) = effect {
                moved[i] -= wide(&effect.residual[i]);
            }
        }
        let rest = [moved[pivot], moved[driven]];
        let pitch = *from + R::splat(stage.end) * (*to - *from);
        let arm = x[driven] - x[pivot];
        let arm_moves = splat::<R>(arm.perp()).scale(pitch);
        moved[pivot] = -origin.x[pivot];
        moved[driven] = arm_moves - origin.x[driven];
        solve(maps.eliminated.hooks(), moved);
        if values.design.free_swimming {
            let inertia = R::splat(values.hull_mass * stage.rate);
            let mut surge = rest[0].x + rest[1].x + inertia * origin.v[pivot].x;
            if let Some(effect) = effect {
                surge -= slopes(&effect.hull);
            }
            for (row, moved) in maps.hull.iter().zip(&*moved) {
                surge -= splat::<R>(*row).dot(*moved);
            }
            surge *= R::splat(maps.inverse);
            for (moved, column) in moved.iter_mut().zip(&maps.surge) {
                *moved += splat::<R>(*column).scale(surge);
            }
        }
        now.p.fill(Vec2::zero());
        multiply(maps.momentum.of_start.hooks(), &origin.x, &mut now.p);
        multiply(maps.momentum.of_move.hooks(), moved, &mut now.p);
        for i in 0..nodes {
            now.x[i] = origin.x[i] + moved[i];
            now.v[i] = moved[i].scale(rate);
            if let Some(effect) = effect {
                now.p[i] += wide(&effect.momentum[i]);
            }
        }
        if !stage.last {
            return;
        }
        let of_move = maps.residual.of_move.hooks();
        let hold_changes = multiply_row(of_move, pivot, moved) - rest[0];
        let push_changes = multiply_row(of_move, driven, moved) - rest[1];
        let turn = v[driven] - v[pivot];
        let power_changes =
            splat::<R>(turn).dot(push_changes) + splat::<R>(push).dot(now.v[driven] - now.v[pivot]);
        let mut own = Loads {
            mount_thrust: hold_changes.x + push_changes.x,
            torque: arm_moves.cross(splat(push)) + splat::<R>(arm).cross(push_changes),
            power: power_changes,
            ..Loads::default()
        };
        if push.dot(turn) > 0.0 {
            own.positive_power = power_changes;
        }
        for i in 0..nodes {
            let along = |row: &[Vec2<f64>], by: &[Vec2<R>]| splat::<R>(row[i]).dot(by[i]);
            own.resistive_thrust += along(&maps.resistance.of_start, &origin.x);
            own.resistive_thrust += along(&maps.resistance.of_move, moved);
            own.shed_thrust += along(&maps.shed.of_start, &origin.x);
            own.shed_thrust += along(&maps.shed.of_move, moved);
            own.thrust += rate * (now.p[i].x - origin.p[i].x);
        }
        if let Some(effect) = effect {
            own.resistive_thrust += slopes(&effect.resistance);
            own.shed_thrust += slopes(&effect.shed);
        }
        own.thrust += own.shed_thrust;
        loads.add(R::splat(stage.dt / values.design.physics_dt), &own);
    }
}

#[inline(always)]
fn wide<R: Real>(p: &Vec2<Dual>) -> Vec2<R> {
    Vec2::new(slopes(&p.x), slopes(&p.y))
}
