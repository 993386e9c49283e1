//! The rods that a controller believes possible.
//!
//! A base that is turned feels two numbers of a rod: its stiffness over its mass (the frequencies) and its mass
//! (the torque that an acceleration takes). Young's modulus, width and density act through these two alone, so
//! that is what is learned; both are logarithms here, relative to a rod in the middle.

use super::RodDesign;
use crate::error::Result;
use rodgym_core::draw::Draw;
use rodgym_core::pendulum::PARAMETERS;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Factors of stiffness over mass that are believed possible where an environment draws nothing: those of a
/// modulus of 0.5 to 1.6 times the nominal, and of a width a quarter off.
const STIFFNESS: (f64, f64) = (0.5, 1.8);
/// The same for the mass: a width a quarter off.
const MASS: (f64, f64) = (0.56, 1.7);
/// A range of logarithms that is no wider than this is known.
const KNOWN: f64 = 0.01;

/// Where rods may be: a box about a rod in its middle.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Prior {
    /// The rod in the middle.
    pub middle: RodDesign,
    /// How far the logarithms of stiffness over mass, and of mass, may be off, either way.
    pub reach: [f64; 2],
    /// Whether the density is among what is not known, so that width and modulus cannot be told.
    pub any_density: bool,
}

impl Prior {
    /// The rods that an environment draws by `randomize`; where it draws none, those about its one.
    ///
    /// Of what is drawn beside modulus, width and density the middle is taken for true.
    ///
    /// # Errors
    /// A `randomize` that no environment has, or a rod that is not allowed.
    pub fn from_config(config: &Map<String, Value>) -> Result<Self> {
        let nothing = Value::Object(Map::new());
        let randomize = config.get("randomize").unwrap_or(&nothing);
        let mut given = config.clone();
        let mut ranges = [0.0; 3];
        for (row, draw) in Draw::ranges(randomize, PARAMETERS)? {
            let (low, high) = draw.bounds();
            let name = PARAMETERS[row].name;
            let log = low > 0.0;
            let middle = if log { libm::sqrt(low * high) } else { 0.5 * (low + high) };
            given.insert(name.into(), middle.into());
            let unknown = ["youngs_modulus", "width", "density"].iter().position(|n| *n == name);
            if let Some(i) = unknown {
                ranges[i] = libm::log(high / low);
            }
        }
        let middle = RodDesign::from_config(&given)?;
        let [modulus, width, density] = ranges;
        if ranges == [0.0; 3] {
            return Ok(Prior::about(&middle));
        }
        // Stiffness over mass is E w^2 / rho, mass rho w^2.
        let reach = [0.5 * (modulus + 2.0 * width + density), 0.5 * (density + 2.0 * width)];
        Ok(Prior { middle, reach, any_density: density > KNOWN })
    }

    /// The rods that are usual about a nominal one.
    fn about(nominal: &RodDesign) -> Self {
        let middle = |(low, high): (f64, f64)| 0.5 * libm::log(low * high);
        let reach = |(low, high): (f64, f64)| 0.5 * libm::log(high / low);
        Prior {
            middle: rod(nominal, [middle(STIFFNESS), middle(MASS)]),
            reach: [reach(STIFFNESS), reach(MASS)],
            any_density: false,
        }
    }

    /// Which of the two numbers are not known.
    pub fn unknown(&self) -> [bool; 2] {
        self.reach.map(|reach| reach > KNOWN)
    }

    /// The rod at a place of the box.
    pub fn rod(&self, place: [f64; 2]) -> RodDesign {
        rod(&self.middle, place)
    }
}

/// A rod whose stiffness over mass and mass are other than those of a given one, by width and modulus.
fn rod(middle: &RodDesign, [stiffness, mass]: [f64; 2]) -> RodDesign {
    RodDesign {
        width: middle.width * libm::exp(0.5 * mass),
        youngs_modulus: middle.youngs_modulus * libm::exp(stiffness - mass),
        ..middle.clone()
    }
}

#[cfg(test)]
mod tests {
    //! What is believed possible is what the environment says.

    use super::*;
    use serde_json::json;

    fn prior(config: Value) -> Prior {
        Prior::from_config(config.as_object().unwrap()).unwrap()
    }

    #[test]
    fn rods_that_are_drawn_are_the_prior() {
        let modulus = prior(json!({"randomize": {"youngs_modulus": [7e6, 1.3e7]}}));
        assert_eq!(modulus.unknown(), [true, false]);
        assert!((modulus.middle.youngs_modulus - libm::sqrt(7e6 * 1.3e7)).abs() < 1e-3);
        let ends = [-1.0, 1.0].map(|side| modulus.rod([side * modulus.reach[0], 0.0]));
        assert!((ends[0].youngs_modulus / 7e6 - 1.0).abs() < 1e-12);
        assert!((ends[1].youngs_modulus / 1.3e7 - 1.0).abs() < 1e-12);
        assert!(!modulus.any_density);
        let all = prior(
            json!({"randomize": {"density": ["log_uniform", 1e3, 2e3], "damping": [0.0, 0.1]}}),
        );
        assert!(all.any_density && all.unknown() == [true, true]);
        assert_eq!(all.middle.damping, 0.05);
    }

    #[test]
    fn where_nothing_is_drawn_rods_about_the_nominal_one_are() {
        let about = prior(json!({"width": 0.008}));
        for rod in [
            json!({"width": 0.00605}),
            json!({"width": 0.0104}),
            json!({"width": 0.008, "youngs_modulus": 1.6e7}),
        ] {
            let rod = RodDesign::from_config(rod.as_object().unwrap()).unwrap();
            let mass = |rod: &RodDesign| libm::log(rod.density * rod.width * rod.width);
            let stiffness = |rod: &RodDesign| libm::log(rod.youngs_modulus * rod.width * rod.width);
            assert!((mass(&rod) - mass(&about.middle)).abs() <= about.reach[1] + 0.01);
            assert!((stiffness(&rod) - stiffness(&about.middle)).abs() <= about.reach[0]);
        }
    }
}
