//! The numbers of a fin and its water that may differ from episode to episode.

use super::geometry::Geometry;
use crate::env::Parameter;
use crate::error::{Error, Result};
use crate::fluid::Water;

/// Density of water \[kg/m^3\].
pub const WATER_DENSITY: f64 = 1000.0;

/// Material, water and hull. The fields are the keywords that users type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Young's modulus \[Pa\].
    pub youngs_modulus: f64,
    /// Nodal damping zeta: force `-zeta v` at each node \[kg/s\].
    pub damping: f64,
    /// Bending damping beta: moment `(E I / l) beta d(phi)/dt` \[s\].
    pub bending_damping: f64,
    /// Density of the fin \[kg/m^3\].
    pub density: f64,
    /// Speed of the water along +x \[m/s\].
    pub flow_speed: f64,
    /// C_m, added mass over that of a plate.
    pub added_mass_coefficient: f64,
    /// C_f, friction along the fin.
    pub friction_coefficient: f64,
    /// C_d, drag across the fin.
    pub drag_coefficient: f64,
    /// Mass of the hull that the fin pushes \[kg\]; used by a free-swimming fin only.
    pub hull_mass: f64,
    /// Drag area C_D S of the hull \[m^2\]; used by a free-swimming fin only.
    pub hull_drag_area: f64,
}

/// One row: name, unit, default, range, meaning, and the field.
type Row = (Parameter, fn(&mut Parameters) -> &mut f64);

macro_rules! rows {
    ($($field:ident, $unit:literal, $default:literal, $low:literal, $high:literal, $doc:literal;)*) => {
        [$((Parameter {
            name: stringify!($field), unit: $unit, default: $default, low: $low, high: $high, doc: $doc,
        }, (|p| &mut p.$field) as fn(&mut Parameters) -> &mut f64)),*]
    };
}

/// Every parameter with its range, in the order of `Spec::parameters`.
const TABLE: [Row; 10] = rows! {
    youngs_modulus, "Pa", 2.5e5, 1e4, 1e10, "Young's modulus of the fin";
    damping, "kg/s", 0.0, 0.0, 10.0, "damping zeta at each node, relative to the laboratory";
    bending_damping, "s", 0.0, 0.0, 1.0, "Kelvin-Voigt bending damping beta";
    density, "kg/m^3", 1100.0, 100.0, 10000.0, "density of the fin";
    flow_speed, "m/s", 0.05, 0.0, 1.0, "speed of the water, from nose to tail";
    added_mass_coefficient, "", 0.5, 0.0, 2.0, "added mass C_m over that of a long plate";
    friction_coefficient, "", 0.016, 0.0, 1.0, "friction coefficient C_f along the fin";
    drag_coefficient, "", 1.2, 0.0, 10.0, "drag coefficient C_d across the fin";
    hull_mass, "kg", 1.0, 0.05, 1000.0, "mass of the hull that a free-swimming fin pushes";
    hull_drag_area, "m^2", 0.006, 0.0, 1.0, "drag coefficient times frontal area of the hull";
};

impl Default for Parameters {
    /// The flexible fin of the environments: soft, without artificial damping.
    fn default() -> Self {
        let mut parameters = Parameters {
            youngs_modulus: 0.0,
            damping: 0.0,
            bending_damping: 0.0,
            density: 0.0,
            flow_speed: 0.0,
            added_mass_coefficient: 0.0,
            friction_coefficient: 0.0,
            drag_coefficient: 0.0,
            hull_mass: 0.0,
            hull_drag_area: 0.0,
        };
        for (row, field) in TABLE {
            *field(&mut parameters) = row.default;
        }
        parameters
    }
}

impl Parameters {
    /// How many there are.
    pub const COUNT: usize = TABLE.len();

    /// The thesis' fit to the fin in air: E = 8.1112 MPa, zeta = 0.1238 kg/s (chapter 3.4.1).
    pub fn thesis() -> Self {
        Parameters { youngs_modulus: 8.1112e6, damping: 0.1238, ..Parameters::default() }
    }

    /// Names, units, defaults, ranges and meanings.
    pub fn table() -> [Parameter; Self::COUNT] {
        TABLE.map(|(row, _)| row)
    }

    /// The table of a fin that is held or that swims freely: its water is at rest then, whatever is asked.
    pub fn table_of(free_swimming: bool) -> [Parameter; Self::COUNT] {
        let mut table = Self::table();
        if free_swimming {
            for row in table.iter_mut().filter(|row| row.name == "flow_speed") {
                (row.default, row.high) = (0.0, 0.0);
                row.doc = "speed of the water: at rest, the fin swims through it";
            }
        }
        table
    }

    /// Value of the parameter at `index` of the table.
    pub fn get(&self, index: usize) -> f64 {
        let mut copy = *self;
        *TABLE[index].1(&mut copy)
    }

    /// Replaces the value at `index` of the table.
    ///
    /// # Errors
    /// A value outside the table's range.
    pub fn set(&mut self, index: usize, value: f64) -> Result<()> {
        let (row, field) = &TABLE[index];
        // The comparison is written so that NaN fails it.
        if !(value >= row.low && value <= row.high) {
            let unit = if row.unit.is_empty() { String::new() } else { format!(" {}", row.unit) };
            let allowed = format!("between {} and {}{unit}", row.low, row.high);
            return Err(Error::parameter(row.name, value, allowed));
        }
        *field(self) = value;
        Ok(())
    }

    /// Refuses values outside their ranges.
    ///
    /// # Errors
    /// Names the first such parameter.
    pub fn check(&self) -> Result<()> {
        let mut copy = *self;
        (0..Self::COUNT).try_for_each(|index| copy.set(index, self.get(index)))
    }

    /// Coefficients of the water about a fin of this geometry.
    pub fn water(&self, geometry: &Geometry) -> Water<f64> {
        let h = geometry.height;
        let plate = WATER_DENSITY * std::f64::consts::PI * h * h / 4.0;
        Water {
            added_mass: self.added_mass_coefficient * plate,
            drag: 0.5 * WATER_DENSITY * self.drag_coefficient * h,
            friction: 0.5 * WATER_DENSITY * self.friction_coefficient,
            flow_speed: self.flow_speed,
        }
    }
}
