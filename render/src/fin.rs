//! The fin, seen from above: water that passes, forces, pitch and its command, thrust over time.

use crate::color::{ACTUATOR, DYE, FAINT_INK, GAIN, INK, LOSS, STEEL, WATER, WATER_LOW, WHITE};
use crate::gauges::{self, Layout};
use crate::past::{Moment, Past};
use crate::picture::{Ink, Picture, Point};
use crate::rod::Rod;
use crate::text::number;
use crate::view::{View, arrows, value};
use rodgym_core::env::Scene;
use tiny_skia::PathBuilder;

/// Turn of the whole fin \[rad\] that is shown in vivid colour.
const VIVID_TURN: f64 = 0.9;

/// Draws a checked scene.
pub(crate) fn draw(scene: &Scene, past: &Past, size: (u32, u32)) -> Picture {
    let mut picture = Picture::new(size, [WATER, WATER_LOW]);
    let (w, h) = picture.extent();
    let short = w.min(h);
    let layout = Layout::new(&picture);
    let hull = value(scene, "hull_position");
    let mount = [hull.unwrap_or(0.0), 0.0];
    // The trace takes the lower part of the picture, the fin the rest.
    let deep = if layout.is_some() { 0.76 * h } else { h };
    let (across, ahead) = if hull.is_some() { (0.44, 0.22) } else { (0.30, 0.10) };
    let mut view = View {
        world: mount,
        pixel: (w * (ahead / across) as f32, deep / 2.0),
        scale: (f64::from(w) / across).min(f64::from(deep) / 0.17),
    };
    if f64::from(w) > across * view.scale {
        view.pixel.0 = w / 2.0 - view.length(across / 2.0 - ahead);
    }
    let border = 0.04 * short;
    view.hold(&scene.nodes, (border, border), (w - border, deep - border));

    dye(&mut picture, &view, scene, past);
    water(&mut picture, &view, scene);
    if hull.is_some() {
        draw_hull(&mut picture, &view);
    }
    pitch(&mut picture, &view, scene, mount);
    let rod = Rod::new(scene, &view, VIVID_TURN);
    rod.shadow(&mut picture, (short / 90.0).min(8.0), INK.alpha(0.06));
    rod.body(&mut picture, (short / 450.0).max(0.6), INK);
    rod.nodes(&mut picture, scene, &view, (short / 300.0).max(0.8));
    forces(&mut picture, &view, scene, short);
    thrust_arrow(&mut picture, &view, scene, mount);
    let center = view.at(mount);
    picture.disc(center, short / 80.0, INK);
    picture.disc(center, short / 140.0, STEEL);

    if let Some(layout) = layout {
        readouts(&mut picture, layout, scene, past, deep);
    }
    picture
}

/// Short lines carried by the water: each belongs to a cell of a grid that moves with the flow.
fn water(picture: &mut Picture, view: &View, scene: &Scene) {
    const CELL: [f64; 2] = [0.045, 0.018];
    let (w, h) = picture.extent();
    let drift = value(scene, "flow_speed").unwrap_or(0.0) * scene.time;
    let metres = |pixels: f32| f64::from(pixels) / view.scale;
    let left = view.world[0] - metres(view.pixel.0) - drift;
    let right = view.world[0] + metres(w - view.pixel.0) - drift;
    let (top, low) = (metres(view.pixel.1), -metres(h - view.pixel.1));
    let cells = |a: f64, b: f64, cell: f64| {
        let first = (a / cell).floor() as i64 - 1;
        // No more than 80 cells however far the view reaches.
        (first, ((b / cell).ceil() as i64 - first).clamp(1, 80))
    };
    let (i0, columns) = cells(left, right, CELL[0]);
    let (j0, rows) = cells(low, top, CELL[1]);
    let mut paths = [PathBuilder::new(), PathBuilder::new()];
    for i in i0..i0 + columns {
        for j in j0..=j0 + rows {
            let chance = |k: u64| scatter(i as u64, j as u64, k);
            let x = (i as f64 + 0.5 * chance(0)) * CELL[0] + drift;
            let y = (j as f64 + chance(1)) * CELL[1];
            let length = CELL[0] * (0.12 + 0.38 * chance(2));
            let (a, b) = (view.at([x, y]), view.at([x + length, y]));
            let path = &mut paths[usize::from(chance(3) > 0.55)];
            path.move_to(a.0, a.1);
            path.line_to(b.0, b.1);
        }
    }
    let width = (w.min(h) / 300.0).max(0.7);
    for (path, (alpha, thick)) in paths.into_iter().zip([(0.55, 1.0), (0.85, 1.5)]) {
        let ink = Ink::Stroke { width: width * thick, dash: None };
        picture.add(path.finish(), WHITE.alpha(alpha), ink);
    }
}

/// A number in \[0, 1) that looks random but belongs to the cell (SplitMix64 of its coordinates).
fn scatter(i: u64, j: u64, k: u64) -> f64 {
    let mut z = i
        .wrapping_mul(0x9E37_79B9_7F4A_7C15)
        .wrapping_add(j.wrapping_mul(0xD1B5_4A32_D192_ED03))
        .wrapping_add(k.wrapping_mul(0x8CB9_2BA7_2F3D_8DD7));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Dye that left the tail in the last 100 steps and went on with the water.
fn dye(picture: &mut Picture, view: &View, scene: &Scene, past: &Past) {
    let flow = value(scene, "flow_speed").unwrap_or(0.0);
    let carried = |m: &Moment| view.at([m.tip[0] + flow * (scene.time - m.time), m.tip[1]]);
    let trail: Vec<_> = past.trail(100).map(|(m, fresh)| (carried(m), fresh)).collect();
    picture.fading(&trail, |fresh| view.length(0.0055 - 0.004 * f64::from(fresh)), DYE.alpha(0.4));
}

/// The float that the fin hangs from and pushes.
fn draw_hull(picture: &mut Picture, view: &View) {
    let [x, y] = view.world;
    let side = |up: f64| {
        (0..=24).map(move |i| {
            let s = (f64::from(i) / 24.0).powi(2);
            let half = 0.030 * (1.0 - (1.0 - s).powi(2)).sqrt() * (1.0 - 0.55 * s * s);
            [x - 0.2 + 0.225 * s, y + up * half]
        })
    };
    let shore: Vec<Point> = side(1.0).chain(side(-1.0).rev()).map(|p| view.at(p)).collect();
    picture.polygon(&shore, WHITE.alpha(0.55));
    let mut rim = shore.clone();
    rim.push(shore[0]);
    picture.line(&rim, (view.length(0.0012)).max(0.8), FAINT_INK);
}

/// The direction of no pitch, the commanded direction, and the angle between fin and no pitch.
fn pitch(picture: &mut Picture, view: &View, scene: &Scene, [x, y]: [f64; 2]) {
    let center = view.at([x, y]);
    let toward = |angle: f64, r: f64| view.at([x + r * angle.cos(), y + r * angle.sin()]);
    let fine = view.length(0.0007).clamp(0.7, 3.0);
    picture.dashed(&[center, toward(0.0, 0.125)], fine, 5.0 * fine, FAINT_INK.alpha(0.6));
    if let Some(target) = value(scene, "pitch_target") {
        picture.dashed(
            &[center, toward(target, 0.125)],
            1.6 * fine,
            4.0 * fine,
            ACTUATOR.alpha(0.8),
        );
    }
    if let Some(pitch) = value(scene, "pitch") {
        let arc: Vec<Point> = (0..=16).map(|i| toward(pitch * f64::from(i) / 16.0, 0.11)).collect();
        picture.line(&arc, 2.2 * fine, ACTUATOR);
    }
}

/// Length of an arrow \[px\] for a force \[N\]: proportional when small, never beyond `longest`.
fn arrow_length(force: f64, half_way: f64, longest: f32) -> f32 {
    (force / (force.abs() + half_way)) as f32 * longest
}

/// What the water does to every node.
fn forces(picture: &mut Picture, view: &View, scene: &Scene, short: f32) {
    for (node, [fx, fy]) in arrows(scene, "fluid_force") {
        let size = fx.hypot(fy);
        let length = arrow_length(size, 0.15, 0.22 * short);
        if length > 1.5 {
            let from = view.at(node);
            let (dx, dy) = ((fx / size) as f32 * length, -(fy / size) as f32 * length);
            let to = (from.0 + dx, from.1 + dy);
            picture.arrow(from, to, (short / 260.0).max(0.8), INK.alpha(0.55));
        }
    }
}

/// The thrust on the mount: upstream (left) when the fin pushes forward.
fn thrust_arrow(picture: &mut Picture, view: &View, scene: &Scene, [x, y]: [f64; 2]) {
    let Some(thrust) = value(scene, "thrust") else { return };
    let room = view.length(0.05);
    let length = arrow_length(thrust, 0.12, room);
    let nose = view.at([x - 0.048, y]);
    let color = if thrust < 0.0 { LOSS } else { GAIN };
    let from = if thrust < 0.0 { nose.0 - room } else { nose.0 };
    picture.arrow((from, nose.1), (from - length, nose.1), view.length(0.0022).max(1.2), color);
}

fn readouts(picture: &mut Picture, layout: Layout, scene: &Scene, past: &Past, deep: f32) {
    let (w, h) = picture.extent();
    gauges::clock(picture, layout, scene);
    gauges::reward(picture, layout, scene);
    let gap = 0.6 * layout.font;
    let mut rows: Vec<(&str, String)> = vec![];
    if let Some(pitch) = value(scene, "pitch") {
        rows.push(("pitch", format!("{}°", number(pitch.to_degrees(), 1))));
    }
    if let Some(thrust) = value(scene, "thrust") {
        rows.push(("thrust", format!("{} mN", number(1e3 * thrust, 0))));
    }
    if let Some(speed) = value(scene, "hull_speed") {
        rows.push(("speed", format!("{} m/s", number(speed, 3))));
    } else if let Some(flow) = value(scene, "flow_speed") {
        rows.push(("flow", format!("{} m/s", number(flow, 3))));
    }
    let key_top = h - layout.margin - 2.0 * layout.font;
    let top = key_top - layout.line() * (rows.len() as f32 - 0.25);
    let low = (0.4 * layout.margin, (top - 1.6 * layout.font).min(deep + gap));
    let high = (layout.margin + layout.bar + 0.6 * layout.margin, h - 0.4 * layout.margin);
    gauges::panel(picture, layout, low, high);
    for (k, (caption, text)) in rows.iter().enumerate() {
        let baseline = top + layout.line() * k as f32;
        gauges::reading(picture, layout, (layout.margin, baseline), caption, text);
    }
    gauges::bend_key(picture, layout, (layout.margin, h - layout.margin));
    let corners = ((high.0 + gap, low.1), (w - 0.4 * layout.margin, high.1));
    gauges::thrust_trace(picture, layout, corners, past, value(scene, "demand"));
}
