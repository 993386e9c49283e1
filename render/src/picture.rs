//! A picture as a list of shapes, painted from back to front; `raster` and `svg` show it.

use crate::color::Color;
use crate::text;
use std::f32::consts::{PI, TAU};
use tiny_skia::{Path, PathBuilder, Rect};

/// A point in pixels, x to the right, y down.
pub type Point = (f32, f32);

/// How a path is painted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ink {
    /// Its inside (non-zero winding).
    Fill,
    /// Its line, with round caps and joins.
    Stroke {
        /// Width of the line \[px\].
        width: f32,
        /// Length of dashes and gaps \[px\].
        dash: Option<f32>,
    },
}

/// A path with its paint.
pub struct Shape {
    /// Its outline \[px\].
    pub path: Path,
    /// Its colour.
    pub color: Color,
    /// How it is painted.
    pub ink: Ink,
}

/// Which point of a text is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Align {
    /// Its left end.
    Left,
    /// Its middle.
    Center,
    /// Its right end.
    Right,
}

/// Shapes before a background that runs from one colour (top) to another (bottom).
pub struct Picture {
    /// Width \[px\].
    pub width: u32,
    /// Height \[px\].
    pub height: u32,
    /// Colours at top and bottom.
    pub background: [Color; 2],
    /// From back to front.
    pub shapes: Vec<Shape>,
}

impl Picture {
    /// A picture with nothing but its background; `size` is (width, height) \[px\].
    pub fn new(size: (u32, u32), background: [Color; 2]) -> Self {
        Picture { width: size.0, height: size.1, background, shapes: Vec::with_capacity(96) }
    }

    /// Width and height \[px\].
    pub fn extent(&self) -> Point {
        (self.width as f32, self.height as f32)
    }

    /// Adds a path; one that has no extent (all points the same) leaves no trace.
    pub fn add(&mut self, path: Option<Path>, color: Color, ink: Ink) {
        if let Some(path) = path {
            self.shapes.push(Shape { path, color, ink });
        }
    }

    /// Adds a filled polygon.
    pub fn polygon(&mut self, points: &[Point], color: Color) {
        self.add(path_through(points, true), color, Ink::Fill);
    }

    /// Adds a line through points.
    pub fn line(&mut self, points: &[Point], width: f32, color: Color) {
        self.add(path_through(points, false), color, Ink::Stroke { width, dash: None });
    }

    /// Adds a dashed line through points.
    pub fn dashed(&mut self, points: &[Point], width: f32, dash: f32, color: Color) {
        self.add(path_through(points, false), color, Ink::Stroke { width, dash: Some(dash) });
    }

    /// Adds a filled circle.
    pub fn disc(&mut self, center: Point, radius: f32, color: Color) {
        self.add(PathBuilder::from_circle(center.0, center.1, radius), color, Ink::Fill);
    }

    /// Adds a circle as a line.
    pub fn ring(&mut self, center: Point, radius: f32, width: f32, color: Color) {
        let path = PathBuilder::from_circle(center.0, center.1, radius);
        self.add(path, color, Ink::Stroke { width, dash: None });
    }

    /// A rectangle with rounded corners; `from` and `to` are opposite corners.
    pub fn slab(&mut self, from: Point, to: Point, radius: f32, color: Color) {
        let (x, y) = (from.0.min(to.0), from.1.min(to.1));
        let (w, h) = ((from.0 - to.0).abs(), (from.1 - to.1).abs());
        let r = radius.min(w / 2.0).min(h / 2.0);
        if r < 0.25 {
            let rect = Rect::from_xywh(x, y, w, h);
            self.add(rect.map(PathBuilder::from_rect), color, Ink::Fill);
            return;
        }
        // Circular to 0.03 %: the usual constant of a quarter circle as a cubic.
        let k = r * (1.0 - 0.552_285);
        let mut path = PathBuilder::new();
        path.move_to(x + r, y);
        path.line_to(x + w - r, y);
        path.cubic_to(x + w - k, y, x + w, y + k, x + w, y + r);
        path.line_to(x + w, y + h - r);
        path.cubic_to(x + w, y + h - k, x + w - k, y + h, x + w - r, y + h);
        path.line_to(x + r, y + h);
        path.cubic_to(x + k, y + h, x, y + h - k, x, y + h - r);
        path.line_to(x, y + r);
        path.cubic_to(x, y + k, x + k, y, x + r, y);
        path.close();
        self.add(path.finish(), color, Ink::Fill);
    }

    /// A straight arrow; shorter than its head, the head shrinks with it.
    pub fn arrow(&mut self, from: Point, to: Point, width: f32, color: Color) {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let length = dx.hypot(dy);
        if length < 0.5 {
            return;
        }
        let head = (4.0 * width).min(length);
        let neck = (to.0 - dx / length * head * 0.8, to.1 - dy / length * head * 0.8);
        self.line(&[from, neck], width * (head / (4.0 * width)), color);
        self.head(to, dy.atan2(dx), head, color);
    }

    /// An arc about `center` from angle `start` over `sweep` \[rad, counter-clockwise\] with a head.
    pub fn arc_arrow(
        &mut self,
        center: Point,
        radius: f32,
        (start, sweep): (f32, f32),
        width: f32,
        color: Color,
    ) {
        let at = |a: f32| (center.0 + radius * a.cos(), center.1 - radius * a.sin());
        let length = sweep.abs() * radius;
        if length < 0.5 {
            return;
        }
        let head = (4.0 * width).min(length);
        let neck = sweep - sweep.signum() * 0.8 * head / radius;
        let pieces = (neck.abs() * radius / 4.0).ceil().clamp(2.0, 64.0) as usize;
        let points: Vec<Point> =
            (0..=pieces).map(|i| at(start + neck * i as f32 / pieces as f32)).collect();
        self.line(&points, width * (head / (4.0 * width)), color);
        // The head follows its chord, so that it does not stick out of the circle.
        let (tail, tip) = (at(start + neck), at(start + sweep));
        self.head(tip, (tip.1 - tail.1).atan2(tip.0 - tail.0), head, color);
    }

    /// A smooth line through points of decreasing freshness (1 new, 0 gone), the newest first. It fades
    /// into the background: opaque, because translucent pieces would show where they overlap.
    pub fn fading(&mut self, trail: &[(Point, f32)], width: impl Fn(f32) -> f32, color: Color) {
        let middle = |a: Point, b: Point| ((a.0 + b.0) / 2.0, (a.1 + b.1) / 2.0);
        for (i, &(at, fresh)) in trail.iter().enumerate().rev() {
            let newer = if i > 0 { middle(at, trail[i - 1].0) } else { at };
            let older = trail.get(i + 1).map_or(at, |next| middle(at, next.0));
            let mut path = PathBuilder::new();
            path.move_to(older.0, older.1);
            path.quad_to(at.0, at.1, newer.0, newer.1);
            let [r, g, b, a] = color.0;
            let ground = self.background[0].mix(self.background[1], at.1 / self.height as f32);
            let color = ground.mix(Color([r, g, b, 255]), fresh * f32::from(a) / 255.0);
            self.add(path.finish(), color, Ink::Stroke { width: width(fresh), dash: None });
        }
    }

    fn head(&mut self, tip: Point, angle: f32, size: f32, color: Color) {
        let back = |turn: f32| {
            let a = angle + PI + turn;
            (tip.0 + size * a.cos(), tip.1 + size * a.sin())
        };
        self.polygon(&[tip, back(0.45), back(-0.45)], color);
    }

    /// A line of text with its baseline at `at`; returns its width \[px\].
    pub fn text(&mut self, at: Point, size: f32, align: Align, color: Color, text: &str) -> f32 {
        let width = text::width(text, size);
        let left = match align {
            Align::Left => at.0,
            Align::Center => at.0 - width / 2.0,
            Align::Right => at.0 - width,
        };
        self.add(text::outline(text, (left, at.1), size), color, Ink::Fill);
        width
    }
}

/// The polyline through `points`.
pub fn path_through(points: &[Point], close: bool) -> Option<Path> {
    let mut path = PathBuilder::with_capacity(points.len() + 1, points.len());
    let (first, rest) = points.split_first()?;
    path.move_to(first.0, first.1);
    for p in rest {
        path.line_to(p.0, p.1);
    }
    if close {
        path.close();
    }
    path.finish()
}

/// Points on a circle, for lines that are not closed shapes.
pub fn circle(center: Point, radius: f32) -> Vec<Point> {
    (0..=96)
        .map(|i| {
            let a = TAU * i as f32 / 96.0;
            (center.0 + radius * a.cos(), center.1 - radius * a.sin())
        })
        .collect()
}
