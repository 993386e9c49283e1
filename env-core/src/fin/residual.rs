//! The balance of forces on every node at the end of an implicit step, and its exact derivative.

use super::plant::{Instant, Loads, Plant};
use crate::fluid::edge::{EdgeLinear, EdgeMotion};
use crate::fluid::{reactive, resistive};
use crate::lane::Real;
use crate::linear::Banded;
use crate::rod::{add_stiffness, forces};
use crate::vec2::Vec2;

impl<R: Real> Plant<R> {
    /// Motion of edge `k` relative to the water.
    #[inline(always)]
    pub(super) fn edge(&self, k: usize, x: &[Vec2<R>], v: &[Vec2<R>]) -> EdgeMotion<R> {
        let relative = |i: usize| self.water.relative(v[i]);
        EdgeMotion::new(x[k], x[k + 1], relative(k), relative(k + 1))
    }

    /// Friction coefficient of edge `k`, perimeter included \[kg/m^2\].
    #[inline(always)]
    pub(super) fn friction(&self, k: usize) -> R {
        self.water.friction * R::splat(self.perimeter[k])
    }

    /// Momentum of the water that moves with each node, p_f \[kg m/s\].
    #[inline(always)]
    pub(super) fn water_momentum(&self, x: &[Vec2<R>], v: &[Vec2<R>], out: &mut [Vec2<R>]) {
        out.fill(Vec2::zero());
        if self.design.hydrodynamics.has_added_mass() {
            for k in 0..x.len() - 1 {
                let edge = self.edge(k, x, v);
                let p = reactive::momentum(self.water.added_mass, &edge);
                out[k] += edge.to_world(R::zero(), p[0]);
                out[k + 1] += edge.to_world(R::zero(), p[1]);
            }
        }
    }

    /// What the drive must add at each node,
    /// `M (v - v*)/h - F_elastic - F_damping + (p_f - p_f*)/h - dT_f/dq - G - F_resistive`,
    /// where the starred quantities are the earlier state and `rate = 1/h`; and its derivative by the
    /// positions, `v` following them as `(x - x*)/h`.
    #[inline(always)]
    pub(super) fn linearise(
        &self,
        star: &Instant<R>,
        rate: R,
        x: &[Vec2<R>],
        v: &[Vec2<R>],
        residual: &mut [Vec2<R>],
        matrix: &mut Banded<R>,
    ) {
        let nodes = x.len();
        self.structure(star, rate, x, v, residual);
        matrix.clear();
        add_stiffness(&self.rod, x, v, R::zero(), rate, 0, matrix);
        let rate2 = rate * rate;
        for i in 0..nodes {
            let inertia = self.rod.mass[i] * rate2;
            matrix.add_block(i, i, [[inertia, R::zero()], [R::zero(), inertia]]);
        }
        let model = self.design.hydrodynamics;
        if !model.has_resistance() {
            return;
        }
        for k in 0..nodes - 1 {
            let edge = self.edge(k, x, v);
            let mut linear = EdgeLinear::default();
            resistive::add_resistance(self.water.drag, self.friction(k), &edge, &mut linear);
            if model.has_added_mass() {
                reactive::add_inertia(self.water.added_mass, rate, &edge, &mut linear);
            }
            if model.has_tail_flux() && k + 2 == nodes {
                reactive::add_tail_flux(self.water.added_mass, &edge, &mut linear);
            }
            let [first, second] = edge.forces_to_world(&linear.force);
            residual[k] += first;
            residual[k + 1] += second;
            let blocks = linear.jacobian(&edge, rate);
            for i in 0..2 {
                for j in 0..2 {
                    matrix.add_block(k + i, k + j, blocks[i][j]);
                }
            }
        }
    }

    /// The same residual without derivative, the water's momentum, and the loads (without those of the
    /// mount and the servo, which `step` reads from the residual).
    #[inline(always)]
    pub(super) fn balance(
        &self,
        star: &Instant<R>,
        rate: R,
        at: &mut Instant<R>,
        residual: &mut [Vec2<R>],
    ) -> Loads<R> {
        let nodes = at.x.len();
        let mut loads = Loads::default();
        self.structure(star, rate, &at.x, &at.v, residual);
        at.p.fill(Vec2::zero());
        let model = self.design.hydrodynamics;
        if !model.has_resistance() {
            return loads;
        }
        for k in 0..nodes - 1 {
            let edge = self.edge(k, &at.x, &at.v);
            let water = resistive::force(self.water.drag, self.friction(k), &edge);
            let [first, second] = edge.forces_to_world(&water);
            loads.resistive_thrust += -(first.x + second.x);
            residual[k] -= first;
            residual[k + 1] -= second;
            if model.has_added_mass() {
                let p = reactive::momentum(self.water.added_mass, &edge);
                let [along, across] = reactive::gradient(self.water.added_mass, &edge);
                let gradient = edge.to_world(along, across);
                let (p0, p1) = (edge.to_world(R::zero(), p[0]), edge.to_world(R::zero(), p[1]));
                at.p[k] += p0;
                at.p[k + 1] += p1;
                residual[k] += p0.scale(rate) + gradient;
                residual[k + 1] += p1.scale(rate) - gradient;
            }
            if model.has_tail_flux() && k + 2 == nodes {
                let [along, across] = reactive::tail_flux(self.water.added_mass, &edge);
                let flux = edge.to_world(along, across);
                residual[k + 1] -= flux;
                loads.shed_thrust += -flux.x;
            }
        }
        loads.shed_thrust += loads.resistive_thrust;
        loads.thrust = loads.shed_thrust;
        for (p, p0) in at.p.iter().zip(&star.p) {
            loads.thrust += rate * (p.x - p0.x);
        }
        loads
    }

    /// The part of the residual that needs no look at the water now.
    #[inline(always)]
    fn structure(
        &self,
        star: &Instant<R>,
        rate: R,
        x: &[Vec2<R>],
        v: &[Vec2<R>],
        residual: &mut [Vec2<R>],
    ) {
        forces(&self.rod, x, v, residual);
        for i in 0..x.len() {
            let impulse = (v[i] - star.v[i]).scale(self.rod.mass[i]) - star.p[i];
            residual[i] = impulse.scale(rate) - residual[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fin::plant::{Design, Scheme};
    use crate::fin::{Geometry, Parameters};
    use crate::fluid::Hydrodynamics;
    use crate::seed::Stream;

    /// Newton's matrix is the derivative of the residual, column by column, for every model of the water.
    #[test]
    fn matrix_is_the_derivative_of_the_residual() {
        for (name, hydrodynamics) in Hydrodynamics::NAMES {
            let design = Design {
                geometry: Geometry::thesis(),
                hydrodynamics,
                scheme: Scheme::Bdf2,
                physics_dt: 1e-3,
                free_swimming: false,
            };
            let mut plant = Plant::<f64>::new(design).expect("allowed");
            let parameters =
                Parameters { bending_damping: 3e-3, damping: 0.2, ..Default::default() };
            plant.set_parameters(0, &parameters);
            let mut stream = Stream::new(7);
            let (mut at, mut star) = (Instant::new(8), Instant::new(8));
            let mut draw =
                |size: f64| Vec2::new(stream.uniform(-size, size), stream.uniform(-size, size));
            let rate = 700.0;
            for i in 0..8 {
                at.x[i] = Vec2::new(0.02 * (i as f64 - 2.0), 0.0) + draw(4e-3);
                star.x[i] = at.x[i] - draw(4e-4);
                (star.v[i], star.p[i]) = (draw(0.3), draw(0.01));
            }
            let evaluate = |x: &[Vec2<f64>], matrix: &mut Banded<f64>| {
                let v: Vec<_> = (0..8).map(|i| (x[i] - star.x[i]).scale(rate)).collect();
                let mut residual = vec![Vec2::zero(); 8];
                plant.linearise(&star, rate, x, &v, &mut residual, matrix);
                let mut whole = Instant { x: x.to_vec(), v, p: vec![Vec2::zero(); 8] };
                let mut again = residual.clone();
                plant.balance(&star, rate, &mut whole, &mut again);
                for (a, b) in residual.iter().zip(&again) {
                    let gap = (a.x - b.x).abs() + (a.y - b.y).abs();
                    assert!(gap < 1e-9, "{name}: the two residuals differ by {gap}");
                }
                residual
            };
            let (mut matrix, mut scratch) = (Banded::new(8), Banded::new(8));
            evaluate(&at.x, &mut matrix);
            for j in 0..16 {
                let mut shifted = |step: f64| {
                    let mut x = at.x.clone();
                    if j % 2 == 0 {
                        x[j / 2].x += step
                    } else {
                        x[j / 2].y += step
                    }
                    evaluate(&x, &mut scratch)
                };
                let h = 1e-7;
                let (above, below) = (shifted(h), shifted(-h));
                for i in 0..16 {
                    let part = |r: &[Vec2<f64>]| if i % 2 == 0 { r[i / 2].x } else { r[i / 2].y };
                    let slope = (part(&above) - part(&below)) / (2.0 * h);
                    let error = (matrix.get(i, j) - slope).abs();
                    let scale = matrix.get(i, i).abs() + matrix.get(j, j).abs();
                    assert!(
                        error < 1e-6 * scale,
                        "{name} ({i}, {j}): {} {slope}",
                        matrix.get(i, j)
                    );
                }
            }
        }
    }
}
