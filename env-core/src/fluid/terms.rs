//! What acts on a body in water: the terms of force, run through edge by edge, and two who gather them.

use super::edge::EdgeMotion;
use super::reactive::{AddedMass, TailFlux};
use super::resistive::Resistance;
pub use super::term::{Gather, Kind, Term};
use super::{Hydrodynamics, Water};
use crate::lane::Real;
use crate::vec2::Vec2;

impl<R: Real> Water<R> {
    /// Lets the water act on a body whose nodes have these positions and velocities; `perimeter` is the wetted one of
    /// each edge \[m\].
    #[inline(always)]
    pub fn act<G: Gather<R>>(
        &self,
        model: Hydrodynamics,
        perimeter: &[f64],
        x: &[Vec2<R>],
        v: &[Vec2<R>],
        gather: &mut G,
    ) {
        if !model.has_resistance() {
            return;
        }
        let edges = x.len() - 1;
        for k in 0..edges {
            let (va, vb) = (self.relative(v[k]), self.relative(v[k + 1]));
            let edge = EdgeMotion::new(x[k], x[k + 1], va, vb);
            gather.open();
            let friction = self.friction * R::splat(perimeter[k]);
            gather.add(k, &edge, &Resistance { drag: self.drag, friction });
            if model.has_added_mass() {
                gather.add(k, &edge, &AddedMass(self.added_mass));
            }
            if model.has_tail_flux() && k + 1 == edges {
                gather.add(k, &edge, &TailFlux(self.added_mass));
            }
            gather.close(k, &edge);
        }
    }
}

/// Gathers the momentum of the water that moves with each node, p_f \[kg m/s\].
pub struct Momentum<'a, R>(pub &'a mut [Vec2<R>]);

impl<R: Real> Gather<R> for Momentum<'_, R> {
    #[inline(always)]
    fn add<T: Term<R>>(&mut self, k: usize, edge: &EdgeMotion<R>, term: &T) {
        if T::KIND == Kind::AddedMass {
            for (end, p) in term.momentum(edge).into_iter().enumerate() {
                self.0[k + end] += edge.to_world(R::zero(), p);
            }
        }
    }
}

/// Gathers everything, each kind apart: forces on the nodes \[N\], the water's momentum \[kg m/s\] and energy \[J\].
#[derive(Clone, Debug)]
pub struct ByKind<R> {
    /// Drag and friction.
    pub resistance: Vec<Vec2<R>>,
    /// `dT_f/dq` of the added mass.
    pub gradient: Vec<Vec2<R>>,
    /// Momentum flux off the last node.
    pub tail_flux: Vec<Vec2<R>>,
    /// Momentum p_f.
    pub momentum: Vec<Vec2<R>>,
    /// Kinetic energy of the moved water.
    pub energy: R,
}

impl<R: Real> ByKind<R> {
    /// Nothing yet, on `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        let zeros = || vec![Vec2::zero(); nodes];
        let (resistance, gradient, tail_flux) = (zeros(), zeros(), zeros());
        ByKind { resistance, gradient, tail_flux, momentum: zeros(), energy: R::zero() }
    }
}

impl<R: Real> Gather<R> for ByKind<R> {
    #[inline(always)]
    fn add<T: Term<R>>(&mut self, k: usize, edge: &EdgeMotion<R>, term: &T) {
        let sum = match T::KIND {
            Kind::Resistance => &mut self.resistance,
            Kind::AddedMass => &mut self.gradient,
            Kind::TailFlux => &mut self.tail_flux,
        };
        for (end, force) in edge.forces_to_world(&term.force(edge)).into_iter().enumerate() {
            sum[k + end] += force;
        }
        Momentum(&mut self.momentum).add(k, edge, term);
        self.energy += term.energy(edge);
    }
}
