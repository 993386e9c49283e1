//! Reactive forces: the water that moves with the body (Lighthill; thesis 2.19-2.23 with signs and
//! joints corrected).
//!
//! With `T_f` the kinetic energy of the water (normal velocity `w` linear along each edge),
//! `p_f = dT_f/dV` its momentum and `G` what flows off the tail,
//!
//! ```text
//! F_reactive = -d p_f/dt + dT_f/dq + G (last node only)
//! ```
//!
//! Interior boundary terms telescope and the undisturbed water ahead of the nose brings nothing in, so
//! nothing else appears. `V` is velocity relative to the water throughout.

use super::edge::{EdgeLinear, EdgeMotion};
use super::term::{Kind, Term};
use crate::lane::Real;

/// The water that moves with an edge: its mass on a unit of length \[kg/m\].
#[derive(Clone, Copy, Debug)]
pub struct AddedMass<R>(pub R);

impl<R: Real> AddedMass<R> {
    /// `dT_f/dq` on the second node, along `t` and `n` \[N\]; the first node gets the opposite.
    #[inline(always)]
    fn gradient(&self, edge: &EdgeMotion<R>) -> [R; 2] {
        let ([ua, ub], [wa, wb]) = (edge.u, edge.w);
        let sixth = self.0 * R::splat(1.0 / 6.0);
        let along = sixth * (wa * wa + wa * wb + wb * wb);
        let across = -(sixth * ((wa + wa + wb) * ua + (wa + wb + wb) * ub));
        [along, across]
    }
}

impl<R: Real> Term<R> for AddedMass<R> {
    const KIND: Kind = Kind::AddedMass;

    #[inline(always)]
    fn force(&self, edge: &EdgeMotion<R>) -> [R; 4] {
        let [along, across] = self.gradient(edge);
        [-along, -across, along, across]
    }

    /// `m l (2 wa + wb) / 6` and `m l (wa + 2 wb) / 6`.
    #[inline(always)]
    fn momentum(&self, edge: &EdgeMotion<R>) -> [R; 2] {
        let [wa, wb] = edge.w;
        let share = self.0 * edge.length * R::splat(1.0 / 6.0);
        [share * (wa + wa + wb), share * (wa + wb + wb)]
    }

    /// `m l (wa^2 + wa wb + wb^2) / 6`.
    #[inline(always)]
    fn energy(&self, edge: &EdgeMotion<R>) -> R {
        let [wa, wb] = edge.w;
        self.0 * edge.length * (wa * wa + wa * wb + wb * wb) * R::splat(1.0 / 6.0)
    }

    #[inline(always)]
    fn add_linear(&self, rate: R, edge: &EdgeMotion<R>, out: &mut EdgeLinear<R>) {
        let (mass, [ua, ub], [wa, wb]) = (self.0, edge.u, edge.w);
        let p = self.momentum(edge);
        let [along, across] = self.gradient(edge);
        out.force[0] += along;
        out.force[1] += rate * p[0] + across;
        out.force[2] += -along;
        out.force[3] += rate * p[1] - across;

        let sixth = mass * R::splat(1.0 / 6.0);
        let (lean_a, lean_b) = (sixth * (wa + wa + wb), sixth * (wa + wb + wb));
        let (slide_a, slide_b) = (sixth * (ua + ua + ub), sixth * (ua + ub + ub));
        let share = rate * sixth * edge.length;
        let double = share + share;
        out.by_length[1] += rate * lean_a;
        out.by_length[3] += rate * lean_b;
        out.by_u[0][1] += -lean_a;
        out.by_u[0][3] += lean_a;
        out.by_u[1][1] += -lean_b;
        out.by_u[1][3] += lean_b;
        out.by_w[0][0] += lean_a;
        out.by_w[0][1] += double - slide_a;
        out.by_w[0][2] += -lean_a;
        out.by_w[0][3] += share + slide_a;
        out.by_w[1][0] += lean_b;
        out.by_w[1][1] += share - slide_b;
        out.by_w[1][2] += -lean_b;
        out.by_w[1][3] += double + slide_b;
    }
}

/// Momentum that flows off the last node, `G = m (u w n - w^2 t / 2)`: the mass m on a unit of length \[kg/m\].
#[derive(Clone, Copy, Debug)]
pub struct TailFlux<R>(pub R);

impl<R: Real> Term<R> for TailFlux<R> {
    const KIND: Kind = Kind::TailFlux;

    #[inline(always)]
    fn force(&self, edge: &EdgeMotion<R>) -> [R; 4] {
        let (u, w) = (edge.u[1], edge.w[1]);
        [R::zero(), R::zero(), -(R::splat(0.5) * self.0 * w * w), self.0 * u * w]
    }

    #[inline(always)]
    fn add_linear(&self, _rate: R, edge: &EdgeMotion<R>, out: &mut EdgeLinear<R>) {
        let [_, _, along, across] = self.force(edge);
        out.force[2] += -along;
        out.force[3] += -across;
        out.by_w[1][2] += self.0 * edge.w[1];
        out.by_u[1][3] += -(self.0 * edge.w[1]);
        out.by_w[1][3] += -(self.0 * edge.u[1]);
    }
}
