//! Velocity Verlet: second order, symplectic without damping, explicit.

use super::FOLDED;
use crate::lane::{Mask, Real};
use crate::rod::{Motion, Rod, forces};
use crate::vec2::Vec2;
use crate::watch::Watch;

/// Who is told of the moments at which steps take forces.
pub trait Witness<R> {
    /// Positions at such a moment, and velocities, which are those of the half step.
    fn forces_taken(&mut self, x: &[Vec2<R>], v: &[Vec2<R>]);
}

/// Nobody.
impl<R> Witness<R> for () {
    #[inline(always)]
    fn forces_taken(&mut self, _x: &[Vec2<R>], _v: &[Vec2<R>]) {}
}

/// Steps between two looks at who watches.
const LOOK: usize = 64;

/// Sets the carried acceleration of a motion whose positions and velocities were just chosen.
#[inline(always)]
pub fn prepare<R: Real>(rod: &Rod<R>, motion: &mut Motion<R>) {
    forces(rod, &motion.x, &motion.v, &mut motion.a);
    accelerate(rod, &mut motion.a);
}

/// Takes `steps` steps of `dt` \[s\] with a constant base torque \[N m\]. Returns where the motion stayed
/// that of a rod.
///
/// Half kick, drift, forces, half kick. Damping forces use the velocity of the half step; the acceleration
/// carried from step to step leaves the torque out, so the torque may change between steps and n steps at
/// once give the same bits as n calls of one step.
#[inline(always)]
pub fn verlet<R: Real>(
    rod: &Rod<R>,
    motion: &mut Motion<R>,
    torque: R,
    dt: f64,
    steps: usize,
    watch: Watch<'_>,
    witness: &mut impl Witness<R>,
) -> R::Mask {
    let nodes = rod.nodes();
    let (dt, half) = (R::splat(dt), R::splat(0.5 * dt));
    let Motion { x, v, a, .. } = motion;
    let (x, v, a) = (&mut x[..nodes], &mut v[..nodes], &mut a[..nodes]);
    let kick = half * torque * rod.inverse_mass[1];
    let mut base = base_gradient(x);
    let mut openness = R::splat(2.0);
    let mut left = steps;
    while left > 0 && !watch.stops() {
        let run = left.min(LOOK);
        left -= run;
        for _ in 0..run {
            v[1] += base.scale(kick);
            for i in 1..nodes {
                v[i] += a[i].scale(half);
                x[i] += v[i].scale(dt);
            }
            let shape = forces(rod, x, v, a);
            witness.forces_taken(x, v);
            accelerate(rod, a);
            openness = openness.min(shape.openness);
            base = shape.base;
            for i in 1..nodes {
                v[i] += a[i].scale(half);
            }
            v[1] += base.scale(kick);
        }
    }
    let mut sound = R::splat(FOLDED).lt(openness);
    for i in 1..nodes {
        sound = sound.and((x[i].dot(x[i]) + v[i].dot(v[i])).is_finite());
    }
    sound
}

/// Turns forces into accelerations; the pinned node has none.
#[inline(always)]
fn accelerate<R: Real>(rod: &Rod<R>, a: &mut [Vec2<R>]) {
    a[0] = Vec2::zero();
    for i in 1..a.len() {
        a[i] = a[i].scale(rod.inverse_mass[i]);
    }
}

/// n/|e| of the first edge, by the same operations as in the sweep over all edges.
#[inline(always)]
fn base_gradient<R: Real>(x: &[Vec2<R>]) -> Vec2<R> {
    let e = x[1] - x[0];
    let inverse = R::one() / e.dot(e).sqrt();
    e.scale(inverse).perp().scale(inverse)
}
