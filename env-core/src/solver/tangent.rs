//! Derivatives of steps of a pinned rod, carried along what a tape has: directions of its state, torque and material in
//! lanes, eight to a `Flow`.
//!
//! A step is a chain of linear maps and of forces, and the derivative of the forces is the matrix that Newton's method
//! eliminates. So a Verlet step multiplies by it. A stage of an implicit scheme solves with it once, at the solution
//! that the step itself has found: that is the derivative of what the stage's equation defines (the theorem on implicit
//! functions), however the iteration came to it. By the rod's material forces are linear: their change is the force on
//! a rod that has the changes as its stiffnesses.

use super::moment::{Linear, Material, slopes, splat, turn, turned};
use super::{Move, Origin, Past, Stage, Tape};
use crate::error::Result;
use crate::isa::{ForLanes, Isa, Kernel, dispatch, with_lanes};
use crate::lane::{Dual, Real};
use crate::linear::{Ascent, Descent, multiply};
use crate::rod::{Motion, Rod, forces};
use crate::vec2::Vec2;

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
    /// Geometry and material.
    pub rod: &'a Rod<Dual>,
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
    struct Work<'a, 'b>(Isa, &'a Rod<f64>, &'a [Phase], &'a mut [Carried<'b>]);
    impl ForLanes for Work<'_, '_> {
        type Output = ();
        fn make<R: Real>(self) {
            let Work(isa, rod, phases, carried) = self;
            let nodes = rod.nodes();
            let mut flows: Vec<Flow<R>> = carried.iter().map(|one| Flow::new(one, nodes)).collect();
            let linear = &mut Linear::new(rod, false);
            for (k, phase) in phases.iter().enumerate() {
                for (flow, one) in flows.iter_mut().zip(&*carried) {
                    flow.torque = slopes(&one.torques[k]);
                }
                dispatch(isa, Run { phase, linear, flows: &mut flows });
            }
            for (flow, one) in flows.iter().zip(carried) {
                flow.write(one);
            }
        }
    }
    let isa = Isa::current()?;
    with_lanes(isa, Work(isa, rod, phases, carried));
    Ok(())
}

/// A phase of all flows.
struct Run<'a, R> {
    phase: &'a Phase,
    linear: &'a mut Linear<R>,
    flows: &'a mut [Flow<R>],
}

impl<R: Real> Kernel for Run<'_, R> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Run { phase, linear, flows } = self;
        let Phase { tape, torque, hand } = phase;
        for flow in flows.iter_mut() {
            flow.push(linear, *torque, hand[0], 1.0);
        }
        let count = tape.moves().len();
        for first in (0..count).step_by(R::LANES) {
            linear.look(tape, first, *torque);
            for at in first..count.min(first + R::LANES) {
                linear.pick(at - first);
                let moment = tape.moment(at);
                for flow in flows.iter_mut() {
                    match tape.moves()[at] {
                        Move::Verlet(dt) => flow.verlet(linear, moment, dt),
                        Move::Stage { stage, part_begins, step_begins } => {
                            flow.stage(linear, moment, &stage, part_begins, step_begins);
                        }
                    }
                }
            }
        }
        for flow in flows.iter_mut() {
            flow.push(linear, *torque, hand[1], -1.0);
        }
    }
}

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
    before: [Vec<Vec2<R>>; 2],
    start: [Vec<Vec2<R>>; 2],
    origin: [Vec<Vec2<R>>; 2],
    /// Velocities and accelerations at the start of the part and at its stages.
    slopes: Vec<[Vec<Vec2<R>>; 2]>,
    /// Memory for forces, for those that the material changes, and for a moment of the tape in every lane.
    work: Vec<Vec2<R>>,
    own: Vec<Vec2<R>>,
    wide: [Vec<Vec2<R>>; 2],
}

/// Slots of `Flow::slopes`.
const MOST_SLOPES: usize = 3;

impl<R: Real> Flow<R> {
    fn new(from: &Carried<'_>, nodes: usize) -> Self {
        let read = |list: &[Vec2<Dual>]| -> Vec<Vec2<R>> {
            list.iter().map(|p| Vec2::new(slopes(&p.x), slopes(&p.y))).collect()
        };
        let zeros = || vec![Vec2::zero(); nodes];
        let Motion { x, v, a, .. } = &*from.motion;
        let mut a: Vec<Vec2<R>> = read(a);
        // (What of it is due to the torque stands in the place of the pinned node.)
        a[1] = a[1] - a[0];
        a[0] = Vec2::zero();
        Flow {
            x: read(x),
            v: read(v),
            a,
            torque: R::zero(),
            material: Material::changing(from.rod),
            before: [read(&from.past.before.x), read(&from.past.before.v)],
            start: [zeros(), zeros()],
            origin: [zeros(), zeros()],
            slopes: (0..MOST_SLOPES).map(|_| [zeros(), zeros()]).collect(),
            work: zeros(),
            own: zeros(),
            wide: [zeros(), zeros()],
        }
    }

    fn write(&self, to: &mut Carried<'_>) {
        let write = |to: &mut [Vec2<Dual>], from: &[Vec2<R>]| {
            for (to, from) in to.iter_mut().zip(from) {
                to.x.slopes = std::array::from_fn(|k| from.x.get(k));
                to.y.slopes = std::array::from_fn(|k| from.y.get(k));
            }
        };
        write(&mut to.motion.x, &self.x);
        write(&mut to.motion.v, &self.v);
        write(&mut to.motion.a, &self.a);
        write(&mut to.past.before.x, &self.before[0]);
        write(&mut to.past.before.v, &self.before[1]);
    }

    /// Adds what the torque does to the second node's acceleration, or takes it away, where that node is at `hand`.
    #[inline(always)]
    fn push(&mut self, linear: &Linear<R>, torque: f64, hand: Vec2<f64>, sign: f64) {
        let inverse = linear.rod.inverse_mass[1];
        let mut strength = self.torque * R::splat(inverse);
        if let Some(material) = &self.material {
            strength += R::splat(torque) * material.inverse_mass[1];
        }
        let push = splat(turn(hand)).scale(strength)
            + turned(hand, self.x[1]).scale(R::splat(torque * inverse));
        self.a[1] += push.scale(R::splat(sign));
    }

    /// Takes the forces in `work`, of which the motion's part is there with the opposite sign, to what they are with
    /// the torque's change and the material's.
    #[inline(always)]
    fn complete_forces(&mut self, linear: &Linear<R>, (x, v): (&[Vec2<f64>], &[Vec2<f64>])) {
        let nodes = x.len();
        for i in 1..nodes {
            self.work[i] = -self.work[i];
        }
        self.work[1] += splat(linear.turns[0]).scale(self.torque);
        if let Some(material) = &self.material {
            let [wide_x, wide_v] = &mut self.wide;
            for i in 0..nodes {
                (wide_x[i], wide_v[i]) = (splat(x[i]), splat(v[i]));
            }
            forces(&material.forces, wide_x, wide_v, &mut self.own);
            for i in 1..nodes {
                self.work[i] += self.own[i];
            }
        }
    }

    /// A Verlet step.
    #[inline(always)]
    fn verlet(&mut self, linear: &Linear<R>, moment: (&[Vec2<f64>], &[Vec2<f64>]), dt: f64) {
        let nodes = self.x.len();
        let (dt, half) = (R::splat(dt), R::splat(0.5 * dt));
        for i in 1..nodes {
            self.v[i] += self.a[i].scale(half);
            self.x[i] += self.v[i].scale(dt);
            self.work[i] = Vec2::zero();
        }
        multiply(&linear.hooks, &self.x[1..], &mut self.work[1..]);
        linear.damp(&self.v, &mut self.work);
        self.complete_forces(linear, moment);
        for i in 1..nodes {
            self.a[i] = self.work[i].scale(R::splat(linear.rod.inverse_mass[i]));
            if let Some(material) = &self.material {
                self.a[i] += splat(linear.force[i]).scale(material.inverse_mass[i]);
            }
            self.v[i] += self.a[i].scale(half);
        }
    }

    /// A stage of an implicit scheme.
    #[inline(always)]
    fn stage(
        &mut self,
        linear: &Linear<R>,
        moment: (&[Vec2<f64>], &[Vec2<f64>]),
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
        let rate = R::splat(stage.rate);
        self.begin(stage);
        if step_begins && !self.before[0].is_empty() {
            self.before[0].copy_from_slice(&self.start[0]);
            self.before[1].copy_from_slice(&self.start[1]);
        }
        // Solved for the acceleration, from the forces on a motion without any, which would end at `x` with the velocity
        // of the start: so nothing cancels.
        let h = R::splat(stage.h);
        self.work.fill(Vec2::zero());
        linear.damp(&self.origin[0], &mut self.work);
        for i in 1..nodes {
            self.work[i] = self.work[i].scale(-rate);
            self.x[i] = self.origin[0][i] + self.origin[1][i].scale(h);
        }
        multiply(&linear.hooks, &self.x[1..], &mut self.work[1..]);
        self.complete_forces(linear, moment);
        if let Some(material) = &self.material {
            for i in 1..nodes {
                let a = linear.force[i].scale(linear.rod.inverse_mass[i]);
                self.work[i] -= splat(a).scale(material.mass[i]);
            }
        }
        let (mut descent, mut ascent) = (Descent::default(), Ascent::default());
        for i in 1..nodes {
            self.work[i] = descent.pass(&linear.eliminated[i - 1].splat(), self.work[i]);
        }
        for i in (1..nodes).rev() {
            let right = &linear.eliminated[i - 1].splat().right;
            let moved = ascent.pass(right, self.work[i]);
            self.a[i] = moved.scale(rate * rate);
            self.v[i] = self.origin[1][i] + self.a[i].scale(h);
            self.x[i] = self.origin[0][i] + self.v[i].scale(h);
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
