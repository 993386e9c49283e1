//! A picture as pixels.

use crate::picture::{Ink, Picture};
use tiny_skia::{
    FillRule, LineCap, LineJoin, Mask, Paint, Pixmap, PremultipliedColorU8, Stroke, StrokeDash,
    Transform,
};

/// Paints the picture: RGB, row-major (height, width, 3).
pub(crate) fn paint(picture: &Picture) -> Vec<u8> {
    let mut pixmap = Pixmap::new(picture.width, picture.height)
        .expect("render() refuses sizes that cannot be allocated");
    paint_background(picture, &mut pixmap);
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    let no_mask: Option<&Mask> = None;
    for shape in &picture.shapes {
        let [r, g, b, a] = shape.color.0;
        paint.set_color_rgba8(r, g, b, a);
        match shape.ink {
            Ink::Fill => pixmap.fill_path(
                &shape.path,
                &paint,
                FillRule::Winding,
                Transform::identity(),
                no_mask,
            ),
            Ink::Stroke { width, dash } => {
                let stroke = Stroke {
                    width,
                    line_cap: LineCap::Round,
                    line_join: LineJoin::Round,
                    dash: dash.and_then(|d| StrokeDash::new(vec![d, d], 0.0)),
                    ..Stroke::default()
                };
                pixmap.stroke_path(&shape.path, &paint, &stroke, Transform::identity(), no_mask);
            }
        }
    }
    let mut rgb = vec![0; pixmap.data().len() / 4 * 3];
    // The background is opaque, so premultiplied colours are the colours themselves.
    for (to, from) in rgb.chunks_exact_mut(3).zip(pixmap.data().chunks_exact(4)) {
        to.copy_from_slice(&from[..3]);
    }
    rgb
}

/// Fills row by row: much cheaper than a gradient shader.
fn paint_background(picture: &Picture, pixmap: &mut Pixmap) {
    let [top, bottom] = picture.background;
    let height = picture.height.max(2) as f32 - 1.0;
    let width = picture.width as usize;
    for (y, row) in pixmap.pixels_mut().chunks_exact_mut(width).enumerate() {
        let [r, g, b, _] = top.mix(bottom, y as f32 / height).0;
        row.fill(PremultipliedColorU8::from_rgba(r, g, b, 255).expect("opaque"));
    }
}
