//! The base torque of an implicit step: held constant, or a linear law of the new state.

use crate::lane::Real;
use crate::vec2::Vec2;
use std::f64::consts::{PI, TAU};

/// A base torque that may depend on the positions and velocities at the end of the step.
pub trait Drive<R: Real> {
    /// Whether the torque depends on the state at all.
    const FEEDBACK: bool;

    /// Torque \[N m\] at positions `x` and velocities `v`.
    fn torque(&self, x: &[Vec2<R>], v: &[Vec2<R>]) -> R;
    /// Total derivative of the torque by the positions, velocities following at `rate` = dv/dx \[1/s\].
    fn gradient(&self, x: &[Vec2<R>], v: &[Vec2<R>], rate: R, gradient: &mut [Vec2<R>]);
}

/// A constant torque \[N m\].
#[derive(Clone, Copy, Debug)]
pub struct Constant<R>(pub R);

impl<R: Real> Drive<R> for Constant<R> {
    const FEEDBACK: bool = false;

    #[inline(always)]
    fn torque(&self, _x: &[Vec2<R>], _v: &[Vec2<R>]) -> R {
        self.0
    }
    #[inline(always)]
    fn gradient(&self, _x: &[Vec2<R>], _v: &[Vec2<R>], _rate: R, _gradient: &mut [Vec2<R>]) {}
}

/// The thesis' state feedback, `T = constant + gain . z`, with `z = (theta - pi, theta')` of every edge
/// and the angles wrapped to (-pi, pi] (thesis 4.9, 4.13).
#[derive(Clone, Debug)]
pub struct Feedback {
    /// Part that does not depend on the state \[N m\].
    pub constant: f64,
    /// Gains on the angles \[N m/rad\], then on the rates \[N m s/rad\]: twice the number of edges.
    pub gain: Vec<f64>,
}

/// Angle of an edge from upright, in (-pi, pi], and its rate \[rad, rad/s\].
#[inline(always)]
fn edge_state<R: Real>(e: Vec2<R>, de: Vec2<R>) -> (R, R) {
    let angle = e.x.atan2(-e.y) - R::splat(PI);
    let inside = R::splat(-PI).lt(angle);
    (R::select(inside, angle, angle + R::splat(TAU)), e.cross(de) / e.dot(e))
}

impl<R: Real> Drive<R> for Feedback {
    const FEEDBACK: bool = true;

    #[inline(always)]
    fn torque(&self, x: &[Vec2<R>], v: &[Vec2<R>]) -> R {
        let edges = x.len() - 1;
        let mut sum = R::splat(self.constant);
        for k in 0..edges {
            let (angle, rate) = edge_state(x[k + 1] - x[k], v[k + 1] - v[k]);
            sum += R::splat(self.gain[k]) * angle + R::splat(self.gain[edges + k]) * rate;
        }
        sum
    }

    #[inline(always)]
    fn gradient(&self, x: &[Vec2<R>], v: &[Vec2<R>], rate: R, gradient: &mut [Vec2<R>]) {
        let edges = x.len() - 1;
        gradient.fill(Vec2::zero());
        for k in 0..edges {
            let (e, de) = (x[k + 1] - x[k], v[k + 1] - v[k]);
            let inverse = R::one() / e.dot(e);
            let slope = e.perp().scale(inverse);
            // rate of turn = slope . de; slope itself turns with e: d(e x de / |e|^2)/de
            let turn = e.cross(de) / e.dot(e);
            let turn = (-de.perp() - e.scale(turn + turn)).scale(inverse);
            let (on_angle, on_rate) = (R::splat(self.gain[k]), R::splat(self.gain[edges + k]));
            let by_edge = slope.scale(on_angle + on_rate * rate) + turn.scale(on_rate);
            gradient[k + 1] += by_edge;
            gradient[k] -= by_edge;
        }
    }
}
