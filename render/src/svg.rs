//! A picture as SVG: the same shapes, sharp at any size.

use crate::color::Color;
use crate::picture::{Ink, Picture};
use std::fmt::Write;
use tiny_skia::{Path, PathSegment};

/// Writes the picture as a complete SVG document; text is written as outlines.
pub(crate) fn write(picture: &Picture) -> String {
    let (w, h) = (picture.width, picture.height);
    let [top, bottom] = picture.background;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\">\n\
         <defs><linearGradient id=\"ground\" x2=\"0\" y2=\"1\"><stop stop-color=\"{}\"/>\
         <stop offset=\"1\" stop-color=\"{}\"/></linearGradient></defs>\n\
         <rect width=\"{w}\" height=\"{h}\" fill=\"url(#ground)\"/>\n",
        rgb(top),
        rgb(bottom)
    );
    for shape in &picture.shapes {
        let color = rgb(shape.color);
        let opacity = f32::from(shape.color.0[3]) / 255.0;
        let d = data(&shape.path);
        match shape.ink {
            Ink::Fill => {
                write!(out, "<path d=\"{d}\" fill=\"{color}\" fill-opacity=\"{opacity:.3}\"/>")
            }
            Ink::Stroke { width, dash } => {
                let dash =
                    dash.map_or(String::new(), |d| format!(" stroke-dasharray=\"{d:.2}\""));
                write!(
                    out,
                    "<path d=\"{d}\" fill=\"none\" stroke=\"{color}\" stroke-opacity=\"{opacity:.3}\" \
                     stroke-width=\"{width:.2}\" stroke-linecap=\"round\" stroke-linejoin=\"round\"{dash}/>"
                )
            }
        }
        .expect("writing to a string cannot fail");
        out.push('\n');
    }
    out.push_str("</svg>\n");
    out
}

fn rgb(color: Color) -> String {
    let [r, g, b, _] = color.0;
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn data(path: &Path) -> String {
    let mut d = String::new();
    for segment in path.segments() {
        match segment {
            PathSegment::MoveTo(p) => write!(d, "M{:.2} {:.2}", p.x, p.y),
            PathSegment::LineTo(p) => write!(d, "L{:.2} {:.2}", p.x, p.y),
            PathSegment::QuadTo(a, p) => {
                write!(d, "Q{:.2} {:.2} {:.2} {:.2}", a.x, a.y, p.x, p.y)
            }
            PathSegment::CubicTo(a, b, p) => {
                write!(d, "C{:.2} {:.2} {:.2} {:.2} {:.2} {:.2}", a.x, a.y, b.x, b.y, p.x, p.y)
            }
            PathSegment::Close => write!(d, "Z"),
        }
        .expect("writing to a string cannot fail");
    }
    d
}
