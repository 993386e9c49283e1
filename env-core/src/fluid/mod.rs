//! Forces of water on a slender planar body, edge by edge.
//!
//! Reactive forces follow Lighthill's large-amplitude elongated-body theory in a multi-segment form
//! (thesis chapter 2.2, its signs and joints corrected, see docs/physics.md); resistive forces are quadratic drag
//! and friction. Everything is written in the frame of the edge (`edge::EdgeMotion`), where each term
//! is a polynomial in the edge's length and the velocities of its two ends, so that the exact
//! derivatives for Newton's method stay short (`edge::EdgeLinear`).

pub mod edge;
pub mod reactive;
pub mod resistive;
pub mod term;
pub mod terms;

use crate::error::{Error, Result};
use crate::lane::Real;
use crate::lanewise;
use crate::vec2::Vec2;
use serde::{Deserialize, Serialize};

/// Which forces the water exerts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hydrodynamics {
    /// Added mass, momentum shed at the tail, resistive forces: the improved Lighthill model.
    #[default]
    Lighthill,
    /// Added mass and resistive forces; nothing is shed at the tail.
    Morison,
    /// Resistive forces only.
    Resistive,
    /// No fluid.
    Air,
}

impl Hydrodynamics {
    /// Every model with the name that users type.
    pub const NAMES: [(&'static str, Hydrodynamics); 4] = [
        ("lighthill", Hydrodynamics::Lighthill),
        ("morison", Hydrodynamics::Morison),
        ("resistive", Hydrodynamics::Resistive),
        ("air", Hydrodynamics::Air),
    ];

    /// The model of that name.
    ///
    /// # Errors
    /// An unknown name.
    pub fn from_name(name: &str) -> Result<Self> {
        let found = Self::NAMES.iter().find(|(known, _)| *known == name);
        found.map(|&(_, model)| model).ok_or_else(|| {
            let known: Vec<String> = Self::NAMES.iter().map(|(n, _)| format!("'{n}'")).collect();
            Error::parameter(
                "hydrodynamics",
                format!("'{name}'"),
                format!("one of {}", known.join(", ")),
            )
        })
    }

    /// The name that users type.
    pub fn name(self) -> &'static str {
        let found = Self::NAMES.iter().find(|(_, model)| *model == self);
        found.expect("every model is named").0
    }

    /// Whether water is set in motion with the body (added mass).
    pub fn has_added_mass(self) -> bool {
        matches!(self, Hydrodynamics::Lighthill | Hydrodynamics::Morison)
    }

    /// Whether momentum leaves at the tail.
    pub fn has_tail_flux(self) -> bool {
        self == Hydrodynamics::Lighthill
    }

    /// Whether there is drag and friction.
    pub fn has_resistance(self) -> bool {
        self != Hydrodynamics::Air
    }
}

/// Coefficients of the water about a body of uniform height.
#[derive(Clone, Copy, Debug, Default)]
pub struct Water<R> {
    /// Added mass of a unit of length, `m = C_m rho_f pi h^2 / 4` \[kg/m\] (thesis 2.20).
    pub added_mass: R,
    /// `rho_f C_d h / 2` \[kg/m^2\].
    pub drag: R,
    /// `rho_f C_f / 2` \[kg/m^3\]; times the wetted perimeter it multiplies `u |u|`.
    pub friction: R,
    /// Speed of the flow along +x \[m/s\].
    pub flow_speed: R,
}

lanewise!(Water: added_mass, drag, friction, flow_speed);

impl<R: Real> Water<R> {
    /// Velocity relative to the water.
    #[inline(always)]
    pub fn relative(&self, velocity: Vec2<R>) -> Vec2<R> {
        Vec2::new(velocity.x - self.flow_speed, velocity.y)
    }
}
