//! Text as outlines of the embedded font, so that pictures need no system fonts.

use std::sync::LazyLock;
use tiny_skia::{Path, PathBuilder};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

// A subset of DejaVu Sans; its licence lies beside it.
static FACE: LazyLock<Face<'static>> = LazyLock::new(|| {
    Face::parse(include_bytes!("../assets/DejaVuSans-subset.ttf"), 0)
        .expect("the embedded font is a valid font")
});

/// Glyphs of `text`; what the font lacks is shown as a question mark.
fn glyphs(text: &str) -> impl Iterator<Item = GlyphId> + '_ {
    text.chars().map(|c| FACE.glyph_index(c).or(FACE.glyph_index('?')).unwrap_or(GlyphId(0)))
}

fn advance(glyph: GlyphId) -> f32 {
    f32::from(FACE.glyph_hor_advance(glyph).unwrap_or(0))
}

/// Width of a line of text \[px\] at a font size \[px per em\].
pub(crate) fn width(text: &str, size: f32) -> f32 {
    glyphs(text).map(advance).sum::<f32>() * size / f32::from(FACE.units_per_em())
}

/// Outline of a line of text that starts at `at` on its baseline; `None` when nothing is visible.
pub(crate) fn outline(text: &str, at: (f32, f32), size: f32) -> Option<Path> {
    let scale = size / f32::from(FACE.units_per_em());
    let mut pen = Pen { path: PathBuilder::new(), x: at.0, y: at.1, scale };
    for glyph in glyphs(text) {
        FACE.outline_glyph(glyph, &mut pen);
        pen.x += advance(glyph) * scale;
    }
    pen.path.finish()
}

/// Carries glyph outlines from font units (y up) to pixels (y down).
struct Pen {
    path: PathBuilder,
    x: f32,
    y: f32,
    scale: f32,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + x * self.scale, self.y - y * self.scale)
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.move_to(x, y);
    }
    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.line_to(x, y);
    }
    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.path.quad_to(x1, y1, x, y);
    }
    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }
    fn close(&mut self) {
        self.path.close();
    }
}

/// A number with a typographic minus sign, which is as wide as a digit's plus.
pub(crate) fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let zero = text.chars().all(|c| matches!(c, '-' | '0' | '.'));
    if zero { text.replace('-', "") } else { text.replace('-', "\u{2212}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_equally_wide_so_that_counters_do_not_jitter() {
        assert!("0123456789".chars().all(|c| width(&c.to_string(), 16.0) == width("0", 16.0)));
    }

    #[test]
    fn every_sign_that_pictures_use_is_in_the_font() {
        assert!("AZaz09°·−×".chars().all(|c| FACE.glyph_index(c).is_some()));
        assert_eq!(width("漢", 16.0), width("?", 16.0));
        assert!(outline("   ", (0.0, 0.0), 16.0).is_none());
    }

    #[test]
    fn numbers_have_no_negative_zero() {
        assert_eq!(
            [number(-0.001, 2), number(-1.5, 1), number(2.0, 0)],
            ["0.00", "\u{2212}1.5", "2"]
        );
    }
}
