//! How rods move under a torque.

use super::angles::sin_cos;
use super::inertia::{factor, solve};
use super::{Coordinates, Feel, ORDER, Rods, State};
use rodgym_core::lane::Real;

impl<R: Real> Rods<R> {
    /// Accelerations of the coordinates under a base torque \[N m\].
    #[inline(always)]
    pub fn acceleration(&self, x: &State<R>, torque: R, feel: &Feel<R>) -> Coordinates<R> {
        let zero = R::zero();
        let l = self.edge;
        let stiffness = self.stiffness * feel.stiffness;
        let last = self.shape.len() - 1;
        let mut inertia = [[zero; ORDER]; ORDER];
        let mut force = [zero; ORDER];
        let (mut jx, mut jy) = ([zero; ORDER], [zero; ORDER]);
        let (mut vx, mut vy, mut ax, mut ay) = (zero, zero, zero, zero);
        let mut before = (zero, zero, zero);
        for (i, row) in self.shape.iter().enumerate() {
            let (angle, rate) = at(row, x);
            let (sin, cos) = sin_cos(angle);
            let (lc, ls) = (l * cos, l * sin);
            for j in 0..ORDER {
                jx[j] += lc * R::splat(row[j]);
                jy[j] += ls * R::splat(row[j]);
            }
            vx += lc * rate;
            vy += ls * rate;
            ax += -(ls * rate * rate);
            ay += lc * rate * rate;
            let mass = R::splat(if i == last { 0.5 } else { 1.0 });
            let fx = -(mass * ax) - self.drag * vx;
            let fy = -(mass * (ay + self.gravity)) - self.drag * vy;
            for a in 0..ORDER {
                force[a] += jx[a] * fx + jy[a] * fy;
                let (mx, my) = (mass * jx[a], mass * jy[a]);
                for b in 0..=a {
                    inertia[a][b] += mx * jx[b] + my * jy[b];
                }
            }
            if i > 0 {
                let curvature = curvature(before, (sin, cos));
                let moment = stiffness
                    * (curvature * (R::one() + R::splat(0.25) * curvature * curvature)
                        + self.beta * (rate - before.2));
                for j in 0..ORDER {
                    force[j] += -(moment * R::splat(row[j] - self.shape[i - 1][j]));
                }
            }
            before = (sin, cos, rate);
        }
        let push = torque * self.mobility * feel.mobility;
        for j in 0..ORDER {
            force[j] += R::splat(self.shape[0][j]) * push;
        }
        factor(self.coordinates, &mut inertia);
        solve(&inertia, &mut force);
        force
    }

    /// One step of the classical Runge-Kutta method under a held torque.
    #[inline(always)]
    pub fn step(&self, x: &mut State<R>, torque: R, feel: &Feel<R>, dt: f64) {
        let start = *x;
        let mut at = start;
        for (weight, ahead) in [(1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)] {
            let a = self.acceleration(&at, torque, feel);
            let (weight, ahead) = (R::splat(dt / 6.0 * weight), R::splat(dt * ahead));
            for i in 0..ORDER {
                let rate = at[ORDER + i];
                x[i] += weight * rate;
                at[i] = start[i] + ahead * rate;
                x[ORDER + i] += weight * a[i];
                at[ORDER + i] = start[ORDER + i] + ahead * a[i];
            }
        }
    }
}

/// Angle and rate of an edge.
#[inline(always)]
pub fn at<R: Real>(row: &Coordinates<f64>, x: &State<R>) -> (R, R) {
    let (mut angle, mut rate) = (R::zero(), R::zero());
    for j in 0..ORDER {
        angle += R::splat(row[j]) * x[j];
        rate += R::splat(row[j]) * x[ORDER + j];
    }
    (angle, rate)
}

/// Curvature 2 tan(turn / 2) between an edge and the next, from their sines and cosines.
#[inline(always)]
pub fn curvature<R: Real>(before: (R, R, R), (sin, cos): (R, R)) -> R {
    let cross = before.1 * sin - before.0 * cos;
    (cross + cross) / (R::one() + before.1 * cos + before.0 * sin)
}
