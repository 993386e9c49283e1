//! The way back: from the gradient by a rod's state after some steps to those by the state before them, by the torques
//! and by its material. The maps of `tangent`, transposed, in the opposite order along the tape.

use super::moment::{Linear, Material, splat, turn, turned};
use super::{Move, Origin, Past, Phase, Stage};
use crate::error::Result;
use crate::isa::{ForLanes, Isa, Kernel, dispatch, with_lanes};
use crate::lane::{DIRECTIONS, Dual, Real};
use crate::linear::{Ascent, Descent, multiply};
use crate::rod::{Motion, Rod, forces};
use crate::vec2::Vec2;

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
    struct Work<'a>(
        Isa,
        &'a Rod<f64>,
        &'a [Phase],
        &'a [Rod<Dual>],
        (&'a mut Motion<f64>, &'a mut Past<f64, Motion<f64>>),
    );
    impl ForLanes for Work<'_> {
        type Output = (Vec<f64>, Vec<f64>);
        fn make<R: Real>(self) -> Self::Output {
            let Work(isa, rod, phases, materials, state) = self;
            let linear = &mut Linear::<R>::new(rod, true);
            let pull = &mut Pull::new(state, materials);
            let mut torques: Vec<f64> = vec![];
            for phase in phases.iter().rev() {
                pull.torque = 0.0;
                dispatch(isa, Run { phase, linear, pull });
                torques.push(pull.torque);
            }
            torques.reverse();
            let sums = pull.materials.iter();
            let sums = sums.flat_map(|(_, sum)| (0..DIRECTIONS).map(|k| sum.get(k)));
            (torques, sums.collect())
        }
    }
    let isa = Isa::current()?;
    Ok(with_lanes(isa, Work(isa, rod, phases, materials, state)))
}

/// The way back through a phase.
struct Run<'a, 'b, R> {
    phase: &'a Phase,
    linear: &'a mut Linear<R>,
    pull: &'a mut Pull<'b, R>,
}

impl<R: Real> Kernel for Run<'_, '_, R> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Run { phase: Phase { tape, torque, hand }, linear, pull } = self;
        let count = tape.moves().len();
        pull.push(linear, *torque, hand[1], -1.0);
        for first in (0..count).step_by(R::LANES).rev() {
            linear.look(tape, first, *torque);
            for at in (first..count.min(first + R::LANES)).rev() {
                linear.pick(at - first);
                let moment = tape.moment(at);
                match tape.moves()[at] {
                    Move::Verlet(dt) => pull.verlet(linear, moment, dt),
                    Move::Stage { stage, part_begins, step_begins } => {
                        pull.stage(linear, moment, &stage, part_begins, step_begins);
                    }
                }
            }
        }
        pull.push(linear, *torque, hand[0], 1.0);
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
    /// By forces; and memory.
    force: Vec<Vec2<f64>>,
    work: Vec<Vec2<f64>>,
    own: Vec<Vec2<R>>,
    wide: [Vec<Vec2<R>>; 2],
}

impl<'a, R: Real> Pull<'a, R> {
    fn new(
        (state, past): (&'a mut Motion<f64>, &'a mut Past<f64, Motion<f64>>),
        materials: &[Rod<Dual>],
    ) -> Self {
        let nodes = state.x.len();
        let zeros = || vec![Vec2::zero(); nodes];
        let wide = || vec![Vec2::zero(); nodes];
        Pull {
            state,
            before: [&mut past.before.x, &mut past.before.v],
            torque: 0.0,
            materials: materials.iter().map(|rod| (Material::new(rod), R::zero())).collect(),
            start: [zeros(), zeros()],
            origin: [zeros(), zeros()],
            slopes: (0..MOST_SLOPES).map(|_| [zeros(), zeros()]).collect(),
            force: zeros(),
            work: zeros(),
            own: wide(),
            wide: [wide(), wide()],
        }
    }

    /// See `Flow::push`.
    #[inline(always)]
    fn push(&mut self, linear: &Linear<R>, torque: f64, hand: Vec2<f64>, sign: f64) {
        let by = self.state.a[1].scale(sign);
        let inverse = linear.rod.inverse_mass[1];
        let strength = turn(hand).dot(by);
        self.torque += strength * inverse;
        self.state.x[1] += turned(hand, by).scale(torque * inverse);
        for (material, sum) in &mut self.materials {
            *sum += material.inverse_mass[1] * R::splat(strength * torque);
        }
    }

    /// Adds what the forces' gradient gives for the torque and the materials.
    #[inline(always)]
    fn by_forces(&mut self, linear: &Linear<R>, (x, v): (&[Vec2<f64>], &[Vec2<f64>])) {
        self.torque += linear.turns[0].dot(self.force[1]);
        let nodes = x.len();
        for (material, sum) in &mut self.materials {
            let [wide_x, wide_v] = &mut self.wide;
            for i in 0..nodes {
                (wide_x[i], wide_v[i]) = (splat(x[i]), splat(v[i]));
            }
            forces(&material.forces, wide_x, wide_v, &mut self.own);
            for i in 1..nodes {
                *sum += self.own[i].dot(splat(self.force[i]));
            }
        }
    }

    /// See `Flow::verlet`.
    #[inline(always)]
    fn verlet(&mut self, linear: &Linear<R>, moment: (&[Vec2<f64>], &[Vec2<f64>]), dt: f64) {
        let nodes = self.force.len();
        let half = 0.5 * dt;
        for i in 1..nodes {
            let Motion { v, a, .. } = &mut *self.state;
            a[i] += v[i].scale(half);
            self.force[i] = a[i].scale(linear.rod.inverse_mass[i]);
            for (material, sum) in &mut self.materials {
                *sum += material.inverse_mass[i] * R::splat(linear.force[i].dot(a[i]));
            }
        }
        self.by_forces(linear, moment);
        self.work.fill(Vec2::zero());
        multiply(&linear.hooks, &self.force[1..], &mut self.work[1..]);
        let Motion { x, v, a, .. } = &mut *self.state;
        for i in 1..nodes {
            x[i] -= self.work[i];
            self.work[i] = Vec2::zero();
        }
        linear.damp(&self.force, &mut self.work);
        for i in 1..nodes {
            v[i] += x[i].scale(dt) - self.work[i];
            a[i] = v[i].scale(half);
        }
    }

    /// See `Flow::stage`.
    #[inline(always)]
    fn stage(
        &mut self,
        linear: &Linear<R>,
        moment: (&[Vec2<f64>], &[Vec2<f64>]),
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
        let [x0, v0] = &mut self.origin;
        for i in 1..nodes {
            v[i] += x[i].scale(stage.h);
            a[i] += v[i].scale(stage.h);
        }
        let (mut descent, mut ascent) = (Descent::default(), Ascent::default());
        for i in 1..nodes {
            self.force[i] = descent.pass(&linear.eliminated[i - 1], a[i].scale(rate * rate));
        }
        for i in (1..nodes).rev() {
            self.force[i] = ascent.pass(&linear.eliminated[i - 1].right, self.force[i]);
        }
        self.work.fill(Vec2::zero());
        multiply(&linear.hooks, &self.force[1..], &mut self.work[1..]);
        for i in 1..nodes {
            x0[i] = x[i] - self.work[i];
            v0[i] = v[i] - self.work[i].scale(stage.h);
            self.work[i] = Vec2::zero();
        }
        linear.damp(&self.force, &mut self.work);
        for i in 1..nodes {
            x0[i] += self.work[i].scale(rate);
            let a = linear.force[i].scale(linear.rod.inverse_mass[i]);
            for (material, sum) in &mut self.materials {
                *sum -= material.mass[i] * R::splat(a.dot(self.force[i]));
            }
        }
        self.by_forces(linear, moment);
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
