//! The fin in its water, in lanes: what it is made of and how it moves now.

use super::design::Design;
use super::motion::{Instant, Loads};
use super::parameters::{Parameters, WATER_DENSITY};
use super::residual::Elements;
use super::workspace::Workspace;
use crate::error::Result;
use crate::fluid::Water;
use crate::fluid::terms::Momentum;
use crate::lane::{Lanewise, Real};
use crate::lanewise;
use crate::rod::Rod;
use crate::solver::{Past, Solver};
use crate::vec2::Vec2;
use std::sync::Arc;

/// One fin, or several side by side.
#[derive(Clone, Debug)]
pub struct Body<R: Real> {
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

lanewise!(Body: parameters, rod, water, hull_mass, hull_drag, now, past, pitch, loads);

impl<R: Real> Body<R> {
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
        let mut body = Body {
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
            body.begin(lane, &Parameters::default(), 0.0);
        }
        Ok(body)
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
    pub(super) fn shape(&mut self) {
        self.design.geometry.shape(&self.parameters, &mut self.rod);
        self.water = self.design.geometry.water(&self.parameters);
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
        self.elements().gather_water(&self.now.x, &self.now.v, &mut Momentum(&mut momentum));
        for (p, q) in self.now.p.iter_mut().zip(&momentum) {
            p.set_lane(lane, &q.lane(lane));
        }
        self.work.momentum = momentum;
        self.past.forget(lane, &self.now);
        self.pitch.set(lane, pitch);
        self.loads.visit_mut(&mut |x| x.set(lane, 0.0));
    }

    /// What the balance of forces is made of.
    pub(super) fn elements(&self) -> Elements<'_, R> {
        let Body { design, rod, water, perimeter, hull_mass, hull_drag, .. } = self;
        let (hull_mass, hull_drag) = (*hull_mass, *hull_drag);
        Elements { design, rod, water, perimeter, hull_mass, hull_drag }
    }

    /// Copies one lane out.
    pub fn lane(&self, lane: usize) -> Body<f64> {
        let design = Design::clone(&self.design);
        let mut one = Body::new(design).expect("checked when this body was made");
        self.read_lane(lane, &mut one);
        one
    }
}
