//! What all fins of a batch share, and which motions it allows.

use super::geometry::Geometry;
use crate::error::{Error, Result};
use crate::fluid::Hydrodynamics;
use crate::solver::Scheme;
use crate::vec2::Vec2;

/// One vector a node.
type Vectors = Vec<Vec2<f64>>;

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
