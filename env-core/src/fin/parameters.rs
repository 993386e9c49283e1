//! The numbers of a fin and its water that may differ from episode to episode.

use crate::error::{Error, Result};
use crate::keywords::Parameter;
use crate::lane::{Lanewise, Real};
use crate::lanewise;

/// Density of water \[kg/m^3\].
pub const WATER_DENSITY: f64 = 1000.0;

/// Defines the parameters by one list: field, unit, default, range, meaning.
macro_rules! parameters {
    ($($field:ident, $unit:literal, $default:literal, $low:literal, $high:literal, $doc:literal;)*) => {
        /// Material, water and hull, one value a lane. The fields are the keywords that users type, in the order of
        /// `Spec::parameters`.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Parameters<R = f64> {
            $(#[doc = concat!($doc, " \\[", $unit, "\\]")] pub $field: R,)*
        }

        lanewise!(Parameters: $($field),*);

        impl<R: Real> Default for Parameters<R> {
            /// The flexible fin of the environments: soft, without artificial damping.
            fn default() -> Self {
                Parameters { $($field: R::splat($default)),* }
            }
        }

        /// Every parameter with its range.
        const TABLE: &[Parameter] = &[$(Parameter {
            name: stringify!($field), unit: $unit, default: $default, low: $low, high: $high, doc: $doc,
        }),*];
    };
}

parameters! {
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
        std::array::from_fn(|index| TABLE[index].clone())
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
        let (mut found, mut at) = (f64::NAN, 0);
        self.visit(&mut |value| {
            if at == index {
                found = *value;
            }
            at += 1;
        });
        found
    }

    /// Replaces the value at `index` of the table.
    ///
    /// # Errors
    /// A value outside the table's range.
    pub fn set(&mut self, index: usize, value: f64) -> Result<()> {
        let row = &TABLE[index];
        // The comparison is written so that NaN fails it.
        if !(value >= row.low && value <= row.high) {
            let unit = if row.unit.is_empty() { String::new() } else { format!(" {}", row.unit) };
            let allowed = format!("between {} and {}{unit}", row.low, row.high);
            return Err(Error::parameter(row.name, value, allowed));
        }
        let mut at = 0;
        self.visit_mut(&mut |slot| {
            if at == index {
                *slot = value;
            }
            at += 1;
        });
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
}
