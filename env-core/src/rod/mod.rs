//! A planar discrete elastic rod (thesis 2.1, with the errata of `docs/physics.md`): nodes joined by
//! edges that stretch, and turning angles between edges that bend.
//!
//! Node i has position x_i; edge k joins nodes k and k+1, `e = x_{k+1} - x_k`, unit tangent t, normal n
//! (t turned left). The turning angle at an inner node is phi, the signed angle from the edge before to the
//! edge after; the curvature is `kappa = 2 tan(phi/2)`, so that a rod cannot fold flat at finite energy.

mod energy;
mod forces;
mod linear;
mod slopes;

pub use energy::{Energy, curvature, energy};
pub use forces::{Shape, forces};
pub use linear::{Linearized, add_stiffness, linearize};
pub use slopes::{EdgeSlopes, force_changes, force_gradients};

use crate::lane::Real;
use crate::lanewise;
use crate::vec2::Vec2;

/// Geometry, section and material of a rod, one value a lane.
///
/// Lengths of the vectors: nodes N, edges N-1. Bending belongs to inner nodes; the entries of both ends are 0.
#[derive(Clone, Debug, Default)]
pub struct Rod<R> {
    /// Rest length of each edge \[m\].
    pub rest: Vec<R>,
    /// Stretching stiffness EA of each edge \[N\].
    pub stretch: Vec<R>,
    /// EA over rest length of each edge \[N/m\].
    pub stretch_rate: Vec<R>,
    /// Bending stiffness EI/l at each node \[N m\].
    pub bend: Vec<R>,
    /// Kelvin-Voigt bending damping (EI/l) beta at each node \[N m s\].
    pub bend_damping: Vec<R>,
    /// Mass of each node \[kg\].
    pub mass: Vec<R>,
    /// One over the mass of each node \[1/kg\].
    pub inverse_mass: Vec<R>,
    /// Nodal damping zeta: force -zeta v at each node \[kg/s\].
    pub damping: R,
    /// Gravity along -E2 \[m/s^2\].
    pub gravity: R,
}

lanewise!(Rod: rest, stretch, stretch_rate, bend, bend_damping, mass, inverse_mass, damping, gravity);

impl<R: Real> Rod<R> {
    /// Memory for a rod of `nodes` nodes, to be filled lane by lane with `set_lane`.
    pub fn new(nodes: usize) -> Self {
        let per_node = || vec![R::zero(); nodes];
        let per_edge = || vec![R::zero(); nodes - 1];
        Rod {
            rest: per_edge(),
            stretch: per_edge(),
            stretch_rate: per_edge(),
            bend: per_node(),
            bend_damping: per_node(),
            mass: per_node(),
            inverse_mass: per_node(),
            damping: R::zero(),
            gravity: R::zero(),
        }
    }

    /// Number of nodes.
    #[inline(always)]
    pub fn nodes(&self) -> usize {
        self.mass.len()
    }
}

/// A uniform rod of square section (thesis 2.4, 2.5, Table 4.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uniform<R = f64> {
    /// Number of nodes.
    pub nodes: usize,
    /// Total length \[m\].
    pub length: R,
    /// Side of the square section \[m\].
    pub width: R,
    /// Density \[kg/m^3\].
    pub density: R,
    /// Young's modulus \[Pa\].
    pub youngs_modulus: R,
    /// Nodal damping zeta \[kg/s\].
    pub damping: R,
    /// Bending damping beta \[s\].
    pub bending_damping: R,
    /// Gravity along -E2 \[m/s^2\].
    pub gravity: R,
}

impl<R: Real> Uniform<R> {
    /// Rest length of an edge \[m\].
    pub fn edge(&self) -> R {
        self.length / R::splat((self.nodes - 1) as f64)
    }
    /// Area of the section \[m^2\].
    pub fn area(&self) -> R {
        self.width * self.width
    }
    /// Second moment of area w^4/12 \[m^4\] (thesis 2.8, corrected).
    pub fn second_moment(&self) -> R {
        self.area() * self.area() / R::splat(12.0)
    }
    /// Mass of an inner node \[kg\]; the end nodes have half of it.
    pub fn node_mass(&self) -> R {
        self.density * self.area() * self.edge()
    }

    /// The discrete rod.
    pub fn rod(&self) -> Rod<R> {
        let mut rod = Rod::new(self.nodes);
        self.shape(&mut rod);
        rod
    }

    /// Overwrites rods of the same number of nodes; no memory is taken.
    pub fn shape(&self, rod: &mut Rod<R>) {
        let (edge, mass) = (self.edge(), self.node_mass());
        let stretch = self.youngs_modulus * self.area();
        let bend = self.youngs_modulus * self.second_moment() / edge;
        rod.rest.fill(edge);
        rod.stretch.fill(stretch);
        rod.stretch_rate.fill(stretch / edge);
        for i in 1..self.nodes - 1 {
            rod.bend[i] = bend;
            rod.bend_damping[i] = bend * self.bending_damping;
        }
        for i in 0..self.nodes {
            let end = i == 0 || i == self.nodes - 1;
            rod.mass[i] = if end { R::splat(0.5) * mass } else { mass };
            rod.inverse_mass[i] = R::one() / rod.mass[i];
        }
        rod.damping = self.damping;
        rod.gravity = self.gravity;
    }

    /// Largest step for which velocity Verlet is stable about the straight rod \[s\].
    ///
    /// With the velocity of the half step in the damping forces, a mode of frequency w and damping rate d
    /// (force -d v/m) is stable while `w^2 dt^2 + 2 d dt < 4`. The highest stretching mode has
    /// `w = 2 sqrt(E/rho)/l`, the highest bending mode `w = 4/l^2 sqrt(EI/(rho A))`; the light
    /// end node takes part in neither alone.
    pub fn verlet_limit(&self) -> R {
        let (two, four) = (R::splat(2.0), R::splat(4.0));
        let edge = self.edge();
        let speed2 = self.youngs_modulus / self.density;
        let stretch2 = four * speed2 / (edge * edge);
        let gyration2 = self.second_moment() / self.area();
        let bend2 = R::splat(16.0) * speed2 * gyration2 / (edge * edge * edge * edge);
        // The end nodes carry half the mass, so nodal damping counts double there.
        let nodal = two * self.damping / self.node_mass();
        // Positive root of w2 dt^2 + 2 d dt - 4 = 0, in the form that does not cancel.
        let limit = |w2: R, d: R| four / (d + (d * d + four * w2).sqrt());
        limit(stretch2, nodal).min(limit(bend2, nodal + self.bending_damping * bend2))
    }
}

/// Positions and velocities of a rod's nodes.
#[derive(Clone, Debug, Default)]
pub struct Motion<R> {
    /// Positions \[m\].
    pub x: Vec<Vec2<R>>,
    /// Velocities \[m/s\].
    pub v: Vec<Vec2<R>>,
    /// What the stepper carries to the next step \[m/s^2\]: for Verlet the acceleration without the base
    /// torque, for the implicit steppers that of the last stage (TR-BDF2 and ESDIRK3 keep what of it is due to the
    /// base torque in the place of the pinned node).
    pub a: Vec<Vec2<R>>,
    /// The acceleration of the stage before, for the implicit steppers \[m/s^2\].
    pub a_before: Vec<Vec2<R>>,
}

lanewise!(Motion: x, v, a, a_before);

impl<R: Real> Motion<R> {
    /// Memory for `nodes` nodes, all at the origin and at rest.
    pub fn new(nodes: usize) -> Self {
        let zeros = || vec![Vec2::zero(); nodes];
        Motion { x: zeros(), v: zeros(), a: zeros(), a_before: zeros() }
    }
}
