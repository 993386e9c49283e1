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
use crate::lane::Real;

/// Kinetic energy of the water along an edge \[J\]: `m l (wa^2 + wa wb + wb^2) / 6`.
#[inline(always)]
pub fn energy<R: Real>(added_mass: R, edge: &EdgeMotion<R>) -> R {
    let [wa, wb] = edge.w;
    added_mass * edge.length * (wa * wa + wa * wb + wb * wb) * R::splat(1.0 / 6.0)
}

/// Normal momentum of the water that belongs to the first and second node \[kg m/s\]:
/// `m l (2 wa + wb) / 6` and `m l (wa + 2 wb) / 6`.
#[inline(always)]
pub fn momentum<R: Real>(added_mass: R, edge: &EdgeMotion<R>) -> [R; 2] {
    let [wa, wb] = edge.w;
    let share = added_mass * edge.length * R::splat(1.0 / 6.0);
    [share * (wa + wa + wb), share * (wa + wb + wb)]
}

/// `dT_f/dq` on the second node, along `t` and `n` \[N\]; the first node gets the opposite.
#[inline(always)]
pub fn gradient<R: Real>(added_mass: R, edge: &EdgeMotion<R>) -> [R; 2] {
    let ([ua, ub], [wa, wb]) = (edge.u, edge.w);
    let sixth = added_mass * R::splat(1.0 / 6.0);
    let along = sixth * (wa * wa + wa * wb + wb * wb);
    let across = -(sixth * ((wa + wa + wb) * ua + (wa + wb + wb) * ub));
    [along, across]
}

/// Momentum that flows off the last node, `G = m (u w n - w^2 t / 2)` along `t` and `n` \[N\].
#[inline(always)]
pub fn tail_flux<R: Real>(added_mass: R, edge: &EdgeMotion<R>) -> [R; 2] {
    let (u, w) = (edge.u[1], edge.w[1]);
    [-(R::splat(0.5) * added_mass * w * w), added_mass * u * w]
}

/// Adds `rate p_f - dT_f/dq` and its derivatives: what the added mass contributes to the residual of
/// an implicit step whose time derivative is `rate (p_f - earlier momentum)`.
#[inline(always)]
pub fn add_inertia<R: Real>(added_mass: R, rate: R, edge: &EdgeMotion<R>, out: &mut EdgeLinear<R>) {
    let ([ua, ub], [wa, wb]) = (edge.u, edge.w);
    let p = momentum(added_mass, edge);
    let [along, across] = gradient(added_mass, edge);
    out.force[0] += along;
    out.force[1] += rate * p[0] + across;
    out.force[2] += -along;
    out.force[3] += rate * p[1] - across;

    let sixth = added_mass * R::splat(1.0 / 6.0);
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

/// Adds `-G` and its derivatives, on the last edge.
#[inline(always)]
pub fn add_tail_flux<R: Real>(added_mass: R, edge: &EdgeMotion<R>, out: &mut EdgeLinear<R>) {
    let [along, across] = tail_flux(added_mass, edge);
    out.force[2] += -along;
    out.force[3] += -across;
    out.by_w[1][2] += added_mass * edge.w[1];
    out.by_u[1][3] += -(added_mass * edge.w[1]);
    out.by_w[1][3] += -(added_mass * edge.u[1]);
}
