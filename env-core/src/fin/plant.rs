//! The fin in its water, in lanes: what it is made of and how it moves now.

use super::geometry::Geometry;
use super::parameters::{Parameters, WATER_DENSITY};
use super::step::Workspace;
use crate::error::{Error, Result};
use crate::fluid::terms::Momentum;
use crate::fluid::{Hydrodynamics, Water};
use crate::lane::{Lanewise, Real};
use crate::lanewise;
use crate::rod::Rod;
use crate::solver::{Past, Scheme, Solver};
use crate::vec2::Vec2;
use std::sync::Arc;

/// What is the same for every fin of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// Shape.
    pub geometry: Geometry,
    /// Forces of the water.
    pub hydrodynamics: Hydrodynamics,
    /// Time stepping.
    pub scheme: Scheme,
    /// Duration of a physics step \[s\].
    pub physics_dt: f64,
    /// Whether the pivot is free along x and pushes a hull, instead of being held.
    pub free_swimming: bool,
}

impl Design {
    /// Refuses what cannot be stepped.
    ///
    /// # Errors
    /// A bad geometry, an explicit scheme, or a step that is not in (0, 0.04] seconds.
    pub fn check(&self) -> Result<()> {
        self.geometry.check()?;
        if !(self.physics_dt > 0.0 && self.physics_dt <= 0.04) {
            return Err(Error::parameter("physics_dt", self.physics_dt, "in (0, 0.04] s"));
        }
        if self.scheme.table().is_none() {
            let allowed = "implicit: the added mass is heavier than the fin";
            return Err(Error::parameter("stepper", self.scheme.name(), allowed));
        }
        Ok(())
    }
}

/// One vector a node.
type Vectors = Vec<Vec2<f64>>;

impl Design {
    /// Takes positions \[m\] and velocities \[m/s\] of the nodes as vectors.
    ///
    /// # Errors
    /// Wrong shapes or numbers that are not finite.
    pub fn check_nodes(&self, x: &[[f64; 2]], v: &[[f64; 2]]) -> Result<(Vectors, Vectors)> {
        let nodes = self.geometry.nodes();
        for (name, array) in [("positions", x), ("velocities", v)] {
            if array.len() != nodes {
                let (got, expected) = (format!("({}, 2)", array.len()), format!("({nodes}, 2)"));
                return Err(Error::Shape { name: name.into(), got, expected });
            }
            if let Some(bad) = array.iter().flatten().find(|value| !value.is_finite()) {
                return Err(Error::parameter(name, bad, "finite"));
            }
        }
        let vectors = |a: &[[f64; 2]]| a.iter().map(|p| Vec2::new(p[0], p[1])).collect();
        Ok((vectors(x), vectors(v)))
    }

    /// The same for a motion that the drive can hold, with the pitch of its driven edge \[rad\].
    ///
    /// # Errors
    /// Beside those of `check_nodes`: two nodes in one place, a pivot away from the origin (unless swimming
    /// freely, along y = 0), or a driven edge whose length is off the rest length by more than 1e-6 of it.
    pub fn check_motion(&self, x: &[[f64; 2]], v: &[[f64; 2]]) -> Result<(Vectors, Vectors, f64)> {
        let (x, v) = self.check_nodes(x, v)?;
        let (pivot, driven) = (x[self.geometry.pivot], x[self.geometry.pivot + 1]);
        if pivot.y != 0.0 || (pivot.x != 0.0 && !self.free_swimming) {
            let allowed =
                if self.free_swimming { "on y = 0" } else { "the origin, where it is held" };
            let name = format!("positions[{}]", self.geometry.pivot);
            return Err(Error::parameter(name, format!("({}, {})", pivot.x, pivot.y), allowed));
        }
        if x.windows(2).any(|pair| (pair[1] - pair[0]).dot(pair[1] - pair[0]) == 0.0) {
            return Err(Error::parameter("positions", "two neighbours in one place", "distinct"));
        }
        let edge = driven - pivot;
        let length = libm::hypot(edge.x, edge.y);
        if (length / self.geometry.edge_length - 1.0).abs() > 1e-6 {
            let allowed = format!("{} m, the rest length", self.geometry.edge_length);
            return Err(Error::parameter("length of the driven edge", length, allowed));
        }
        Ok((x, v, libm::atan2(edge.y, edge.x)))
    }
}

/// Positions, velocities and water momentum of all nodes at one instant.
#[derive(Clone, Debug, Default)]
pub struct Instant<R> {
    /// Positions \[m\].
    pub x: Vec<Vec2<R>>,
    /// Velocities \[m/s\].
    pub v: Vec<Vec2<R>>,
    /// Momentum of the water that moves with each node, p_f \[kg m/s\].
    pub p: Vec<Vec2<R>>,
}

lanewise!(Instant: x, v, p);

impl<R: Real> Instant<R> {
    /// Memory for `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        let zeros = || vec![Vec2::zero(); nodes];
        Instant { x: zeros(), v: zeros(), p: zeros() }
    }
}

/// Forces and power at the end of a physics step, or their means over several.
#[derive(Clone, Copy, Debug, Default)]
pub struct Loads<R> {
    /// Force of the water on the fin along -x, momentum of the moved water included \[N\].
    pub thrust: R,
    /// The part that cannot be taken back: momentum shed at the tail and resistive forces, along -x \[N\].
    pub shed_thrust: R,
    /// The resistive part alone, along -x \[N\].
    pub resistive_thrust: R,
    /// Force of the fin on its mount along -x \[N\]: what a load cell shows.
    pub mount_thrust: R,
    /// Torque of the servo about the pivot, counter-clockwise \[N m\].
    pub torque: R,
    /// Power of the servo \[W\].
    pub power: R,
    /// Power of the servo where it is positive, else 0 \[W\].
    pub positive_power: R,
}

lanewise!(Loads: thrust, shed_thrust, resistive_thrust, mount_thrust, torque, power, positive_power);

impl<R: Real> Loads<R> {
    /// Adds `weight` times other loads.
    #[inline(always)]
    pub fn add(&mut self, weight: R, other: &Loads<R>) {
        self.pair(other, &mut |sum, load| *sum += weight * *load);
    }
}

/// One fin, or several side by side.
#[derive(Clone, Debug)]
pub struct Plant<R: Real> {
    /// What all lanes share.
    pub design: Arc<Design>,
    /// Material, water and hull, as an episode has them.
    pub parameters: Parameters<R>,
    /// Masses and stiffness.
    pub rod: Rod<R>,
    /// Coefficients of the water.
    pub water: Water<R>,
    /// Wetted perimeter of each edge \[m\].
    pub perimeter: Arc<[f64]>,
    /// Mass of the hull \[kg\].
    pub hull_mass: R,
    /// `rho_f C_D S / 2` of the hull \[kg/m\].
    pub hull_drag: R,
    /// The motion now.
    pub now: Instant<R>,
    /// The motion one physics step earlier.
    pub past: Past<R, Instant<R>>,
    /// Pitch of the driven edge \[rad\].
    pub pitch: R,
    /// Forces at the end of the last physics step.
    pub loads: Loads<R>,
    pub(super) solver: Solver<R::Mask, Instant<R>>,
    pub(super) work: Workspace<R>,
}

lanewise!(Plant: parameters, rod, water, hull_mass, hull_drag, now, past, pitch, loads);

impl<R: Real> Plant<R> {
    /// Fins of this design, straight and at rest, with the default parameters in every lane.
    ///
    /// # Errors
    /// Those of `Design::check`.
    pub fn new(design: Design) -> Result<Self> {
        design.check()?;
        let nodes = design.geometry.nodes();
        let (scheme, dt) = (design.scheme, design.physics_dt);
        let table = scheme.table().expect("checked: it is an implicit one");
        let perimeter = design.geometry.perimeters().collect();
        let mut plant = Plant {
            design: Arc::new(design),
            parameters: Parameters::default(),
            rod: Rod::new(nodes),
            water: Water::default(),
            perimeter,
            hull_mass: R::one(),
            hull_drag: R::zero(),
            now: Instant::new(nodes),
            past: Past::new(scheme, |kept| Instant::new(if kept { nodes } else { 0 })),
            pitch: R::zero(),
            loads: Loads::default(),
            solver: Solver::new(table, dt, || Instant::new(nodes)),
            work: Workspace::new(nodes),
        };
        for lane in 0..R::LANES {
            plant.begin(lane, &Parameters::default(), 0.0);
        }
        Ok(plant)
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.now.x.len()
    }

    /// Puts new parameters into one lane; the motion stays.
    pub fn set_parameters(&mut self, lane: usize, parameters: &Parameters) {
        self.parameters.set_lane(lane, parameters);
        self.shape();
    }

    /// Makes rod, water and hull as the parameters say.
    fn shape(&mut self) {
        self.design.geometry.shape(&self.parameters, &mut self.rod);
        self.water = self.parameters.water(&self.design.geometry);
        if self.design.free_swimming {
            // A free swimmer moves through water at rest.
            self.water.flow_speed = R::zero();
        }
        self.hull_mass = self.parameters.hull_mass;
        self.hull_drag = R::splat(0.5 * WATER_DENSITY) * self.parameters.hull_drag_area;
    }

    /// Begins an episode in one lane: a straight fin at rest at this pitch \[rad\].
    pub fn begin(&mut self, lane: usize, parameters: &Parameters, pitch: f64) {
        self.set_parameters(lane, parameters);
        let geometry = &self.design.geometry;
        let (sine, cosine) = (libm::sin(pitch), libm::cos(pitch));
        let place = |i: usize| {
            let s = (i as f64 - geometry.pivot as f64) * geometry.edge_length;
            Vec2::new(s * cosine, s * sine)
        };
        for i in 0..self.now.x.len() {
            self.now.x[i].set_lane(lane, &place(i));
            self.now.v[i].set_lane(lane, &Vec2::zero());
        }
        self.settle(lane, pitch);
    }

    /// Puts a motion into one lane, as if the fin had just been placed there.
    pub fn set_motion(
        &mut self,
        lane: usize,
        positions: &[Vec2<f64>],
        velocities: &[Vec2<f64>],
        pitch: f64,
    ) {
        for i in 0..positions.len() {
            self.now.x[i].set_lane(lane, &positions[i]);
            self.now.v[i].set_lane(lane, &velocities[i]);
        }
        self.settle(lane, pitch);
    }

    /// After a lane's fin was moved by hand: the water's momentum follows, what was before is forgotten.
    fn settle(&mut self, lane: usize, pitch: f64) {
        let mut momentum = std::mem::take(&mut self.work.momentum);
        momentum.fill(Vec2::zero());
        self.body().gather_water(&self.now.x, &self.now.v, &mut Momentum(&mut momentum));
        for (p, q) in self.now.p.iter_mut().zip(&momentum) {
            p.set_lane(lane, &q.lane(lane));
        }
        self.work.momentum = momentum;
        self.past.forget(lane, &self.now);
        self.pitch.set(lane, pitch);
        self.loads.visit_mut(&mut |x| x.set(lane, 0.0));
    }

    /// Copies one lane out.
    pub fn lane(&self, lane: usize) -> Plant<f64> {
        let design = Design::clone(&self.design);
        let mut one = Plant::new(design).expect("checked when this plant was made");
        self.read_lane(lane, &mut one);
        one
    }
}
