//! The balance of forces on every node at the end of an implicit step, and its exact derivative.

use super::design::Design;
use super::motion::{Instant, Loads};
use crate::fluid::Water;
use crate::fluid::edge::{EdgeLinear, EdgeMotion};
use crate::fluid::terms::{Gather, Kind, Term};
use crate::lane::Real;
use crate::linear::Banded;
use crate::rod::{Rod, add_stiffness, forces};
use crate::vec2::Vec2;

/// Gathers the water's part of the residual and of its derivative.
struct Linearization<'a, R> {
    rate: R,
    edge: EdgeLinear<R>,
    residual: &'a mut [Vec2<R>],
    matrix: &'a mut Banded<R>,
}

impl<R: Real> Gather<R> for Linearization<'_, R> {
    #[inline(always)]
    fn open(&mut self) {
        self.edge = EdgeLinear::default();
    }
    #[inline(always)]
    fn add<T: Term<R>>(&mut self, _k: usize, edge: &EdgeMotion<R>, term: &T) {
        term.add_linear(self.rate, edge, &mut self.edge);
    }
    #[inline(always)]
    fn close(&mut self, k: usize, edge: &EdgeMotion<R>) {
        let [first, second] = edge.forces_to_world(&self.edge.force);
        self.residual[k] += first;
        self.residual[k + 1] += second;
        let blocks = self.edge.jacobian(edge, self.rate);
        for i in 0..2 {
            for j in 0..2 {
                self.matrix.add_block(k + i, k + j, blocks[i][j]);
            }
        }
    }
}

/// Gathers the water's part of the residual, its momentum and the loads.
struct Balance<'a, R> {
    rate: R,
    residual: &'a mut [Vec2<R>],
    momentum: &'a mut [Vec2<R>],
    loads: Loads<R>,
}

impl<R: Real> Gather<R> for Balance<'_, R> {
    #[inline(always)]
    fn add<T: Term<R>>(&mut self, k: usize, edge: &EdgeMotion<R>, term: &T) {
        let [first, second] = edge.forces_to_world(&term.force(edge));
        if T::KIND == Kind::AddedMass {
            let p = term.momentum(edge);
            let (p0, p1) = (edge.to_world(R::zero(), p[0]), edge.to_world(R::zero(), p[1]));
            self.momentum[k] += p0;
            self.momentum[k + 1] += p1;
            self.residual[k] += p0.scale(self.rate) - first;
            self.residual[k + 1] += p1.scale(self.rate) - second;
            return;
        }
        self.residual[k] -= first;
        self.residual[k + 1] -= second;
        let thrust = -(first.x + second.x);
        if T::KIND == Kind::Resistance {
            self.loads.resistive_thrust += thrust;
        } else {
            self.loads.shed_thrust += thrust;
        }
    }
}

/// What the balance of forces is made of.
pub(super) struct Elements<'a, R> {
    pub(super) design: &'a Design,
    pub(super) rod: &'a Rod<R>,
    pub(super) water: &'a Water<R>,
    pub(super) perimeter: &'a [f64],
    pub(super) hull_mass: R,
    pub(super) hull_drag: R,
}

impl<R: Real> Elements<'_, R> {
    /// Lets the water act on a fin in this motion.
    #[inline(always)]
    pub(super) fn gather_water<G: Gather<R>>(&self, x: &[Vec2<R>], v: &[Vec2<R>], gather: &mut G) {
        self.water.act(self.design.hydrodynamics, self.perimeter, x, v, gather);
    }

    /// What the drive must add at each node,
    /// `M (v - v*)/h - F_elastic - F_damping + (p_f - p_f*)/h - dT_f/dq - G - F_resistive`,
    /// where the starred quantities are the earlier state and `rate = 1/h`; and its derivative by the
    /// positions, `v` following them as `(x - x*)/h`.
    #[inline(always)]
    pub(super) fn linearize(
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
        add_stiffness(self.rod, x, v, R::zero(), rate, 0, matrix);
        let rate2 = rate * rate;
        for i in 0..nodes {
            let inertia = self.rod.mass[i] * rate2;
            matrix.add_block(i, i, [[inertia, R::zero()], [R::zero(), inertia]]);
        }
        let edge = EdgeLinear::default();
        self.gather_water(x, v, &mut Linearization { rate, edge, residual, matrix });
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
        self.structure(star, rate, &at.x, &at.v, residual);
        at.p.fill(Vec2::zero());
        let momentum = &mut at.p[..];
        let mut balance = Balance { rate, residual, momentum, loads: Loads::default() };
        self.gather_water(&at.x, &at.v, &mut balance);
        let mut loads = balance.loads;
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
        forces(self.rod, x, v, residual);
        for i in 0..x.len() {
            let impulse = (v[i] - star.v[i]).scale(self.rod.mass[i]) - star.p[i];
            residual[i] = impulse.scale(rate) - residual[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fin::{Body, Geometry, Parameters, Scheme};
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
            let mut body = Body::<f64>::new(design).expect("allowed");
            let parameters =
                Parameters { bending_damping: 3e-3, damping: 0.2, ..Default::default() };
            body.set_parameters(0, &parameters);
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
                body.elements().linearize(&star, rate, x, &v, &mut residual, matrix);
                let mut whole = Instant { x: x.to_vec(), v, p: vec![Vec2::zero(); 8] };
                let mut again = residual.clone();
                body.elements().balance(&star, rate, &mut whole, &mut again);
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
