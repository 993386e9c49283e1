//! The way back: from the gradient by a rod's state after some steps to those by the state before them, by the torques
//! and by its material. The maps of `tangent`, transposed, in the opposite order along the tape.

use super::moment::{Linear, Material, Moment, splat, turn, turned};
use super::{Move, Origin, Past, Phase, Stage};
use crate::error::Result;
use crate::isa::{ForLanes, Isa, with_lanes};
use crate::lane::{DIRECTIONS, Dual, Kernel, Real};
use crate::rod::{Motion, Rod};
use crate::vec2::Vec2;
use std::marker::PhantomData;

/// Takes the gradients of a number by the state after the phases to those by the state before them; they stand where the
/// state's own numbers do, accelerations without what the torque does. Returns those by the torque of
/// each phase, and by the eight directions of each of `materials`.
///
/// # Errors
/// See `Isa::current`.
pub fn pull_back(
    rod: &Rod<f64>,
    phases: &[Phase],
    materials: &[Rod<Dual>],
    state: (&mut Motion<f64>, &mut Past<f64, Motion<f64>>),
) -> Result<(Vec<f64>, Vec<f64>)> {
    Ok(with_lanes(Isa::current()?, Work { rod, phases, materials, state }))
}

struct Work<'a> {
    rod: &'a Rod<f64>,
    phases: &'a [Phase],
    materials: &'a [Rod<Dual>],
    state: (&'a mut Motion<f64>, &'a mut Past<f64, Motion<f64>>),
}

impl ForLanes for Work<'_> {
    type Output = (Vec<f64>, Vec<f64>);
    fn make<R: Real>(self) -> Self::Output {
        R::run(Run::<R>(self, PhantomData))
    }
}

/// All of it, for one number type.
struct Run<'a, R>(Work<'a>, PhantomData<R>);

impl<R: Real> Kernel for Run<'_, R> {
    type Output = (Vec<f64>, Vec<f64>);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Work { rod, phases, materials, state } = self.0;
        let mut linear = Linear::<R>::new(rod, true);
        let implicit = phases.iter().any(|phase| phase.tape.implicit());
        let mut pull = Pull::new(state, materials, implicit);
        let mut torques = vec![0.0; phases.len()];
        for (Phase { tape, torque, hand }, by_torque) in phases.iter().zip(&mut torques).rev() {
            pull.torque = 0.0;
            let count = tape.moves().len();
            pull.push(rod, *torque, hand[1], -1.0);
            for first in (0..count).step_by(R::LANES).rev() {
                linear.look(tape, first, *torque);
                for at in (first..count.min(first + R::LANES)).rev() {
                    let moment = linear.moment(at - first);
                    match &tape.moves()[at] {
                        Move::Verlet(dt) => pull.verlet(&moment, *dt),
                        Move::Stage { stage, part_begins, step_begins } => {
                            pull.stage(&moment, stage, *part_begins, *step_begins);
                        }
                    }
                }
            }
            pull.push(rod, *torque, hand[0], 1.0);
            *by_torque = pull.torque;
        }
        let mut by_materials = Vec::with_capacity(DIRECTIONS * materials.len());
        for (_, sum) in &pull.materials {
            for k in 0..DIRECTIONS {
                by_materials.push(sum.get(k));
            }
        }
        (torques, by_materials)
    }
}

/// Slots of `Pull::slopes`.
const MOST_SLOPES: usize = 3;

/// Gradients on their way back.
struct Pull<'a, R> {
    state: &'a mut Motion<f64>,
    /// By positions and velocities a step before; empty for schemes that do not look back.
    before: [&'a mut Vec<Vec2<f64>>; 2],
    torque: f64,
    /// Materials, and the gradient by each of their directions.
    materials: Vec<(Material<R>, R)>,
    /// By positions and velocities at the start of the part, and of the stage.
    start: [Vec<Vec2<f64>>; 2],
    origin: [Vec<Vec2<f64>>; 2],
    /// By velocities and accelerations at the start of the part and at its stages.
    slopes: Vec<[Vec<Vec2<f64>>; 2]>,
    /// By forces, and what these give for positions and velocities.
    force: Vec<Vec2<f64>>,
    work: [Vec<Vec2<f64>>; 2],
}

impl<'a, R: Real> Pull<'a, R> {
    #[inline(always)]
    fn new(
        (state, past): (&'a mut Motion<f64>, &'a mut Past<f64, Motion<f64>>),
        rods: &[Rod<Dual>],
        implicit: bool,
    ) -> Self {
        let nodes = state.x.len();
        let zeros = || vec![Vec2::zero(); nodes];
        // (Verlet's steps need no memory of stages.)
        let stages = || vec![Vec2::zero(); if implicit { nodes } else { 0 }];
        let mut materials = Vec::with_capacity(rods.len());
        for rod in rods {
            materials.push((Material::new(rod), R::zero()));
        }
        Pull {
            state,
            before: [&mut past.before.x, &mut past.before.v],
            torque: 0.0,
            materials,
            start: [stages(), stages()],
            origin: [stages(), stages()],
            slopes: vec![[stages(), stages()]; MOST_SLOPES],
            force: zeros(),
            work: [zeros(), zeros()],
        }
    }

    /// See `Flow::push`.
    #[inline(always)]
    fn push(&mut self, rod: &Rod<f64>, torque: f64, hand: Vec2<f64>, sign: f64) {
        let by = self.state.a[1].scale(sign);
        let inverse = rod.inverse_mass[1];
        let strength = turn(hand).dot(by);
        self.torque += strength * inverse;
        self.state.x[1] += turned(hand, by).scale(torque * inverse);
        for (material, sum) in &mut self.materials {
            *sum += material.inverse_mass[1] * R::splat(strength * torque);
        }
    }

    /// Adds what the forces' gradient gives for the torque and the materials; leaves in `work` what it gives for the
    /// motion.
    #[inline(always)]
    fn by_forces(&mut self, moment: &Moment<'_, R>) {
        self.torque += moment.turn().dot(self.force[1]);
        for (material, sum) in &mut self.materials {
            moment.forces_on(material);
            for i in 1..self.force.len() {
                *sum += material.forces[i].dot(splat(self.force[i]));
            }
        }
        let [x, v] = &mut self.work;
        moment.force_gradients(&self.force, [x, v]);
    }

    /// See `Flow::verlet`.
    #[inline(always)]
    fn verlet(&mut self, moment: &Moment<'_, R>, dt: f64) {
        let nodes = self.force.len();
        let half = 0.5 * dt;
        for i in 1..nodes {
            let Motion { v, a, .. } = &mut *self.state;
            a[i] += v[i].scale(half);
            self.force[i] = a[i].scale(moment.rod().inverse_mass[i]);
            for (material, sum) in &mut self.materials {
                *sum += material.inverse_mass[i] * R::splat(moment.force(i).dot(a[i]));
            }
        }
        self.by_forces(moment);
        let Motion { x, v, a, .. } = &mut *self.state;
        for i in 1..nodes {
            x[i] += self.work[0][i];
            v[i] += x[i].scale(dt) + self.work[1][i];
            a[i] = v[i].scale(half);
        }
    }

    /// See `Flow::stage`.
    #[inline(always)]
    fn stage(
        &mut self,
        moment: &Moment<'_, R>,
        stage: &Stage<f64>,
        part_begins: bool,
        step_begins: bool,
    ) {
        let nodes = self.force.len();
        let rate = stage.rate;
        if let Origin::Slopes { from, .. } = stage.origin
            && !stage.last
        {
            self.forget(from.len());
        }
        let Motion { x, v, a, .. } = &mut *self.state;
        for i in 1..nodes {
            v[i] += x[i].scale(stage.h);
            a[i] += v[i].scale(stage.h);
            self.force[i] = a[i].scale(rate * rate);
        }
        moment.solve(&mut self.force);
        for i in 1..nodes {
            let a = moment.force(i).scale(moment.rod().inverse_mass[i]);
            for (material, sum) in &mut self.materials {
                *sum -= material.mass[i] * R::splat(a.dot(self.force[i]));
            }
        }
        self.by_forces(moment);
        let Motion { x, v, .. } = &mut *self.state;
        let [x0, v0] = &mut self.origin;
        for i in 1..nodes {
            let by = self.work[0][i];
            x0[i] = x[i] + by;
            v0[i] = v[i] + by.scale(stage.h) + self.work[1][i];
        }
        self.begin(stage, step_begins);
        if part_begins {
            self.forget(0);
            let Motion { x, v, .. } = &mut *self.state;
            for (state, start) in [x, v].into_iter().zip(&mut self.start) {
                for i in 1..nodes {
                    state[i] += start[i];
                }
                start.fill(Vec2::zero());
            }
        }
    }

    /// From what a stage starts from to the start of the part, the last stage and the step before. See `Flow::begin`.
    #[inline(always)]
    fn begin(&mut self, stage: &Stage<f64>, step_begins: bool) {
        let Motion { x, v, a, .. } = &mut *self.state;
        a.fill(Vec2::zero());
        for (k, state) in [x, v].into_iter().enumerate() {
            let (origin, start) = (&self.origin[k], &mut self.start[k]);
            let before = &mut *self.before[k];
            for i in 1..state.len() {
                let by = origin[i];
                if step_begins && !before.is_empty() {
                    start[i] += before[i];
                    before[i] = Vec2::zero();
                }
                state[i] = Vec2::zero();
                match stage.origin {
                    Origin::Start => start[i] += by,
                    Origin::Stage(weight) => {
                        start[i] += by.scale(1.0 - weight);
                        state[i] = by.scale(weight);
                    }
                    Origin::Before(weight) => {
                        start[i] += by.scale(1.0 + weight);
                        before[i] -= by.scale(weight);
                    }
                    Origin::Slopes { from, .. } => {
                        start[i] += by;
                        for (from, slope) in from.iter().zip(&mut self.slopes) {
                            slope[k][i] += by.scale(from * stage.dt);
                        }
                    }
                }
            }
        }
    }

    /// Gives what was gathered for kept slopes to the state that they were kept of. See `Flow::keep`.
    #[inline(always)]
    fn forget(&mut self, place: usize) {
        let Motion { v, a, .. } = &mut *self.state;
        let [slope_v, slope_a] = &mut self.slopes[place];
        for i in 1..v.len() {
            v[i] += slope_v[i];
            a[i] += slope_a[i];
        }
        slope_v.fill(Vec2::zero());
        slope_a.fill(Vec2::zero());
    }
}
