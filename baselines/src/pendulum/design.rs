//! The rod that a controller believes in, and how it meets it.

use crate::error::{Result, parameter};
use rodgym_core::given::check_names;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Names of the fields.
const NAMES: &[&str] = &[
    "width",
    "length",
    "nodes",
    "density",
    "youngs_modulus",
    "damping",
    "bending_damping",
    "gravity",
    "torque_limit",
    "control_dt",
];
/// What `nodes` may be.
const NODES: &str = "an integer from 2 to 1001";

/// Parameters of a pendulum as the designer knows them. Field names are the keywords of the
/// environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RodDesign {
    /// Side of the square section \[m\].
    pub width: f64,
    /// Rest length \[m\].
    pub length: f64,
    /// Nodes, at least 2: then the rod is one rigid edge.
    pub nodes: usize,
    /// Density \[kg/m^3\].
    pub density: f64,
    /// Young's modulus \[Pa\].
    pub youngs_modulus: f64,
    /// Nodal drag zeta \[kg/s\].
    pub damping: f64,
    /// Kelvin-Voigt time of bending beta \[s\].
    pub bending_damping: f64,
    /// Gravity \[m/s^2\].
    pub gravity: f64,
    /// Largest torque \[N m\]; the action 1.
    pub torque_limit: f64,
    /// Control period \[s\].
    pub control_dt: f64,
}

impl Default for RodDesign {
    /// Table 4.1 with w = 7 mm, as the environments have it.
    fn default() -> Self {
        RodDesign {
            width: 0.007,
            length: 0.3,
            nodes: 7,
            density: 1500.0,
            youngs_modulus: 1e7,
            damping: 0.0,
            bending_damping: 5e-4,
            gravity: 9.81,
            torque_limit: 0.05,
            control_dt: 0.01,
        }
    }
}

impl RodDesign {
    /// Reads the resolved keywords of an environment (`Spec::config`); what is absent keeps its default.
    ///
    /// # Errors
    /// A value that is not a number or not allowed.
    pub fn from_config(config: &Map<String, Value>) -> Result<Self> {
        let mut design = RodDesign::default();
        let read = |name: &str, field: &mut f64| match config.get(name) {
            None | Some(Value::Null) => Ok(()),
            Some(value) => match value.as_f64() {
                Some(x) => {
                    *field = x;
                    Ok(())
                }
                None => Err(parameter(name, value, "a number")),
            },
        };
        read("width", &mut design.width)?;
        read("length", &mut design.length)?;
        read("density", &mut design.density)?;
        read("youngs_modulus", &mut design.youngs_modulus)?;
        read("damping", &mut design.damping)?;
        read("bending_damping", &mut design.bending_damping)?;
        read("gravity", &mut design.gravity)?;
        read("torque_limit", &mut design.torque_limit)?;
        // What the motor's action 1 is worth.
        let mut gain = 1.0;
        read("actuator_gain", &mut gain)?;
        design.torque_limit *= gain;
        read("control_dt", &mut design.control_dt)?;
        if let Some(value) = config.get("nodes").filter(|value| !value.is_null()) {
            let nodes = value.as_u64().and_then(|nodes| usize::try_from(nodes).ok());
            design.nodes = nodes.ok_or_else(|| parameter("nodes", value, NODES))?;
        }
        design.check()?;
        Ok(design)
    }

    /// Reads keywords that a user typed: as `from_config`, but names that no rod has are refused.
    ///
    /// # Errors
    /// An unknown name, a value that is not a number or not allowed.
    pub fn from_keywords(given: &Map<String, Value>) -> Result<Self> {
        check_names(given, NAMES)?;
        RodDesign::from_config(given)
    }

    /// Refuses what no model can be made of.
    ///
    /// # Errors
    /// The first field that is not allowed.
    pub fn check(&self) -> Result<()> {
        let positive = [
            ("width", self.width),
            ("length", self.length),
            ("density", self.density),
            ("youngs_modulus", self.youngs_modulus),
            ("torque_limit", self.torque_limit),
            ("control_dt", self.control_dt),
        ];
        for (name, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(parameter(name, value, "finite and above 0"));
            }
        }
        let not_negative = [
            ("damping", self.damping),
            ("bending_damping", self.bending_damping),
            ("gravity", self.gravity),
        ];
        for (name, value) in not_negative {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(parameter(name, value, "finite and at least 0"));
            }
        }
        if !(2..=1001).contains(&self.nodes) {
            return Err(parameter("nodes", self.nodes, NODES));
        }
        Ok(())
    }

    /// Edges, n = N - 1.
    pub fn edges(&self) -> usize {
        self.nodes - 1
    }

    /// Rest length of an edge l \[m\].
    pub fn edge_length(&self) -> f64 {
        self.length / self.edges() as f64
    }

    /// Bending stiffness EI = E w^4 / 12 \[N m^2\].
    pub fn bending_stiffness(&self) -> f64 {
        let w2 = self.width * self.width;
        self.youngs_modulus * w2 * w2 / 12.0
    }

    /// Mass of an inner node rho w^2 l \[kg\]; the end nodes have half of it, thesis (2.5).
    pub fn node_mass(&self) -> f64 {
        self.density * self.width * self.width * self.edge_length()
    }

    /// Mass above the base of each edge: the sum of m_k over the nodes beyond edge i (0-based) \[kg\].
    pub fn mass_beyond(&self, edge: usize) -> f64 {
        self.node_mass() * (self.edges() as f64 - edge as f64 - 0.5)
    }
}
