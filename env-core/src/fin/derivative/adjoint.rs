//! The way back: from the gradient by a fin's motion after some steps and by their loads to those by the motion before
//! them, by the pitches and by its material. The maps of `tangent`, transposed, in the opposite order along the tape.

use super::linear::{Linear, Maps};
use super::material::{Effect, effects, momentum};
use super::tangent::{look, stage};
use crate::error::Result;
use crate::fin::Body;
use crate::fin::motion::{Instant, Loads};
use crate::isa::{ForLanes, Isa, with_lanes};
use crate::lane::{DIRECTIONS, Dual, Kernel, Lanewise, Real};
use crate::linear::{multiply, solve};
use crate::solver::{Origin, Stage, Tape};
use crate::vec2::Vec2;

/// Gradients of one number on their way back along a tape.
pub(super) struct Pulled {
    /// By the motion and by the step before; empty for schemes that do not look back.
    pub now: Instant<f64>,
    pub before: Instant<f64>,
    /// By the pitch before the first step, and after each.
    pub pitches: Vec<f64>,
    /// By the sum of the loads over the steps.
    pub loads: Loads<f64>,
    /// By the directions of each of the materials.
    pub parameters: Vec<[f64; DIRECTIONS]>,
}

/// Takes gradients back through the steps of a tape that `start` took. Each of `materials` is that fin, its directions
/// those of parameters.
///
/// # Errors
/// See `Isa::current`.
pub(super) fn pull_back(
    start: &Body<f64>,
    tape: &Tape,
    materials: &[Body<Dual>],
    pulled: &mut Pulled,
) -> Result<()> {
    let nodes = start.nodes();
    let memory = || Instant::new(nodes);
    let (step, zeros) = (pulled.pitches.len() - 1, || vec![Vec2::zero(); nodes]);
    let effects = materials.iter().map(|body| effects(body, tape)).collect();
    let run = Run {
        body: start,
        tape,
        materials,
        effects,
        pulled,
        step,
        start: memory(),
        origin: memory(),
        moved: zeros(),
        rest: zeros(),
    };
    with_lanes(Isa::current()?, run);
    Ok(())
}

struct Run<'a> {
    body: &'a Body<f64>,
    tape: &'a Tape,
    materials: &'a [Body<Dual>],
    effects: Vec<Vec<Effect>>,
    pulled: &'a mut Pulled,
    /// The step that is gone through.
    step: usize,
    /// Gradients by the motion at the start of the part, and by what the stage starts from.
    start: Instant<f64>,
    origin: Instant<f64>,
    /// By the moves of a stage, and by what its residual is beside them.
    moved: Vec<Vec2<f64>>,
    rest: Vec<Vec2<f64>>,
}

impl ForLanes for Run<'_> {
    type Output = ();
    fn make<R: Real>(self) {
        R::run(InLanes(Linear::<R>::new(self.body, true), self));
    }
}

/// All of it, for one number type.
struct InLanes<'a, R>(Linear<'a, R>, Run<'a>);

impl<R: Real> Kernel for InLanes<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let InLanes(mut linear, mut run) = self;
        run.steps(&mut linear);
        run.start(&mut linear);
    }
}

impl Run<'_> {
    /// All steps, the last one first.
    #[inline(always)]
    fn steps<R: Real>(&mut self, linear: &mut Linear<'_, R>) {
        let tape = self.tape;
        let count = tape.moves().len();
        for first in (0..count).step_by(R::LANES).rev() {
            linear.look(|lane| look(tape, (first + lane).min(count - 1)));
            for at in (first..count.min(first + R::LANES)).rev() {
                linear.pick(at - first);
                self.stage(&linear.maps, at);
            }
        }
    }

    /// The water's momentum at the start, and a step before, is none of the state's own numbers: its gradient goes to
    /// positions, velocities and the water.
    #[inline(always)]
    fn start<R: Real>(&mut self, linear: &mut Linear<'_, R>) {
        let Run { body, materials, pulled, moved, rest, .. } = self;
        let Body { now, past, .. } = body;
        let Pulled { now: by_now, before: by_before, parameters, .. } = &mut **pulled;
        let instants = [(now, by_now), (&past.before, by_before)];
        // As if it had been come to at the rate 1: from `x - v`, by a move `v`.
        linear.look(|lane| {
            let old = lane > 0 && !past.before.x.is_empty();
            let (at, _) = &instants[usize::from(old)];
            (&at.x, &at.v, 1.0)
        });
        for (lane, (at, pulled)) in instants.into_iter().enumerate() {
            if at.x.is_empty() {
                continue;
            }
            linear.pick(lane);
            moved.fill(Vec2::zero());
            rest.fill(Vec2::zero());
            multiply(linear.maps.momentum.of_move.hooks(), &pulled.p, moved);
            multiply(linear.maps.momentum.of_start.hooks(), &pulled.p, rest);
            for (material, sum) in materials.iter().zip(parameters.iter_mut()) {
                for (by, p) in pulled.p.iter().zip(momentum(material, &at.x, &at.v)) {
                    add_vector(sum, *by, &p);
                }
            }
            for i in 0..at.x.len() {
                pulled.x[i] += rest[i];
                pulled.v[i] += moved[i] - rest[i];
                pulled.p[i] = Vec2::zero();
            }
        }
    }

    /// See `Flow::stage`.
    #[inline(always)]
    fn stage(&mut self, maps: &Maps<f64>, at: usize) {
        let (stage, part_begins, step_begins) = stage(self.tape, at);
        let Run { body, tape, effects, pulled, step, origin, moved, rest, .. } = self;
        let nodes = body.nodes();
        let pivot = body.design.geometry.pivot;
        let driven = pivot + 1;
        let (x, v) = tape.moment(at);
        let push = tape.more(at)[0];
        let (arm, turn) = (x[driven] - x[pivot], v[driven] - v[pivot]);
        let rate = stage.rate;
        let Pulled { now, pitches, loads, parameters, .. } = &mut **pulled;
        rest.fill(Vec2::zero());
        moved.fill(Vec2::zero());
        origin.visit_mut(&mut |by: &mut f64| *by = 0.0);
        let mut by_pitch = 0.0;
        // (`rest` is first that by hold and push, as a vector of all nodes.)
        let (mut by_shed, mut by_resistance) = (0.0, 0.0);
        if stage.last {
            let weight = stage.dt / body.design.physics_dt;
            let mut own = Loads::default();
            own.add(weight, loads);
            let mut by_power = own.power;
            if push.dot(turn) > 0.0 {
                by_power += own.positive_power;
            }
            rest[pivot].x += own.mount_thrust;
            rest[driven].x += own.mount_thrust;
            rest[driven] += arm.perp().scale(own.torque) + turn.scale(by_power);
            by_pitch += own.torque * arm.perp().cross(push);
            now.v[driven] += push.scale(by_power);
            now.v[pivot] -= push.scale(by_power);
            by_shed = own.shed_thrust + own.thrust;
            by_resistance = own.resistive_thrust;
            for i in 0..nodes {
                now.p[i].x += rate * own.thrust;
                origin.p[i].x -= rate * own.thrust;
                origin.x[i] += maps.shed.of_start[i].scale(by_shed)
                    + maps.resistance.of_start[i].scale(by_resistance);
                moved[i] += maps.shed.of_move[i].scale(by_shed)
                    + maps.resistance.of_move[i].scale(by_resistance);
            }
            multiply(maps.residual.of_move.hooks(), rest, moved);
        }
        multiply(maps.momentum.of_start.hooks(), &now.p, &mut origin.x);
        multiply(maps.momentum.of_move.hooks(), &now.p, moved);
        for i in 0..nodes {
            moved[i] += now.x[i] + now.v[i].scale(rate);
            origin.x[i] += now.x[i];
        }
        solve(maps.eliminated.hooks(), moved);
        let mut by_hull = 0.0;
        if body.design.free_swimming {
            by_hull = (moved[pivot].x + moved[driven].x) * maps.inverse;
            for (moved, row) in moved.iter_mut().zip(&maps.surge) {
                *moved -= row.scale(by_hull);
            }
            origin.v[pivot].x += by_hull * body.hull_mass * rate;
        }
        for node in [pivot, driven] {
            origin.x[node] -= moved[node];
        }
        by_pitch += arm.perp().dot(moved[driven]);
        // From here on by `rest`.
        for i in 0..nodes {
            let held = i == pivot || i == driven;
            let mut by = if held { Vec2::new(by_hull, 0.0) } else { moved[i] };
            by -= rest[i];
            rest[i] = by;
            origin.p[i] += by.scale(rate);
            origin.v[i] += by.scale(rate * body.rod.mass[i]);
            moved[i] = -by;
        }
        multiply(maps.residual.of_start.hooks(), moved, &mut origin.x);
        for (effects, sum) in effects.iter().zip(parameters) {
            let effect = &effects[at];
            for i in 0..nodes {
                add_vector(sum, moved[i], &effect.residual[i]);
                add_vector(sum, now.p[i], &effect.momentum[i]);
            }
            add(sum, -by_hull, &effect.hull);
            add(sum, by_shed, &effect.shed);
            add(sum, by_resistance, &effect.resistance);
        }
        pitches[*step - 1] += (1.0 - stage.end) * by_pitch;
        pitches[*step] += stage.end * by_pitch;
        if step_begins {
            *step -= 1;
        }
        self.begin(stage, part_begins, step_begins);
    }

    /// From what a stage starts from to the start of the part, the last stage and the step before.
    #[inline(always)]
    fn begin(&mut self, stage: &Stage<f64>, part_begins: bool, step_begins: bool) {
        let Run { pulled, start, origin, .. } = self;
        let Pulled { now, before, .. } = &mut **pulled;
        let lists = [
            (&mut now.x, &mut before.x, &mut start.x, &origin.x),
            (&mut now.v, &mut before.v, &mut start.v, &origin.v),
            (&mut now.p, &mut before.p, &mut start.p, &origin.p),
        ];
        for (now, before, start, origin) in lists {
            for i in 0..now.len() {
                let by = origin[i];
                now[i] = Vec2::zero();
                if step_begins && !before.is_empty() {
                    start[i] += before[i];
                    before[i] = Vec2::zero();
                }
                match stage.origin {
                    Origin::Start | Origin::Slopes { .. } => start[i] += by,
                    Origin::Stage(weight) => {
                        start[i] += by.scale(1.0 - weight);
                        now[i] = by.scale(weight);
                    }
                    Origin::Before(weight) => {
                        start[i] += by.scale(1.0 + weight);
                        before[i] -= by.scale(weight);
                    }
                }
                if part_begins {
                    now[i] += start[i];
                    start[i] = Vec2::zero();
                }
            }
        }
    }
}

#[inline(always)]
fn add(sum: &mut [f64; DIRECTIONS], by: f64, change: &Dual) {
    for (sum, slope) in sum.iter_mut().zip(change.slopes) {
        *sum += by * slope;
    }
}

#[inline(always)]
fn add_vector(sum: &mut [f64; DIRECTIONS], by: Vec2<f64>, change: &Vec2<Dual>) {
    add(sum, by.x, &change.x);
    add(sum, by.y, &change.y);
}
