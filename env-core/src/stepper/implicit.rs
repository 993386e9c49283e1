//! Implicit steps by Newton's method: backward Euler (the thesis, Fig. 2.4) and SDIRK2.
//!
//! Every stage solves `M (v - v*)/h = F(x, v)` with `v = (x - x*)/h`. Backward Euler is one stage of
//! h = dt from the old state; SDIRK2 (Alexander 1977, second order, L-stable, stiffly accurate) two
//! stages of `h = (1 - 1/sqrt 2) dt`.

use super::verlet::base_gradient;
use super::{Drive, FOLDED};
use crate::lane::{Mask, Real};
use crate::linear::Banded;
use crate::rod::{Motion, Rod, add_stiffness, forces};
use crate::vec2::Vec2;

/// Which implicit method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// First order, the thesis' own.
    BackwardEuler,
    /// Second order, L-stable.
    Sdirk2,
}

/// Newton iterations before a stage counts as failed.
const ITERATIONS: usize = 12;
/// A stage has converged when the last correction was below this share of the rod's length. Convergence is
/// quadratic: what remains after that correction is about its square over the length of an edge, some 1e-11 of
/// the rod's length.
const TOLERANCE: f64 = 1e-6;
/// 1 - 1/sqrt(2).
const GAMMA: f64 = 0.292_893_218_813_452_4;

/// Memory for the steps of one block of rods.
#[derive(Clone, Debug, Default)]
pub struct Workspace<R> {
    matrix: Banded<R>,
    force: Vec<Vec2<R>>,
    gradient: Vec<Vec2<R>>,
    right: Vec<R>,
    by_torque: Vec<R>,
    origin: Motion<R>,
}

impl<R: Real> Workspace<R> {
    /// Memory for rods of `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        Workspace {
            matrix: Banded::new(nodes - 1),
            force: vec![Vec2::zero(); nodes],
            gradient: vec![Vec2::zero(); nodes],
            right: vec![R::zero(); 2 * (nodes - 1)],
            by_torque: vec![R::zero(); 2 * (nodes - 1)],
            origin: Motion::new(nodes),
        }
    }
}

/// One step of `dt` \[s\]; returns where Newton's method converged. Elsewhere the motion is not valid.
#[inline(always)]
pub fn step<R: Real, D: Drive<R>>(
    method: Method,
    rod: &Rod<R>,
    motion: &mut Motion<R>,
    drive: &D,
    dt: f64,
    work: &mut Workspace<R>,
) -> R::Mask {
    work.origin.copy_from(motion);
    let (stages, h) = match method {
        Method::BackwardEuler => (1, dt),
        Method::Sdirk2 => (2, GAMMA * dt),
    };
    let mut sound = R::Mask::splat(true);
    // (One call in a loop, so that the Newton iteration is compiled once.)
    for i in 0..stages {
        if i == 1 {
            next_origin(&mut work.origin, motion);
        }
        sound = sound.and(stage(rod, motion, drive, h, work));
    }
    sound
}

/// The second stage starts from `x0 + (1 - gamma) dt x1'`, where `x1' = (x1 - x0)/(gamma dt)`.
#[inline(always)]
fn next_origin<R: Real>(origin: &mut Motion<R>, first: &Motion<R>) {
    let ratio = R::splat((1.0 - GAMMA) / GAMMA);
    for i in 0..origin.x.len() {
        let (x0, v0) = (origin.x[i], origin.v[i]);
        origin.x[i] = x0 + (first.x[i] - x0).scale(ratio);
        origin.v[i] = v0 + (first.v[i] - v0).scale(ratio);
    }
}

/// Solves one stage of size `h` from `work.origin`; `motion.a` predicts the acceleration and becomes that
/// of the stage.
#[inline(always)]
fn stage<R: Real, D: Drive<R>>(
    rod: &Rod<R>,
    motion: &mut Motion<R>,
    drive: &D,
    h: f64,
    work: &mut Workspace<R>,
) -> R::Mask {
    let nodes = rod.nodes();
    let (step, rate) = (R::splat(h), R::splat(1.0 / h));
    let small = rod.rest[0] * R::splat(TOLERANCE * (nodes - 1) as f64);
    let Workspace { matrix, force, gradient, right, by_torque, origin, .. } = work;
    let Motion { x, v, a } = motion;
    for i in 1..nodes {
        let speed = origin.v[i] + a[i].scale(step);
        x[i] = origin.x[i] + speed.scale(step);
        v[i] = speed;
    }
    let mut done = R::Mask::splat(false);
    for iteration in 0..ITERATIONS {
        let torque = drive.torque(x, v);
        let shape = forces(rod, x, v, force);
        force[1] += shape.base.scale(torque);
        for i in 1..nodes {
            let residual = (v[i] - origin.v[i]).scale(rod.mass[i] * rate) - force[i];
            right[2 * i - 2] = -residual.x;
            right[2 * i - 1] = -residual.y;
        }
        // The factors cost most of an iteration and serve for two: the first correction is small, so
        // the second changes them little. The schedule is the same for every lane.
        if iteration % 2 == 0 {
            matrix.clear();
            add_stiffness(rod, x, v, torque, rate, 1, matrix);
            for i in 1..nodes {
                let (inertia, zero) = (rod.mass[i] * rate * rate, R::zero());
                matrix.add_block(i - 1, i - 1, [[inertia, zero], [zero, inertia]]);
            }
            matrix.factor();
        }
        matrix.solve(right);
        if D::FEEDBACK {
            // The torque law adds a matrix of rank one: Sherman and Morrison's formula.
            drive.gradient(x, v, rate, gradient);
            by_torque.fill(R::zero());
            let base = base_gradient(x);
            by_torque[0] = base.x;
            by_torque[1] = base.y;
            matrix.solve(by_torque);
            let (mut on_right, mut on_torque) = (R::zero(), R::zero());
            for i in 1..nodes {
                let g = gradient[i];
                on_right += g.x * right[2 * i - 2] + g.y * right[2 * i - 1];
                on_torque += g.x * by_torque[2 * i - 2] + g.y * by_torque[2 * i - 1];
            }
            let share = on_right / (R::one() - on_torque);
            for (r, b) in right.iter_mut().zip(by_torque.iter()) {
                *r += *b * share;
            }
        }
        let mut largest = R::zero();
        for i in 1..nodes {
            let correction = Vec2::new(right[2 * i - 2], right[2 * i - 1]);
            // A converged lane stays frozen while its neighbours iterate. (`max` would drop a NaN.)
            x[i] = Vec2::select(done, x[i], x[i] + correction);
            largest += correction.x.abs() + correction.y.abs();
            v[i] = (x[i] - origin.x[i]).scale(rate);
        }
        done = done.or(largest.lt(small).and(R::splat(FOLDED).lt(shape.openness)));
        if done.all() {
            break;
        }
    }
    for i in 1..nodes {
        a[i] = (v[i] - origin.v[i]).scale(rate);
    }
    done
}
