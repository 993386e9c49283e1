//! Colours: the palette of all pictures and the map from signed curvature to colour.

/// Red, green, blue, opacity; not premultiplied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Color(pub [u8; 4]);

impl Color {
    /// An opaque colour from `0xRRGGBB`.
    pub const fn hex(rgb: u32) -> Color {
        Color([(rgb >> 16) as u8, (rgb >> 8) as u8, rgb as u8, 255])
    }

    /// The same colour with opacity `alpha` in \[0, 1\].
    pub fn alpha(self, alpha: f32) -> Color {
        let [r, g, b, _] = self.0;
        Color([r, g, b, (alpha.clamp(0.0, 1.0) * 255.0).round() as u8])
    }

    /// The way from this colour (t = 0) to `other` (t = 1).
    pub fn mix(self, other: Color, t: f32) -> Color {
        let t = t.clamp(0.0, 1.0);
        let part = |a: u8, b: u8| (f32::from(a) + (f32::from(b) - f32::from(a)) * t).round() as u8;
        Color(std::array::from_fn(|i| part(self.0[i], other.0[i])))
    }
}

/// Outlines and writing.
pub const INK: Color = Color::hex(0x2B3742);
/// Writing of less weight.
pub const FAINT_INK: Color = Color::hex(0x7C8A96);
/// Top of a background in air.
pub const PAPER: Color = Color::hex(0xFAF8F4);
/// Bottom of a background in air.
pub const PAPER_LOW: Color = Color::hex(0xEFEBE3);
/// What holds a machine.
pub const STEEL: Color = Color::hex(0xB9C0C6);
/// Top of a background in water.
pub const WATER: Color = Color::hex(0xE4F2F5);
/// Bottom of a background in water.
pub const WATER_LOW: Color = Color::hex(0xC9E2EA);
/// What the tail leaves in the water.
pub const DYE: Color = Color::hex(0x2E7F9E);
/// White.
pub const WHITE: Color = Color::hex(0xFFFFFF);
/// The actuator: base torque, commanded pitch.
pub const ACTUATOR: Color = Color::hex(0x9C2F73);
/// What is earned: reward, thrust, the place to reach.
pub const GAIN: Color = Color::hex(0x0E7C7B);
/// What is lost: negative reward, drag.
pub const LOSS: Color = Color::hex(0xB5523B);

const STRAIGHT: Color = Color::hex(0x3C4854);
const CLOCKWISE: [Color; 2] = [Color::hex(0x2F6FC4), Color::hex(0x5CA8FF)];
const COUNTERCLOCKWISE: [Color; 2] = [Color::hex(0xD9761A), Color::hex(0xFFB23E)];

/// Steps of the map on either side; neighbours of one step are painted as one piece.
const STEPS: f64 = 24.0;

/// Where a bend stands on the map: a whole number from -24 to 24, +-17 for a bend of +-1.
pub fn bend_step(bend: f64) -> i32 {
    (bend / bend.hypot(1.0) * STEPS).round() as i32
}

/// Colour of a step of the map: blue where the rod turns clockwise, orange where it turns
/// counter-clockwise (told apart by all common kinds of colour blindness), slate where it is straight.
pub fn bend_color(step: i32) -> Color {
    let t = step as f32 / STEPS as f32;
    let [middle, end] = if t < 0.0 { CLOCKWISE } else { COUNTERCLOCKWISE };
    let t = t.abs();
    if t < 0.55 { STRAIGHT.mix(middle, t / 0.55) } else { middle.mix(end, (t - 0.55) / 0.45) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curvature_map_is_odd_monotone_and_bounded() {
        let steps: Vec<i32> = (-50..=50).map(|k| bend_step(f64::from(k) * 0.1)).collect();
        assert!(steps.windows(2).all(|w| w[0] <= w[1]));
        assert!(steps.iter().zip(steps.iter().rev()).all(|(a, b)| *a == -*b));
        assert_eq!([0.0, 1.0, 1e300, -1e9].map(bend_step), [0, 17, 24, -24]);
    }

    #[test]
    fn opposite_bends_differ_in_blue_which_red_green_blindness_leaves() {
        for step in 4..=24 {
            let (left, right) = (bend_color(-step).0, bend_color(step).0);
            assert!(i32::from(left[2]) - i32::from(right[2]) > 20, "step {step}");
        }
    }
}
