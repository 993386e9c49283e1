//! The rod itself: a smooth curve through its nodes, as thick as it is, coloured by curvature.

use crate::color::{Color, WHITE, bend_color, bend_step};
use crate::picture::{Picture, Point};
use crate::view::View;
use rodgym_core::env::Scene;

/// Thinner than this \[px, half\] a rod could hardly be seen.
const THINNEST: f32 = 1.25;

/// A cross-section of the drawn rod.
#[derive(Clone, Copy)]
struct Section {
    center: Point,
    /// Unit normal, to the left of the way from first to last node as seen on the screen.
    normal: Point,
    /// Half the thickness \[px\].
    half: f32,
    /// Colour of the curvature here.
    step: i32,
}

impl Section {
    fn side(&self, offset: f32) -> Point {
        (self.center.0 + self.normal.0 * offset, self.center.1 + self.normal.1 * offset)
    }
}

/// A rod ready to be painted.
pub struct Rod {
    sections: Vec<Section>,
}

impl Rod {
    /// Lays the curve (Catmull-Rom) through the nodes of a checked scene; `vivid_turn` \[rad\] is the
    /// turn over the whole rod that is shown in vivid colour.
    pub fn new(scene: &Scene, view: &View, vivid_turn: f64) -> Rod {
        let nodes: Vec<Point> = scene.nodes.iter().map(|p| view.at(*p)).collect();
        let edges = nodes.len() - 1;
        let pieces = (edges * 20).clamp(60, 200);
        let mut sections: Vec<Section> = Vec::with_capacity(pieces + 1);
        for i in 0..=pieces {
            let u = i as f32 / pieces as f32 * edges as f32;
            let k = (u as usize).min(edges - 1);
            let s = u - k as f32;
            let (center, along) = spline(&nodes, k, s);
            let length = along.0.hypot(along.1);
            // Where the curve stands still (coinciding nodes) it keeps its direction.
            let normal = if length > 1e-6 {
                (along.1 / length, -along.0 / length)
            } else {
                sections.last().map_or((0.0, -1.0), |last| last.normal)
            };
            let half = view.length(thickness(&scene.thickness, k, f64::from(s)) / 2.0);
            let kappa =
                scene.curvature[k] + (scene.curvature[k + 1] - scene.curvature[k]) * f64::from(s);
            let step = bend_step(kappa * edges as f64 / vivid_turn);
            sections.push(Section { center, normal, half: half.max(THINNEST), step });
        }
        Rod { sections }
    }

    /// A soft shadow, cast to the lower right.
    pub fn shadow(&self, picture: &mut Picture, offset: f32, color: Color) {
        let moved: Vec<Section> = self
            .sections
            .iter()
            .map(|s| Section { center: (s.center.0 + offset, s.center.1 + offset), ..*s })
            .collect();
        outline(picture, &moved, 0.0, color);
        outline(picture, &moved, offset * 0.4, color);
    }

    /// Rim, body in the colours of its curvature, sheen.
    pub fn body(&self, picture: &mut Picture, rim: f32, rim_color: Color) {
        outline(picture, &self.sections, rim, rim_color);
        let mut start = 0;
        while start + 1 < self.sections.len() {
            let step = self.sections[start].step;
            let same = self.sections[start..].iter().take_while(|s| s.step == step).count();
            // One section further than the next piece's start: pieces overlap, so no seam shows.
            let end = (start + same + 1).min(self.sections.len() - 1);
            ribbon(picture, &self.sections[start..=end], 0.0, bend_color(step));
            start += same;
        }
        for (end, step) in [
            (self.sections[0], self.sections[0].step),
            (self.sections[self.sections.len() - 1], self.sections[self.sections.len() - 1].step),
        ] {
            picture.disc(end.center, end.half, bend_color(step));
        }
        // Light comes from above: the sheen lies on whichever side looks up.
        let up =
            if self.sections.iter().map(|s| s.normal.1).sum::<f32>() < 0.0 { 1.0 } else { -1.0 };
        let lit: Vec<Point> = self.sections.iter().map(|s| s.side(up * 0.45 * s.half)).collect();
        let thickest = self.sections.iter().map(|s| s.half).fold(0.0, f32::max);
        picture.line(&lit, (0.3 * thickest).clamp(0.6, 5.0), WHITE.alpha(0.22));
    }

    /// Marks where the nodes are.
    pub fn nodes(&self, picture: &mut Picture, scene: &Scene, view: &View, radius: f32) {
        for node in &scene.nodes {
            picture.disc(view.at(*node), radius, WHITE.alpha(0.75));
        }
    }
}

/// The whole silhouette, grown by `rim` pixels, with round ends.
fn outline(picture: &mut Picture, sections: &[Section], rim: f32, color: Color) {
    // An opaque rim may be painted in parts; a translucent one is left without caps.
    ribbon(picture, sections, rim, color);
    if color.0[3] == 255 {
        for end in [sections[0], sections[sections.len() - 1]] {
            picture.disc(end.center, end.half + rim, color);
        }
    }
}

fn ribbon(picture: &mut Picture, sections: &[Section], rim: f32, color: Color) {
    let left = sections.iter().map(|s| s.side(s.half + rim));
    let right = sections.iter().rev().map(|s| s.side(-s.half - rim));
    let points: Vec<Point> = left.chain(right).collect();
    picture.polygon(&points, color);
}

/// Point and derivative at `s` in \[0, 1\] of edge `k`; beyond the ends the curve goes on straight.
fn spline(nodes: &[Point], k: usize, s: f32) -> (Point, Point) {
    let (b, c) = (nodes[k], nodes[k + 1]);
    let a = if k > 0 { nodes[k - 1] } else { (2.0 * b.0 - c.0, 2.0 * b.1 - c.1) };
    let d = nodes.get(k + 2).copied().unwrap_or((2.0 * c.0 - b.0, 2.0 * c.1 - b.1));
    let cubic = |a: f32, b: f32, c: f32, d: f32| {
        let (m, n) = ((c - a) / 2.0, (d - b) / 2.0);
        let (e, f) = (3.0 * (c - b) - 2.0 * m - n, 2.0 * (b - c) + m + n);
        (b + s * (m + s * (e + s * f)), m + s * (2.0 * e + s * 3.0 * f))
    };
    let (x, dx) = cubic(a.0, b.0, c.0, d.0);
    let (y, dy) = cubic(a.1, b.1, c.1, d.1);
    ((x, y), (dx, dy))
}

/// Thickness at `s` of edge `k`; a nose that starts from nothing is drawn round, not as a wedge.
fn thickness(at_nodes: &[f64], k: usize, s: f64) -> f64 {
    let (a, b) = (at_nodes[k].max(0.0), at_nodes[k + 1].max(0.0));
    if k == 0 && a == 0.0 { b * (s * (2.0 - s)).sqrt() } else { a + (b - a) * s }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curve_passes_through_every_node_and_is_smooth_there() {
        let nodes = [(0.0, 0.0), (10.0, 3.0), (18.0, -4.0), (30.0, 1.0)];
        for k in 0..3 {
            let (start, end) = (spline(&nodes, k, 0.0).0, spline(&nodes, k, 1.0).0);
            assert!((start.0 - nodes[k].0).abs() + (start.1 - nodes[k].1).abs() < 1e-4);
            assert!((end.0 - nodes[k + 1].0).abs() + (end.1 - nodes[k + 1].1).abs() < 1e-4);
        }
        for k in 0..2 {
            let (before, after) = (spline(&nodes, k, 1.0).1, spline(&nodes, k + 1, 0.0).1);
            assert!((before.0 - after.0).abs() + (before.1 - after.1).abs() < 1e-3);
        }
    }

    #[test]
    fn nose_is_round_and_tail_is_not() {
        let widths = [0.0, 0.02, 0.004];
        assert!(thickness(&widths, 0, 0.1) > 0.008);
        assert_eq!(thickness(&widths, 1, 0.5), 0.012);
    }
}
