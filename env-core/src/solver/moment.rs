//! The linear motion of a rod about the moments of a tape, and about its material: what derivatives are carried by.

use super::{Move, Tape};
use crate::lane::{DIRECTIONS, Dual, Lanewise, Real};
use crate::linear::{Ascent, Descent, Front, Hook};
use crate::rod::{EdgeSlopes, Rod, force_changes, force_gradients, forces, linearize};
use crate::vec2::Vec2;

/// The linear motion about moments of a tape, as many side by side as there are lanes.
pub(super) struct Linear<'a, R> {
    rod: &'a Rod<f64>,
    rods: Rod<R>,
    transposed: bool,
    /// Whether these are moments of an implicit scheme.
    implicit: bool,
    x: Vec<Vec2<R>>,
    v: Vec<Vec2<R>>,
    edges: Vec<EdgeSlopes<R>>,
    /// Forces, with the torque's \[N\].
    forces: Vec<Vec2<R>>,
    /// Of a stage the matrix of Newton's method, eliminated, of every node but the first. Transposed for the way back.
    eliminated: Vec<Hook<R>>,
}

impl<'a, R: Real> Linear<'a, R> {
    pub fn new(rod: &'a Rod<f64>, transposed: bool) -> Self {
        let nodes = rod.nodes();
        let mut rods = Rod::new(nodes);
        rods.pair(rod, &mut |to: &mut R, from| *to = R::splat(*from));
        Linear {
            rod,
            rods,
            transposed,
            implicit: false,
            x: vec![Vec2::zero(); nodes],
            v: vec![Vec2::zero(); nodes],
            edges: vec![EdgeSlopes::default(); nodes - 1],
            forces: vec![Vec2::zero(); nodes],
            eliminated: vec![Hook::default(); nodes - 1],
        }
    }

    /// Looks at as many moments as there are lanes, or at those that are left.
    #[inline(always)]
    pub fn look(&mut self, tape: &Tape, first: usize, torque: f64) {
        let last = tape.moves().len() - 1;
        let mut rate = R::zero();
        for lane in 0..R::LANES {
            let at = last.min(first + lane);
            let (x, v) = tape.moment(at);
            for i in 0..x.len() {
                self.x[i].set_lane(lane, &x[i]);
                self.v[i].set_lane(lane, &v[i]);
            }
            if let Move::Stage { stage, .. } = &tape.moves()[at] {
                self.implicit = true;
                rate.set(lane, stage.rate);
            }
        }
        let mut front = Front::default();
        let mut sweep = linearize(&self.rods, &self.x, &self.v, R::splat(torque), rate);
        sweep.next();
        for i in 1..self.rods.nodes() {
            self.edges[i - 1] = sweep.slopes;
            let Some((force, mut hook)) = sweep.next() else { break };
            self.forces[i] = force;
            if self.implicit {
                if self.transposed {
                    hook = hook.transposed();
                }
                let inertia = self.rods.mass[i] * rate * rate;
                hook.diagonal[0][0] += inertia;
                hook.diagonal[1][1] += inertia;
                self.eliminated[i - 1] = front.eliminate(&hook);
            }
        }
    }

    /// The moment in one lane.
    #[inline(always)]
    pub fn moment(&self, lane: usize) -> Moment<'_, R> {
        Moment { linear: self, lane }
    }
}

/// One of these moments.
#[derive(Clone, Copy)]
pub(super) struct Moment<'a, R> {
    linear: &'a Linear<'a, R>,
    lane: usize,
}

impl<R: Real> Moment<'_, R> {
    #[inline(always)]
    pub fn rod(&self) -> &Rod<f64> {
        self.linear.rod
    }

    /// By how much the forces change with the motion.
    #[inline(always)]
    pub fn force_changes<T: Real>(&self, motion: [&[Vec2<T>]; 2], forces: &mut [Vec2<T>]) {
        let Linear { rod, edges, .. } = self.linear;
        force_changes(rod, edges, self.lane, motion, forces);
    }

    /// The transposed map.
    #[inline(always)]
    pub fn force_gradients<T: Real>(&self, forces: &[Vec2<T>], motion: [&mut [Vec2<T>]; 2]) {
        let Linear { rod, edges, .. } = self.linear;
        force_gradients(rod, edges, self.lane, forces, motion);
    }

    /// Solves with the matrix of Newton's method, in place.
    #[inline(always)]
    pub fn solve<T: Real>(&self, b: &mut [Vec2<T>]) {
        let eliminated = &self.linear.eliminated;
        let (mut descent, mut ascent) = (Descent::default(), Ascent::default());
        for (hook, b) in eliminated.iter().zip(&mut b[1..]) {
            *b = descent.pass(&hook.of_lane(self.lane), *b);
        }
        for (hook, b) in eliminated.iter().zip(&mut b[1..]).rev() {
            *b = ascent.pass(&hook.of_lane(self.lane).right, *b);
        }
    }

    /// The force on a node, with the torque's \[N\].
    #[inline(always)]
    pub fn force(&self, node: usize) -> Vec2<f64> {
        self.pick(&self.linear.forces[node])
    }

    /// Gradient of the first edge's angle with its end \[1/m\].
    #[inline(always)]
    pub fn turn(&self) -> Vec2<f64> {
        self.pick(&self.linear.edges[0].turn)
    }

    /// The forces on a rod of another material in this motion.
    #[inline(always)]
    pub fn forces_on(&self, material: &mut Material<R>) {
        let Linear { x, v, .. } = self.linear;
        let Material { rod, wide: [wide_x, wide_v], forces: own, .. } = material;
        for i in 0..x.len() {
            wide_x[i] = splat(self.pick(&x[i]));
            wide_v[i] = splat(self.pick(&v[i]));
        }
        forces(rod, wide_x, wide_v, own);
    }

    #[inline(always)]
    fn pick(&self, p: &Vec2<R>) -> Vec2<f64> {
        Vec2::new(p.x.get(self.lane), p.y.get(self.lane))
    }
}

/// By what a rod's material changes.
pub(super) struct Material<R> {
    /// A rod with the changes as its stiffnesses; its gravity is 1, and its masses are the changes of the weights.
    rod: Rod<R>,
    /// Changes of the masses, and of what one over them is.
    pub mass: Vec<R>,
    pub inverse_mass: Vec<R>,
    /// Changes of the forces, see `Moment::forces_on`.
    pub forces: Vec<Vec2<R>>,
    /// Memory for a motion.
    wide: [Vec<Vec2<R>>; 2],
}

impl<R: Real> Material<R> {
    #[inline(always)]
    pub fn new(from: &Rod<Dual>) -> Self {
        let nodes = from.nodes();
        let zeros = || vec![Vec2::zero(); nodes];
        let mut rod = Rod::new(nodes);
        rod.pair(from, &mut |to: &mut R, from: &Dual| *to = slopes(from));
        let (mass, inverse_mass) = (rod.mass.clone(), rod.inverse_mass.clone());
        for (to, mass) in rod.mass.iter_mut().zip(&from.mass) {
            *to = slopes(&(*mass * from.gravity));
        }
        rod.gravity = R::one();
        Material { rod, mass, inverse_mass, forces: zeros(), wide: [zeros(), zeros()] }
    }
}

/// The slopes of a number, one a lane.
#[inline(always)]
pub(crate) fn slopes<R: Real>(from: &Dual) -> R {
    debug_assert!(R::LANES == DIRECTIONS);
    R::from_fn(|k| from.slopes[k])
}

#[inline(always)]
pub(crate) fn splat<R: Real>(p: Vec2<f64>) -> Vec2<R> {
    Vec2::new(R::splat(p.x), R::splat(p.y))
}

/// Gradient of the angle of an edge from the origin to `e`, by `e` \[1/m\].
#[inline(always)]
pub(super) fn turn(e: Vec2<f64>) -> Vec2<f64> {
    e.perp().scale(1.0 / e.dot(e))
}

/// How that changes when `e` changes by `by`; the matrix behind it is symmetric.
#[inline(always)]
pub(super) fn turned<R: Real>(e: Vec2<f64>, by: Vec2<R>) -> Vec2<R> {
    let along = splat::<R>(e).dot(by) * R::splat(2.0);
    (by.perp() - splat::<R>(turn(e)).scale(along)).scale(R::splat(1.0 / e.dot(e)))
}
