//! The linear motion of a rod about the moments of a tape, and about its material: what derivatives are carried by.

use super::{Move, Tape};
use crate::lane::{DIRECTIONS, Dual, Lanewise, Real};
use crate::linear::{Front, Hook};
use crate::rod::{Rod, linearize};
use crate::vec2::Vec2;

/// The linear motion about moments of a tape: looked at in lanes, as many moments at once, and then picked one by one.
pub(super) struct Linear<R> {
    pub rod: Rod<f64>,
    rods: Rod<R>,
    transposed: bool,
    /// Whether these are moments of an implicit scheme.
    implicit: bool,
    x: Vec<Vec2<R>>,
    v: Vec<Vec2<R>>,
    hooks_in_lanes: Vec<Hook<R>>,
    eliminated_in_lanes: Vec<Hook<R>>,
    force_in_lanes: Vec<Vec2<R>>,
    turns_in_lanes: Vec<Vec2<R>>,
    /// Of every node but the first `-d(forces)/dx`, of a stage with `-rate d(forces)/dv`. Transposed for the way back.
    pub hooks: Vec<Hook<f64>>,
    /// Of a stage the same with the inertia, eliminated.
    pub eliminated: Vec<Hook<f64>>,
    /// Forces, with the torque's \[N\].
    pub force: Vec<Vec2<f64>>,
    /// Gradient of every edge's angle with its end \[1/m\].
    pub turns: Vec<Vec2<f64>>,
}

impl<R: Real> Linear<R> {
    pub fn new(rod: &Rod<f64>, transposed: bool) -> Self {
        let nodes = rod.nodes();
        let mut rods = Rod::new(nodes);
        rods.pair(rod, &mut |to: &mut R, from| *to = R::splat(*from));
        Linear {
            rod: rod.clone(),
            rods,
            transposed,
            implicit: false,
            x: vec![Vec2::zero(); nodes],
            v: vec![Vec2::zero(); nodes],
            hooks_in_lanes: vec![Hook::default(); nodes - 1],
            eliminated_in_lanes: vec![Hook::default(); nodes - 1],
            force_in_lanes: vec![Vec2::zero(); nodes],
            turns_in_lanes: vec![Vec2::zero(); nodes - 1],
            hooks: vec![Hook::default(); nodes - 1],
            eliminated: vec![Hook::default(); nodes - 1],
            force: vec![Vec2::zero(); nodes],
            turns: vec![Vec2::zero(); nodes - 1],
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
            let Some((force, mut hook)) = sweep.next() else { break };
            self.force_in_lanes[i] = force;
            if self.transposed {
                hook = hook.transposed();
            }
            self.hooks_in_lanes[i - 1] = hook;
            if self.implicit {
                let inertia = self.rods.mass[i] * rate * rate;
                hook.diagonal[0][0] += inertia;
                hook.diagonal[1][1] += inertia;
                self.eliminated_in_lanes[i - 1] = front.eliminate(&hook);
            }
            let e = self.x[i] - self.x[i - 1];
            self.turns_in_lanes[i - 1] = e.perp().scale(R::one() / e.dot(e));
        }
    }

    /// Turns to the moment in one lane.
    #[inline(always)]
    pub fn pick(&mut self, lane: usize) {
        for i in 1..self.rods.nodes() {
            self.hooks_in_lanes[i - 1].read_lane(lane, &mut self.hooks[i - 1]);
            if self.implicit {
                self.eliminated_in_lanes[i - 1].read_lane(lane, &mut self.eliminated[i - 1]);
            }
            self.force_in_lanes[i].read_lane(lane, &mut self.force[i]);
            self.turns_in_lanes[i - 1].read_lane(lane, &mut self.turns[i - 1]);
        }
    }

    /// Adds to `to` what damping takes from the forces for a change `v` of the velocities.
    #[inline(always)]
    pub fn damp<T: Real>(&self, v: &[Vec2<T>], to: &mut [Vec2<T>]) {
        let nodes = v.len();
        let (mut rate, mut moment) = (T::zero(), T::zero());
        for k in (0..nodes - 1).rev() {
            let turn = splat(self.turns[k]);
            let next = turn.dot(v[k + 1] - v[k]);
            // The moment at the end of this edge, and the couple of the one after it.
            // (It is zero at the tip, as the damping there.)
            let own = T::splat(self.rod.bend_damping[k + 1]) * (rate - next);
            if k + 2 < nodes {
                let pull = splat(self.turns[k + 1]).scale(own - moment);
                to[k + 2] += pull;
                to[k + 1] -= pull;
            }
            (rate, moment) = (next, own);
        }
        let pull = splat(self.turns[0]).scale(-moment);
        to[1] += pull;
        let drag = T::splat(self.rod.damping);
        for i in 1..nodes {
            to[i] += v[i].scale(drag);
        }
    }
}

/// By what a rod's material changes.
pub(super) struct Material<R> {
    /// A rod with the changes as its stiffnesses; its gravity is 1, and its masses are the changes of the weights.
    pub forces: Rod<R>,
    /// Changes of the masses, and of what one over them is.
    pub mass: Vec<R>,
    pub inverse_mass: Vec<R>,
}

impl<R: Real> Material<R> {
    /// None where nothing changes.
    pub fn changing(rod: &Rod<Dual>) -> Option<Self> {
        let mut changes = false;
        rod.visit(&mut |x: &Dual| changes |= x.slopes != [0.0; DIRECTIONS]);
        changes.then(|| Material::new(rod))
    }

    pub fn new(rod: &Rod<Dual>) -> Self {
        let mut weightless = Rod::new(rod.nodes());
        weightless.pair(rod, &mut |to: &mut R, from: &Dual| *to = slopes(from));
        let (mass, inverse_mass) = (weightless.mass.clone(), weightless.inverse_mass.clone());
        let mut forces = weightless;
        for (to, mass) in forces.mass.iter_mut().zip(&rod.mass) {
            *to = slopes(&(*mass * rod.gravity));
        }
        forces.gravity = R::one();
        Material { forces, mass, inverse_mass }
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
