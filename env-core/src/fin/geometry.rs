//! Shape of the fin: the section at each node (thesis Table 3.1), and the rod that it makes.

use super::parameters::{Parameters, WATER_DENSITY};
use crate::error::{Error, Result};
use crate::fluid::Water;
use crate::lane::Real;
use crate::rod::Rod;

/// Allowed thickness of a node \[m\].
const WIDTH: (f64, f64) = (1e-5, 1.0);
/// Allowed area of a section \[m^2\].
const AREA: (f64, f64) = (1e-7, 1.0);
/// Allowed factors of a stiffness profile.
const STIFFNESS: (f64, f64) = (1e-3, 1e3);

/// Sections of a straight fin whose nodes are evenly spaced, nose first.
#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    /// Rest length of every edge \[m\].
    pub edge_length: f64,
    /// Height of the fin, out of the plane of motion \[m\].
    pub height: f64,
    /// Index of the node about which the fin is pitched; the edge behind it follows the drive.
    pub pivot: usize,
    /// Thickness at each node \[m\].
    pub widths: Vec<f64>,
    /// Area of the section at each node \[m^2\].
    pub areas: Vec<f64>,
    /// Young's modulus at each node as a multiple of the fin's: a stiffness profile.
    pub stiffness: Vec<f64>,
}

impl Default for Geometry {
    fn default() -> Self {
        Geometry::thesis()
    }
}

impl Geometry {
    /// The silicone fin of Table 3.1: eight nodes 20 mm apart, 115 mm high, pitched at its third node.
    ///
    /// The table's areas are kept for mass and stretching although they are not exactly height times
    /// width; its second moments are not ((h w)^3/12, see docs/physics.md).
    pub fn thesis() -> Self {
        let millimetres = [0.0, 18.5, 18.5, 16.8, 13.4, 9.9, 3.6, 0.0];
        let square_millimetres = [0.0, 2133.0, 2133.0, 1933.0, 1544.0, 1144.0, 414.0, 0.0];
        Geometry {
            edge_length: 0.020,
            height: 0.115,
            pivot: 2,
            widths: millimetres.iter().map(|w| w * 1e-3).collect(),
            areas: square_millimetres.iter().map(|a| a * 1e-6).collect(),
            stiffness: vec![1.0; 8],
        }
    }

    /// The same outline with its thickness and area interpolated linearly on edges `parts` times shorter.
    ///
    /// # Errors
    /// `parts` of 0.
    pub fn refined(&self, parts: usize) -> Result<Self> {
        if parts == 0 {
            return Err(Error::parameter("parts", parts, "1 or more"));
        }
        let fine = |coarse: &[f64]| -> Vec<f64> {
            let between = |k: usize, j: usize| {
                let s = j as f64 / parts as f64;
                (1.0 - s) * coarse[k] + s * coarse[k + 1]
            };
            let inner = (0..coarse.len() - 1).flat_map(|k| (0..parts).map(move |j| (k, j)));
            let mut values: Vec<f64> = inner.map(|(k, j)| between(k, j)).collect();
            values.push(coarse[coarse.len() - 1]);
            values
        };
        Ok(Geometry {
            edge_length: self.edge_length / parts as f64,
            height: self.height,
            pivot: self.pivot * parts,
            widths: fine(&self.widths),
            areas: fine(&self.areas),
            stiffness: fine(&self.stiffness),
        })
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.widths.len()
    }

    /// Length from nose to tail \[m\].
    pub fn length(&self) -> f64 {
        self.edge_length * (self.nodes() - 1) as f64
    }

    /// Length from the pivot to the tail \[m\].
    pub fn tail_length(&self) -> f64 {
        self.edge_length * (self.nodes() - 1 - self.pivot) as f64
    }

    /// Area of the section of each edge \[m^2\] (thesis 2.7).
    pub fn edge_areas(&self) -> impl Iterator<Item = f64> {
        self.areas.windows(2).map(|a| 0.5 * (a[0] + a[1]))
    }

    /// Wetted perimeter of the section of each edge \[m\]: both sides and both thicknesses.
    pub fn perimeters(&self) -> impl Iterator<Item = f64> {
        self.widths.windows(2).map(|w| 2.0 * (self.height + 0.5 * (w[0] + w[1])))
    }

    /// Second moment of area at each node, `h w^3 / 12` \[m^4\] (thesis 2.8 corrected).
    pub fn second_moments(&self) -> impl Iterator<Item = f64> {
        self.widths.iter().map(|w| self.height * w * w * w / 12.0)
    }

    /// Refuses what is not a fin.
    ///
    /// # Errors
    /// Sizes that are not positive and finite, fewer than four nodes, columns of different lengths, a
    /// pivot without a free edge behind its driven one, thicknesses and areas of no fin (the ends may be pointed),
    /// a stiffness profile beyond a thousandfold.
    pub fn check(&self) -> Result<()> {
        for (name, value) in [("edge_length", self.edge_length), ("height", self.height)] {
            if !(value.is_finite() && value > 0.0) {
                let name = format!("geometry['{name}']");
                return Err(Error::parameter(name, value, "positive and finite"));
            }
        }
        let n = self.nodes();
        if !(4..=1001).contains(&n) {
            return Err(Error::Shape {
                name: "geometry['widths']".into(),
                got: format!("({n},)"),
                expected: "(n,), one value a node, with n from 4 to 1001".into(),
            });
        }
        if self.pivot + 3 > n {
            let allowed =
                format!("at most {}, so that a free edge is behind the driven one", n - 3);
            return Err(Error::parameter("geometry['pivot']", self.pivot, allowed));
        }
        for (name, column) in
            [("geometry['areas']", &self.areas), ("stiffness_profile", &self.stiffness)]
        {
            if column.len() != n {
                return Err(Error::Shape {
                    name: name.into(),
                    got: format!("({},)", column.len()),
                    expected: format!("({n},), one value a node"),
                });
            }
        }
        let columns = [
            ("geometry['widths']", &self.widths, WIDTH, "m"),
            ("geometry['areas']", &self.areas, AREA, "m^2"),
            ("stiffness_profile", &self.stiffness, STIFFNESS, "times youngs_modulus"),
        ];
        for (name, column, (low, high), unit) in columns {
            for (i, value) in column.iter().enumerate() {
                let pointed =
                    (i == 0 || i + 1 == n) && *value == 0.0 && name != "stiffness_profile";
                if !(pointed || (low..=high).contains(value)) {
                    let ends = if name == "stiffness_profile" { "" } else { ", or 0 at the ends" };
                    let allowed = format!("from {low} to {high} {unit}{ends}");
                    return Err(Error::parameter(format!("{name}[{i}]"), value, allowed));
                }
            }
        }
        Ok(())
    }

    /// Coefficients of the water about a fin of this shape.
    pub fn water<R: Real>(&self, parameters: &Parameters<R>) -> Water<R> {
        let h = self.height;
        let plate = WATER_DENSITY * std::f64::consts::PI * h * h / 4.0;
        let pressure = R::splat(0.5 * WATER_DENSITY);
        Water {
            added_mass: parameters.added_mass_coefficient * R::splat(plate),
            drag: pressure * parameters.drag_coefficient * R::splat(h),
            friction: pressure * parameters.friction_coefficient,
            flow_speed: parameters.flow_speed,
        }
    }

    /// The discrete rod of this shape: masses (thesis 2.4, 2.5), stretching stiffness on the edges,
    /// bending stiffness at the nodes. No gravity: the fin's height is vertical.
    pub fn rod<R: Real>(&self, parameters: &Parameters<R>) -> Rod<R> {
        let mut rod = Rod::new(self.nodes());
        self.shape(parameters, &mut rod);
        rod
    }

    /// Overwrites rods of the same number of nodes; no memory is taken.
    pub fn shape<R: Real>(&self, parameters: &Parameters<R>, rod: &mut Rod<R>) {
        let (l, half) = (R::splat(self.edge_length), R::splat(0.5));
        let e = parameters.youngs_modulus;
        rod.mass[0] = R::zero();
        for (k, area) in self.edge_areas().enumerate() {
            let area = R::splat(area);
            let stretch = half * e * R::splat(self.stiffness[k] + self.stiffness[k + 1]) * area;
            rod.rest[k] = l;
            rod.stretch[k] = stretch;
            rod.stretch_rate[k] = stretch / l;
            let mass = half * (parameters.density * area * l);
            rod.mass[k] += mass;
            rod.mass[k + 1] = mass;
        }
        for (i, moment) in self.second_moments().enumerate() {
            let inner = i > 0 && i + 1 < self.nodes();
            let bend = e * R::splat(self.stiffness[i]) * R::splat(moment) / l;
            rod.bend[i] = if inner { bend } else { R::zero() };
            rod.bend_damping[i] = rod.bend[i] * parameters.bending_damping;
            rod.inverse_mass[i] = R::one() / rod.mass[i];
        }
        rod.damping = parameters.damping;
    }
}
