//! The base torque of an implicit step: held constant, or a linear law of the new state.

use crate::lane::Real;
use crate::vec2::Vec2;
use std::f64::consts::{PI, TAU};

/// A base torque that may depend on the positions and velocities at the end of the step.
pub trait Drive<R: Real> {
    /// Whether the torque depends on the state at all.
    const FEEDBACK: bool;
    /// The same drive for one lane.
    type Lane: Drive<f64>;

    /// Copies one lane out.
    fn lane(&self, lane: usize) -> Self::Lane;
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
    type Lane = Constant<f64>;

    #[inline(always)]
    fn lane(&self, lane: usize) -> Constant<f64> {
        Constant(self.0.get(lane))
    }
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
fn edge_state(e: Vec2<f64>, de: Vec2<f64>) -> (f64, f64) {
    let mut angle = libm::atan2(e.x, -e.y) - PI;
    if angle <= -PI {
        angle += TAU;
    }
    (angle, e.cross(de) / e.dot(e))
}

impl Drive<f64> for Feedback {
    const FEEDBACK: bool = true;
    type Lane = Feedback;

    fn lane(&self, _lane: usize) -> Feedback {
        self.clone()
    }

    fn torque(&self, x: &[Vec2<f64>], v: &[Vec2<f64>]) -> f64 {
        let edges = x.len() - 1;
        let mut sum = self.constant;
        for k in 0..edges {
            let (angle, rate) = edge_state(x[k + 1] - x[k], v[k + 1] - v[k]);
            sum += self.gain[k] * angle + self.gain[edges + k] * rate;
        }
        sum
    }

    fn gradient(&self, x: &[Vec2<f64>], v: &[Vec2<f64>], rate: f64, gradient: &mut [Vec2<f64>]) {
        let edges = x.len() - 1;
        gradient.fill(Vec2::zero());
        for k in 0..edges {
            let (e, de) = (x[k + 1] - x[k], v[k + 1] - v[k]);
            let length2 = e.dot(e);
            let slope = e.perp().scale(1.0 / length2);
            // rate of turn = slope . de; slope itself turns with e: d(e x de / |e|^2)/de
            let turn = (-de.perp() - e.scale(2.0 * e.cross(de) / length2)).scale(1.0 / length2);
            let (on_angle, on_rate) = (self.gain[k], self.gain[edges + k]);
            let by_edge = slope.scale(on_angle + on_rate * rate) + turn.scale(on_rate);
            gradient[k + 1] += by_edge;
            gradient[k] -= by_edge;
        }
    }
}
