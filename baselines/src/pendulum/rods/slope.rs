//! Derivatives of the accelerations: what an extended Kalman filter needs.

use super::angles::sin_cos;
use super::inertia::{factor, solve};
use super::motion::{at, curvature};
use super::{Coordinates, Feel, ORDER, Rods, State};
use rodgym_core::lane::Real;

/// What a state's accelerations depend on: d(accelerations) = `angle` dq + `rate` d(rates) + ...
#[derive(Clone, Copy, Debug)]
pub struct Slope<R> {
    /// By the coordinates.
    pub angle: [Coordinates<R>; ORDER],
    /// By the rates.
    pub rate: [Coordinates<R>; ORDER],
    /// By the logarithm of the stiffness.
    pub stiffness: Coordinates<R>,
    /// By the logarithm of the mobility: the torque's part.
    pub mobility: Coordinates<R>,
}

impl<R: Real> Rods<R> {
    /// How the accelerations depend on state, stiffness and mobility: with a the accelerations of M a = f,
    /// M da = df - dM a.
    #[inline(always)]
    pub fn slope(&self, x: &State<R>, torque: R, feel: &Feel<R>) -> Slope<R> {
        let zero = R::zero();
        let a = self.acceleration(x, torque, feel);
        let l = self.edge;
        let stiffness = self.stiffness * feel.stiffness;
        let last = self.shape.len() - 1;
        let mut inertia = [[zero; ORDER]; ORDER];
        let (mut by_angle, mut by_rate) = ([[zero; ORDER]; ORDER], [[zero; ORDER]; ORDER]);
        let mut bending = [zero; ORDER];
        // Of the current node: position's derivative J and its derivative, force at the accelerations a
        // and the force's derivatives.
        let (mut jx, mut jy) = ([zero; ORDER], [zero; ORDER]);
        let (mut hx, mut hy) = ([[zero; ORDER]; ORDER], [[zero; ORDER]; ORDER]);
        let (mut vx, mut vy, mut ax, mut ay) = (zero, zero, zero, zero);
        let mut vq = [[zero; ORDER]; 2];
        let mut aq = [[zero; ORDER]; 2];
        let mut aw = [[zero; ORDER]; 2];
        let mut before = (zero, zero, zero);
        for (i, row) in self.shape.iter().enumerate() {
            let (angle, rate) = at(row, x);
            let mut acceleration = zero;
            for j in 0..ORDER {
                acceleration += R::splat(row[j]) * a[j];
            }
            let (sin, cos) = sin_cos(angle);
            let (lc, ls) = (l * cos, l * sin);
            let square = rate * rate;
            vx += lc * rate;
            vy += ls * rate;
            ax += lc * acceleration - ls * square;
            ay += ls * acceleration + lc * square;
            let turned = [-(ls * acceleration) - lc * square, lc * acceleration - ls * square];
            let twice = rate + rate;
            for j in 0..ORDER {
                let s = R::splat(row[j]);
                jx[j] += lc * s;
                jy[j] += ls * s;
                vq[0][j] += -(ls * rate * s);
                vq[1][j] += lc * rate * s;
                aq[0][j] += turned[0] * s;
                aq[1][j] += turned[1] * s;
                aw[0][j] += -(ls * twice * s);
                aw[1][j] += lc * twice * s;
                for k in 0..=j {
                    let s = s * R::splat(row[k]);
                    hx[j][k] += -(ls * s);
                    hy[j][k] += lc * s;
                }
            }
            let mass = R::splat(if i == last { 0.5 } else { 1.0 });
            let fx = -(mass * ax) - self.drag * vx;
            let fy = -(mass * (ay + self.gravity)) - self.drag * vy;
            for j in 0..ORDER {
                for k in 0..=j {
                    inertia[j][k] += mass * (jx[j] * jx[k] + jy[j] * jy[k]);
                    let turning = fx * hx[j][k] + fy * hy[j][k];
                    by_angle[j][k] += turning;
                    if k < j {
                        by_angle[k][j] += turning;
                    }
                }
            }
            for k in 0..ORDER {
                let fqx = -(mass * aq[0][k]) - self.drag * vq[0][k];
                let fqy = -(mass * aq[1][k]) - self.drag * vq[1][k];
                let fwx = -(mass * aw[0][k]) - self.drag * jx[k];
                let fwy = -(mass * aw[1][k]) - self.drag * jy[k];
                for j in 0..ORDER {
                    by_angle[j][k] += jx[j] * fqx + jy[j] * fqy;
                    by_rate[j][k] += jx[j] * fwx + jy[j] * fwy;
                }
            }
            if i > 0 {
                let curvature = curvature(before, (sin, cos));
                let quarter = R::splat(0.25) * curvature * curvature;
                let bent = curvature * (R::one() + quarter);
                let moment = stiffness * (bent + self.beta * (rate - before.2));
                let stiff = stiffness * (R::one() + quarter) * (R::one() + R::splat(3.0) * quarter);
                let slow = stiffness * self.beta;
                for j in 0..ORDER {
                    let dj = R::splat(row[j] - self.shape[i - 1][j]);
                    bending[j] += -(moment * dj);
                    for k in 0..ORDER {
                        let d = dj * R::splat(row[k] - self.shape[i - 1][k]);
                        by_angle[j][k] += -(stiff * d);
                        by_rate[j][k] += -(slow * d);
                    }
                }
            }
            before = (sin, cos, rate);
        }
        factor(self.coordinates, &mut inertia);
        let push = torque * self.mobility * feel.mobility;
        let mut pushed = [zero; ORDER];
        for j in 0..ORDER {
            pushed[j] = R::splat(self.shape[0][j]) * push;
        }
        solve(&inertia, &mut bending);
        solve(&inertia, &mut pushed);
        for matrix in [&mut by_angle, &mut by_rate] {
            for k in 0..ORDER {
                let mut column = [zero; ORDER];
                for j in 0..ORDER {
                    column[j] = matrix[j][k];
                }
                solve(&inertia, &mut column);
                for j in 0..ORDER {
                    matrix[j][k] = column[j];
                }
            }
        }
        Slope { angle: by_angle, rate: by_rate, stiffness: bending, mobility: pushed }
    }
}
