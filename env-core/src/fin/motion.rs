//! How a fin moves at one instant, and what it bears.

use crate::lane::{Lanewise, Real};
use crate::lanewise;
use crate::vec2::Vec2;
use crate::zeros;

/// Positions, velocities and water momentum of all nodes at one instant.
#[derive(Clone, Debug, Default)]
pub struct Instant<R> {
    /// Positions \[m\].
    pub x: Vec<Vec2<R>>,
    /// Velocities \[m/s\].
    pub v: Vec<Vec2<R>>,
    /// Momentum of the water that moves with each node, p_f \[kg m/s\].
    pub p: Vec<Vec2<R>>,
}

lanewise!(Instant: x, v, p);

impl<R: Real> Instant<R> {
    /// Memory for `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        let zeros = || vec![Vec2::zero(); nodes];
        Instant { x: zeros(), v: zeros(), p: zeros() }
    }
}

/// Forces and power at the end of a physics step, or their means over several.
#[derive(Clone, Copy, Debug)]
pub struct Loads<R> {
    /// Force of the water on the fin along -x, momentum of the moved water included \[N\].
    pub thrust: R,
    /// The part that cannot be taken back: momentum shed at the tail and resistive forces, along -x \[N\].
    pub shed_thrust: R,
    /// The resistive part alone, along -x \[N\].
    pub resistive_thrust: R,
    /// Force of the fin on its mount along -x \[N\]: what a load cell shows.
    pub mount_thrust: R,
    /// Torque of the servo about the pivot, counter-clockwise \[N m\].
    pub torque: R,
    /// Power of the servo \[W\].
    pub power: R,
    /// Power of the servo where it is positive, else 0 \[W\].
    pub positive_power: R,
}

zeros!(Loads: thrust, shed_thrust, resistive_thrust, mount_thrust, torque, power, positive_power);

lanewise!(Loads: thrust, shed_thrust, resistive_thrust, mount_thrust, torque, power, positive_power);

impl<R: Real> Loads<R> {
    /// Adds `weight` times other loads.
    #[inline(always)]
    pub fn add(&mut self, weight: R, other: &Loads<R>) {
        self.pair(other, &mut |sum, load| *sum += weight * *load);
    }
}
