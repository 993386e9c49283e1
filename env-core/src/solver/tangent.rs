//! Derivatives of steps of a pinned rod, carried along what a tape has: directions of its state, torque and material in
//! lanes, eight to a `Flow`.
//!
//! A step is a chain of linear maps and of forces. So a Verlet step applies the derivative of the forces. A stage of an
//! implicit scheme solves with Newton's matrix once, at the solution that the step itself has found: that is the
//! derivative of what the stage's equation defines (the theorem on implicit functions), however the iteration came to
//! it. By the rod's material forces are linear: their change is the force on a rod that has the changes as its
//! stiffnesses.

use super::moment::{Linear, Material, Moment, slopes, splat, turn, turned};
use super::{Move, Origin, Past, Stage, Tape};
use crate::error::Result;
use crate::isa::{ForLanes, Isa, with_lanes};
use crate::lane::{Dual, Kernel, Real};
use crate::rod::{Motion, Rod};
use crate::vec2::Vec2;
use std::marker::PhantomData;

/// A run of steps under one torque.
#[derive(Clone, Debug)]
pub struct Phase {
    /// What happened.
    pub tape: Tape,
    /// Torque \[N m\].
    pub torque: f64,
    /// The second node's position where it began and where it ended \[m\].
    pub hand: [Vec2<f64>; 2],
}

/// Eight directions of one rod. Values are those at the start, and stay.
pub struct Carried<'a> {
    /// Geometry and material, where any of the directions changes them.
    pub rod: Option<&'a Rod<Dual>>,
    /// Positions, velocities and accelerations.
    pub motion: &'a mut Motion<Dual>,
    /// The step before.
    pub past: &'a mut Past<Dual, Motion<Dual>>,
    /// Torque of each phase \[N m\].
    pub torques: Vec<Dual>,
}

/// Carries the slopes in all directions through the phases. The number type is the fastest that this machine has; bits do
/// not depend on it.
///
/// # Errors
/// See `Isa::current`.
pub fn carry(rod: &Rod<f64>, phases: &[Phase], carried: &mut [Carried<'_>]) -> Result<()> {
    with_lanes(Isa::current()?, Work { rod, phases, carried });
    Ok(())
}

struct Work<'a, 'b> {
    rod: &'a Rod<f64>,
    phases: &'a [Phase],
    carried: &'a mut [Carried<'b>],
}

impl ForLanes for Work<'_, '_> {
    type Output = ();
    fn make<R: Real>(self) {
        R::run(Run::<R>(self, PhantomData));
    }
}

/// All of it, for one number type.
struct Run<'a, 'b, R>(Work<'a, 'b>, PhantomData<R>);

impl<R: Real> Kernel for Run<'_, '_, R> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Work { rod, phases, carried } = self.0;
        let mut linear = Linear::<R>::new(rod, false);
        let implicit = phases.iter().any(|phase| phase.tape.implicit());
        let mut flows: Vec<Flow<R>> = Vec::with_capacity(carried.len());
        for one in &*carried {
            flows.push(Flow::new(one, implicit));
        }
        for (k, Phase { tape, torque, hand }) in phases.iter().enumerate() {
            for (flow, one) in flows.iter_mut().zip(&*carried) {
                flow.torque = slopes(&one.torques[k]);
                flow.push(rod, *torque, hand[0], 1.0);
            }
            let count = tape.moves().len();
            for first in (0..count).step_by(R::LANES) {
                linear.look(tape, first, *torque);
                for at in first..count.min(first + R::LANES) {
                    let moment = linear.moment(at - first);
                    match &tape.moves()[at] {
                        Move::Verlet(dt) => {
                            for flow in &mut flows {
                                flow.verlet(&moment, *dt);
                            }
                        }
                        Move::Stage { stage, part_begins, step_begins } => {
                            for flow in &mut flows {
                                flow.stage(&moment, stage, *part_begins, *step_begins);
                            }
                        }
                    }
                }
            }
            for flow in &mut flows {
                flow.push(rod, *torque, hand[1], -1.0);
            }
        }
        for (flow, one) in flows.iter().zip(carried) {
            flow.write(one);
        }
    }
}

/// Positions and velocities.
type Pair<R> = [Vec<Vec2<R>>; 2];

/// Eight directions on their way.
struct Flow<R> {
    x: Vec<Vec2<R>>,
    v: Vec<Vec2<R>>,
    /// Within a phase that of all forces; outside without the torque's.
    a: Vec<Vec2<R>>,
    torque: R,
    material: Option<Material<R>>,
    /// Positions and velocities at the start of the step before, of the part, and of the stage; empty without a step
    /// before.
    before: Pair<R>,
    start: Pair<R>,
    origin: Pair<R>,
    /// Velocities and accelerations at the start of the part and at its stages.
    slopes: Vec<Pair<R>>,
    /// Memory for forces.
    work: Vec<Vec2<R>>,
}

/// Slots of `Flow::slopes`.
const MOST_SLOPES: usize = 3;

/// Takes the slopes of a list.
#[inline(always)]
fn read<R: Real>(from: &[Vec2<Dual>]) -> Vec<Vec2<R>> {
    let mut list = vec![Vec2::zero(); from.len()];
    for (to, from) in list.iter_mut().zip(from) {
        *to = Vec2::new(slopes(&from.x), slopes(&from.y));
    }
    list
}

/// Puts slopes into a list.
#[inline(always)]
fn write<R: Real>(from: &[Vec2<R>], to: &mut [Vec2<Dual>]) {
    for (to, from) in to.iter_mut().zip(from) {
        for k in 0..R::LANES {
            to.x.slopes[k] = from.x.get(k);
            to.y.slopes[k] = from.y.get(k);
        }
    }
}

impl<R: Real> Flow<R> {
    #[inline(always)]
    fn new(from: &Carried<'_>, implicit: bool) -> Self {
        let Motion { x, v, a, .. } = &*from.motion;
        let before = &from.past.before;
        let zeros = || vec![Vec2::zero(); x.len()];
        // (Verlet's steps need no memory of stages.)
        let stages = || vec![Vec2::zero(); if implicit { x.len() } else { 0 }];
        let mut a = read::<R>(a);
        // (What of it is due to the torque stands in the place of the pinned node.)
        a[1] = a[1] - a[0];
        a[0] = Vec2::zero();
        Flow {
            x: read(x),
            v: read(v),
            a,
            torque: R::zero(),
            material: from.rod.map(Material::new),
            before: [read(&before.x), read(&before.v)],
            start: [stages(), stages()],
            origin: [stages(), stages()],
            slopes: vec![[stages(), stages()]; MOST_SLOPES],
            work: zeros(),
        }
    }

    #[inline(always)]
    fn write(&self, to: &mut Carried<'_>) {
        write(&self.x, &mut to.motion.x);
        write(&self.v, &mut to.motion.v);
        write(&self.a, &mut to.motion.a);
        write(&self.before[0], &mut to.past.before.x);
        write(&self.before[1], &mut to.past.before.v);
    }

    /// Adds what the torque does to the second node's acceleration, or takes it away, where that node is at `hand`.
    #[inline(always)]
    fn push(&mut self, rod: &Rod<f64>, torque: f64, hand: Vec2<f64>, sign: f64) {
        let inverse = rod.inverse_mass[1];
        let mut strength = self.torque * R::splat(inverse);
        if let Some(material) = &self.material {
            strength += R::splat(torque) * material.inverse_mass[1];
        }
        let push = splat(turn(hand)).scale(strength)
            + turned(hand, self.x[1]).scale(R::splat(torque * inverse));
        self.a[1] += push.scale(R::splat(sign));
    }

    /// Adds to the changes of the forces in `work` those by the torque and by the material.
    #[inline(always)]
    fn complete_forces(&mut self, moment: &Moment<'_, R>) {
        self.work[1] += splat(moment.turn()).scale(self.torque);
        if let Some(material) = &mut self.material {
            moment.forces_on(material);
            for i in 1..self.work.len() {
                self.work[i] += material.forces[i];
            }
        }
    }

    /// A Verlet step.
    #[inline(always)]
    fn verlet(&mut self, moment: &Moment<'_, R>, dt: f64) {
        let nodes = self.x.len();
        let (dt, half) = (R::splat(dt), R::splat(0.5 * dt));
        for i in 1..nodes {
            self.v[i] += self.a[i].scale(half);
            self.x[i] += self.v[i].scale(dt);
        }
        moment.force_changes([&self.x, &self.v], &mut self.work);
        self.complete_forces(moment);
        for i in 1..nodes {
            self.a[i] = self.work[i].scale(R::splat(moment.rod().inverse_mass[i]));
            if let Some(material) = &self.material {
                self.a[i] += splat(moment.force(i)).scale(material.inverse_mass[i]);
            }
            self.v[i] += self.a[i].scale(half);
        }
    }

    /// A stage of an implicit scheme.
    #[inline(always)]
    fn stage(
        &mut self,
        moment: &Moment<'_, R>,
        stage: &Stage<f64>,
        part_begins: bool,
        step_begins: bool,
    ) {
        let nodes = self.x.len();
        if part_begins {
            self.keep(0);
            self.start[0].copy_from_slice(&self.x);
            self.start[1].copy_from_slice(&self.v);
        }
        self.begin(stage);
        if step_begins && !self.before[0].is_empty() {
            self.before[0].copy_from_slice(&self.start[0]);
            self.before[1].copy_from_slice(&self.start[1]);
        }
        // Solved for the acceleration, from the forces on a motion without any, which would end at `x` with the velocity
        // of the start: so nothing cancels.
        let (h, rate) = (R::splat(stage.h), R::splat(stage.rate));
        let Flow { x, origin: [x0, v0], .. } = self;
        for i in 1..nodes {
            x[i] = x0[i] + v0[i].scale(h);
        }
        moment.force_changes([x, v0], &mut self.work);
        self.complete_forces(moment);
        if let Some(material) = &self.material {
            for i in 1..nodes {
                let a = moment.force(i).scale(moment.rod().inverse_mass[i]);
                self.work[i] -= splat(a).scale(material.mass[i]);
            }
        }
        moment.solve(&mut self.work);
        let Flow { x, v, a, origin: [x0, v0], work, .. } = self;
        for i in 1..nodes {
            a[i] = work[i].scale(rate * rate);
            v[i] = v0[i] + a[i].scale(h);
            x[i] = x0[i] + v[i].scale(h);
        }
        if let Origin::Slopes { from, .. } = stage.origin
            && !stage.last
        {
            self.keep(from.len());
        }
    }

    /// Sets what a stage starts from.
    #[inline(always)]
    fn begin(&mut self, stage: &Stage<f64>) {
        let origin = stage.origin.splat();
        let Flow { x, v, before, start, origin: [x0, v0], slopes, .. } = self;
        for i in 1..x.len() {
            x0[i] = origin.of(start[0][i], x, &before[0], i);
            v0[i] = origin.of(start[1][i], v, &before[1], i);
        }
        if let Origin::Slopes { from, .. } = stage.origin {
            for (from, [rates, accelerations]) in from.iter().zip(slopes) {
                let weight = R::splat(from * stage.dt);
                for i in 1..x.len() {
                    x0[i] += rates[i].scale(weight);
                    v0[i] += accelerations[i].scale(weight);
                }
            }
        }
    }

    /// Keeps the slopes at the present state.
    #[inline(always)]
    fn keep(&mut self, place: usize) {
        self.slopes[place][0].copy_from_slice(&self.v);
        self.slopes[place][1].copy_from_slice(&self.a);
    }
}
