//! The pendulum: rod, base torque, the place to reach, readouts.

use crate::color::{ACTUATOR, FAINT_INK, GAIN, INK, PAPER, PAPER_LOW, STEEL, WHITE};
use crate::gauges::{self, Layout};
use crate::past::Past;
use crate::picture::{Picture, Point, circle};
use crate::rod::Rod;
use crate::text::number;
use crate::view::{View, value};
use rodgym_core::env::Scene;
use std::f32::consts::PI;

/// Turn of the whole rod \[rad\] that is shown in vivid colour.
const VIVID_TURN: f64 = 1.8;

/// Draws a checked scene.
pub(crate) fn draw(scene: &Scene, past: &Past, size: (u32, u32)) -> Picture {
    let mut picture = Picture::new(size, [PAPER, PAPER_LOW]);
    let (w, h) = picture.extent();
    let short = w.min(h);
    let base = scene.nodes[0];
    let length = value(scene, "length").filter(|l| *l > 0.0).unwrap_or_else(|| arc_length(scene));
    let mut view = View {
        world: base,
        pixel: (w / 2.0, h / 2.0),
        scale: f64::from(short) / (2.0 * 1.16 * length.max(1e-6)),
    };
    let border = 0.02 * short;
    view.hold(&scene.nodes, (border, border), (w - border, h - border));

    stand(&mut picture, &view, length);
    target(&mut picture, &view, scene, length);
    trail(&mut picture, &view, past);
    let rod = Rod::new(scene, &view, VIVID_TURN);
    rod.shadow(&mut picture, (short / 160.0).min(6.0), INK.alpha(0.07));
    rod.body(&mut picture, short / 600.0, INK);
    rod.nodes(
        &mut picture,
        scene,
        &view,
        (short / 500.0).max(0.6).min(
            view.length(0.2 * scene.thickness.iter().copied().fold(f64::INFINITY, f64::min))
                .max(0.4),
        ),
    );
    hub(&mut picture, &view, length);
    torque_arc(&mut picture, &view, scene, length);

    if let Some(layout) = Layout::new(&picture) {
        gauges::clock(&mut picture, layout, scene);
        gauges::reward(&mut picture, layout, scene);
        let bottom = h - layout.margin;
        let top = bottom - 0.42 * layout.font;
        let left = layout.margin;
        if let Some(torque) = value(scene, "torque") {
            let text = format!("{} mN m", number(1e3 * torque, 1));
            let baseline = top - 0.55 * layout.font;
            gauges::reading(&mut picture, layout, (left, baseline), "torque", &text);
            gauges::bar(&mut picture, layout, (left, top), torque_fraction(scene), ACTUATOR);
        }
        gauges::bend_key(&mut picture, layout, (w - layout.margin - layout.bar, bottom));
    }
    picture
}

/// Length of the rod as it is, for scenes that do not name it.
fn arc_length(scene: &Scene) -> f64 {
    scene.nodes.windows(2).map(|e| (e[1][0] - e[0][0]).hypot(e[1][1] - e[0][1])).sum()
}

/// A column on a foot, behind everything.
fn stand(picture: &mut Picture, view: &View, length: f64) {
    let [x, y] = view.world;
    let at = |dx: f64, dy: f64| view.at([x + dx * length, y + dy * length]);
    let color = STEEL.alpha(0.45);
    picture.polygon(&[at(-0.022, 0.0), at(0.022, 0.0), at(0.034, -1.1), at(-0.034, -1.1)], color);
    picture.slab(at(-0.3, -1.1), at(0.3, -1.125), view.length(0.012 * length), color);
}

/// The upright rod as a ghost, and the circle within its reach.
fn target(picture: &mut Picture, view: &View, scene: &Scene, length: f64) {
    let [x, y] = view.world;
    let center = view.at(view.world);
    let radius = view.length(length);
    let fine = (radius / 180.0).max(0.6);
    picture.dashed(&circle(center, radius), fine, 3.0 * fine, FAINT_INK.alpha(0.35));
    let tip = view.at([x, y + length]);
    let width = scene.thickness.iter().copied().fold(0.0, f64::max);
    picture.line(&[center, tip], view.length(width).max(2.0), GAIN.alpha(0.16));
    picture.dashed(&[center, tip], fine, 4.0 * fine, GAIN.alpha(0.55));
    picture.ring(tip, 0.045 * radius, 1.4 * fine, GAIN.alpha(0.85));
}

/// The way of the tip in the last 40 steps.
fn trail(picture: &mut Picture, view: &View, past: &Past) {
    let trail: Vec<_> = past.trail(40).map(|(m, fresh)| (view.at(m.tip), fresh)).collect();
    let widest = view.length(0.004).max(1.0);
    picture.fading(&trail, |fresh| widest * (0.3 + 0.7 * fresh), INK.alpha(0.3));
}

fn hub(picture: &mut Picture, view: &View, length: f64) {
    let (center, radius) = (view.at(view.world), view.length(0.032 * length).max(2.0));
    picture.disc(center, radius, INK);
    picture.disc(center, 0.62 * radius, STEEL);
    picture.disc(center, 0.24 * radius, WHITE);
}

/// An arc about the base in the sense of the torque, three quarters of a turn at its limit.
fn torque_arc(picture: &mut Picture, view: &View, scene: &Scene, length: f64) {
    let fraction = torque_fraction(scene) as f32;
    let center: Point = view.at(view.world);
    let radius = view.length(0.15 * length);
    let first = view.at(scene.nodes[1]);
    // Starts at the first edge, the one that it turns.
    let start = (center.1 - first.1).atan2(first.0 - center.0);
    let width = (radius / 13.0).max(1.0);
    picture.arc_arrow(center, radius, (start, 1.5 * PI * fraction), width, ACTUATOR);
}

/// Torque over its limit, in \[-1, 1\]; without a limit half way is 0.05 N m.
fn torque_fraction(scene: &Scene) -> f64 {
    let torque = value(scene, "torque").unwrap_or(0.0);
    match value(scene, "torque_limit").filter(|limit| *limit > 0.0) {
        Some(limit) => (torque / limit).clamp(-1.0, 1.0),
        None => torque / (torque.abs() + 0.05),
    }
}
