//! The linear motion of a fin about the moments of a tape: what derivatives are carried by.
//!
//! A stage of an implicit step comes to positions `x = x* + u` and velocities `v = rate u`. So every map that the balance
//! of forces makes of the motion has two derivatives: `of_start`, by x* alone, which leaves the velocities as they are, and
//! `of_move`, by u, which velocities follow. Newton's matrix is the second one of the residual. Both are made of the same
//! terms of force (`EdgeLinear`, `add_stiffness`).

use crate::fin::Body;
use crate::fluid::Water;
use crate::fluid::edge::{EdgeLinear, EdgeMotion};
use crate::fluid::terms::{Gather, Kind, Term};
use crate::lane::{Kernel, Lanewise, Real, Zero};
use crate::lanewise;
use crate::linear::Banded;
use crate::rod::{Rod, add_stiffness};
use crate::vec2::Vec2;

/// A map's derivatives by x* and by u.
#[derive(Clone, Debug)]
pub(super) struct Pair<T> {
    pub of_start: T,
    pub of_move: T,
}

impl<R: Real, T: Lanewise<R>> Lanewise<R> for Pair<T> {
    type Of<S: Real> = Pair<T::Of<S>>;

    #[inline(always)]
    fn visit<F: FnMut(&R) + ?Sized>(&self, f: &mut F) {
        self.of_start.visit(f);
        self.of_move.visit(f);
    }
    #[inline(always)]
    fn visit_mut<F: FnMut(&mut R) + ?Sized>(&mut self, f: &mut F) {
        self.of_start.visit_mut(f);
        self.of_move.visit_mut(f);
    }
    #[inline(always)]
    fn pair<S: Real, F: FnMut(&mut R, &S) + ?Sized>(&mut self, other: &Self::Of<S>, f: &mut F) {
        self.of_start.pair(&other.of_start, f);
        self.of_move.pair(&other.of_move, f);
    }
}

/// The maps of one moment, or of one in every lane. For the way back they are transposed.
#[derive(Clone, Debug)]
pub(super) struct Maps<R> {
    /// Of the residual on every node.
    pub residual: Pair<Banded<R>>,
    /// Of the water's momentum.
    pub momentum: Pair<Banded<R>>,
    /// Of resistive and shed thrust: rows.
    pub resistance: Pair<Vec<Vec2<R>>>,
    pub shed: Pair<Vec<Vec2<R>>>,
    /// Newton's matrix with the driven edge held, eliminated.
    pub eliminated: Banded<R>,
    /// The hull's balance by u: a row.
    pub hull: Vec<Vec2<R>>,
    /// What u follows a move of the driven edge along x; on the way back what the matrix solves for `hull`.
    pub surge: Vec<Vec2<R>>,
    /// One over what the hull's balance changes by such a move.
    pub inverse: R,
}

lanewise!(Maps: residual, momentum, resistance, shed, eliminated, hull, surge, inverse);

impl<R: Real> Maps<R> {
    fn new(nodes: usize) -> Self {
        let matrix = || Banded::new(nodes);
        let matrices = || Pair { of_start: matrix(), of_move: matrix() };
        let row = || vec![Vec2::zero(); nodes];
        let rows = || Pair { of_start: row(), of_move: row() };
        Maps {
            residual: matrices(),
            momentum: matrices(),
            resistance: rows(),
            shed: rows(),
            eliminated: matrix(),
            hull: row(),
            surge: row(),
            inverse: R::zero(),
        }
    }

    #[inline(always)]
    fn clear(&mut self) {
        for pair in [&mut self.residual, &mut self.momentum] {
            pair.of_start.clear();
            pair.of_move.clear();
        }
        for pair in [&mut self.resistance, &mut self.shed] {
            pair.of_start.fill(Vec2::zero());
            pair.of_move.fill(Vec2::zero());
        }
        self.surge.fill(Vec2::zero());
    }
}

/// Gathers what the water adds to the maps.
struct Slopes<'a, R> {
    rate: R,
    maps: &'a mut Maps<R>,
    /// Of the edge: of the residual, of the momentum, of resistive and of shed thrust.
    edge: [EdgeLinear<R>; 4],
}

impl<R: Real> Gather<R> for Slopes<'_, R> {
    #[inline(always)]
    fn open(&mut self) {
        self.edge = Zero::zeros();
    }
    #[inline(always)]
    fn add<T: Term<R>>(&mut self, _k: usize, edge: &EdgeMotion<R>, term: &T) {
        let [residual, momentum, resistance, shed] = &mut self.edge;
        term.add_linear(self.rate, edge, residual);
        match T::KIND {
            Kind::AddedMass => {
                // With the rate of the momentum less without it.
                term.add_linear(R::one(), edge, momentum);
                let mut rest = EdgeLinear::default();
                term.add_linear(R::zero(), edge, &mut rest);
                momentum.pair(&rest, &mut |all: &mut R, rest| *all -= *rest);
            }
            Kind::Resistance => {
                term.add_linear(self.rate, edge, resistance);
                shed.copy_from(resistance);
            }
            Kind::TailFlux => term.add_linear(self.rate, edge, shed),
        }
    }
    #[inline(always)]
    fn close(&mut self, k: usize, edge: &EdgeMotion<R>) {
        let Maps { residual, momentum, resistance, shed, .. } = &mut *self.maps;
        // (One loop, so that the derivative of an edge is compiled once.)
        for which in 0..8 {
            let (map, of_move) = (which / 2, which % 2 == 1);
            let rate = if of_move { self.rate } else { R::zero() };
            let blocks = self.edge[map].jacobian(edge, rate);
            if map < 2 {
                let pair = if map == 0 { &mut *residual } else { &mut *momentum };
                let matrix = if of_move { &mut pair.of_move } else { &mut pair.of_start };
                for i in 0..2 {
                    for j in 0..2 {
                        matrix.add_block(k + i, k + j, blocks[i][j]);
                    }
                }
                continue;
            }
            let pair = if map == 2 { &mut *resistance } else { &mut *shed };
            let row = if of_move { &mut pair.of_move } else { &mut pair.of_start };
            for j in 0..2 {
                // Thrust is against x, and so are these forces.
                let [x, y] = [0, 1].map(|c| blocks[0][j][0][c] + blocks[1][j][0][c]);
                row[k + j] += Vec2::new(x, y);
            }
        }
    }
}

/// The maps about moments: looked at in lanes, as many moments at once, and then picked one by one.
pub(super) struct Linear<'a, R> {
    body: &'a Body<f64>,
    transposed: bool,
    rod: Rod<R>,
    water: Water<R>,
    x: Vec<Vec2<R>>,
    v: Vec<Vec2<R>>,
    in_lanes: Maps<R>,
    /// The moment that was picked.
    pub maps: Maps<f64>,
}

impl<'a, R: Real> Linear<'a, R> {
    /// About moments of this fin, whose own motion does not matter.
    pub fn new(body: &'a Body<f64>, transposed: bool) -> Self {
        let nodes = body.nodes();
        let (mut rod, mut water) = (Rod::new(nodes), Water::default());
        rod.pair(&body.rod, &mut |to: &mut R, from| *to = R::splat(*from));
        water.pair(&body.water, &mut |to: &mut R, from| *to = R::splat(*from));
        let zeros = || vec![Vec2::zero(); nodes];
        let (in_lanes, maps) = (Maps::new(nodes), Maps::new(nodes));
        Linear { body, transposed, rod, water, x: zeros(), v: zeros(), in_lanes, maps }
    }

    /// Looks at moments, one a lane: positions and velocities, and the rate at which these follow those.
    pub fn look<'b>(&mut self, moment: impl Fn(usize) -> (&'b [Vec2<f64>], &'b [Vec2<f64>], f64)) {
        let mut rate = R::zero();
        for lane in 0..R::LANES {
            let (x, v, own) = moment(lane);
            for i in 0..x.len() {
                self.x[i].set_lane(lane, &x[i]);
                self.v[i].set_lane(lane, &v[i]);
            }
            rate.set(lane, own);
        }
        R::run(Look { linear: self, rate });
    }

    /// Turns to the moment in one lane.
    #[inline(always)]
    pub fn pick(&mut self, lane: usize) {
        self.in_lanes.read_lane(lane, &mut self.maps);
    }
}

/// Makes the maps, in lanes. (A kernel of its own, so that it is compiled once.)
struct Look<'a, 'b, R> {
    linear: &'a mut Linear<'b, R>,
    rate: R,
}

impl<R: Real> Kernel for Look<'_, '_, R> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Look { linear, rate } = self;
        let Linear { body, transposed, rod, water, x, v, in_lanes: maps, .. } = linear;
        maps.clear();
        let Pair { of_start, of_move } = &mut maps.residual;
        for (matrix, rate) in [(of_start, R::zero()), (of_move, rate)] {
            add_stiffness(rod, x, v, R::zero(), rate, 0, matrix);
            for i in 0..x.len() {
                let inertia = rod.mass[i] * rate * rate;
                matrix.add_block(i, i, [[inertia, R::zero()], [R::zero(), inertia]]);
            }
        }
        let design = &body.design;
        let mut slopes = Slopes { rate, maps, edge: Zero::zeros() };
        water.act(design.hydrodynamics, &body.perimeter, x, v, &mut slopes);
        let Maps { residual, momentum, eliminated, hull, surge, inverse, .. } = maps;
        let pivot = design.geometry.pivot;
        let (p, d) = (2 * pivot, 2 * pivot + 2);
        let matrix = &residual.of_move;
        eliminated.copy_from(matrix);
        eliminated.hold(pivot);
        eliminated.hold(pivot + 1);
        if *transposed {
            eliminated.transpose();
        }
        eliminated.factor();
        if design.free_swimming {
            for j in 0..x.len() {
                let row = |column: usize| matrix.get(p, column) + matrix.get(d, column);
                hull[j] = Vec2::new(row(2 * j), row(2 * j + 1));
            }
            let inertia = R::splat(body.hull_mass) * rate;
            let drag = R::splat(2.0 * body.hull_drag) * v[pivot].x.abs();
            hull[pivot].x += (inertia + drag) * rate;
            if *transposed {
                surge.copy_from_slice(hull);
            } else {
                (surge[pivot].x, surge[pivot + 1].x) = (R::one(), R::one());
            }
            eliminated.solve(surge);
            let mut change = surge[pivot].x + surge[pivot + 1].x;
            if !*transposed {
                change = R::zero();
                for (row, column) in hull.iter().zip(&*surge) {
                    change += row.dot(*column);
                }
            }
            *inverse = R::one() / change;
        }
        if *transposed {
            for pair in [residual, momentum] {
                pair.of_start.transpose();
                pair.of_move.transpose();
            }
        }
    }
}
