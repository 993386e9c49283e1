//! Promises of the pictures: right shape, the same bytes every time, the rod where its nodes are and
//! in the colour of its bend, nothing that breaks on extreme or incomplete scenes.

mod scenes;

use rodgym_core::Error;
use rodgym_core::env::Scene;
use rodgym_render::{Painter, SIZE_LIMITS, drawing, render, render_svg};
use scenes::{fin, pendulum};
use serde_json::json;
use std::f64::consts::PI;

const STRAIGHT_FIN: [f64; 7] = [0.0; 7];

fn pixel(rgb: &[u8], width: u32, (x, y): (u32, u32)) -> [u8; 3] {
    let i = 3 * (y * width + x) as usize;
    [rgb[i], rgb[i + 1], rgb[i + 2]]
}

fn difference(a: [u8; 3], b: [u8; 3]) -> u32 {
    a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(b))).sum()
}

/// Where the pendulum picture of side `size` shows a point of the plane.
fn pendulum_pixel(size: u32, [x, y]: [f64; 2]) -> (u32, u32) {
    let scale = f64::from(size) / (2.0 * 1.16 * 0.3);
    let middle = f64::from(size) / 2.0;
    ((middle + x * scale) as u32, (middle - y * scale) as u32)
}

#[test]
fn every_size_gives_three_bytes_a_pixel() {
    for scene in [pendulum(&[1.0, 2.0], 0.01), fin(&STRAIGHT_FIN, 0.0)] {
        for size in
            [(480, 480), (960, 540), (64, 64), (16, 300), (301, 17), drawing("fin").unwrap().size]
        {
            let rgb = render(&scene, size).unwrap();
            assert_eq!(rgb.len(), (3 * size.0 * size.1) as usize, "{size:?}");
        }
    }
}

#[test]
fn the_same_scene_gives_the_same_bytes_in_any_thread() {
    let scene = fin(&[0.2, 0.2, 0.2, 0.1, 0.0, -0.2, -0.3], 1.7);
    let here = render(&scene, (320, 200)).unwrap();
    let there = std::thread::spawn(move || render(&scene, (320, 200)).unwrap()).join().unwrap();
    assert!(here == there);
}

#[test]
fn the_rod_is_drawn_where_its_nodes_are() {
    for angle in [0.0, 0.7, PI / 2.0, 2.2, PI, -1.0, -2.5] {
        let scene = pendulum(&[angle; 6], 0.0);
        let other = pendulum(&[angle + 0.9; 6], 0.0);
        let [with, without] = [&scene, &other].map(|s| render(s, (480, 480)).unwrap());
        // Half way between nodes, which carry white dots.
        for edge in scene.nodes.windows(2) {
            let node = [(edge[0][0] + edge[1][0]) / 2.0, (edge[0][1] + edge[1][1]) / 2.0];
            let at = pendulum_pixel(480, node);
            let d = difference(pixel(&with, 480, at), pixel(&without, 480, at));
            assert!(d > 100, "angle {angle}, node {node:?} at {at:?}: differs by {d} only");
        }
    }
}

#[test]
fn bend_is_orange_to_the_left_and_blue_to_the_right() {
    // Bent evenly, as seen from the base: counter-clockwise, then its mirror image.
    let left: Vec<f64> = (0..12).map(|i| 0.5 + 0.15 * f64::from(i)).collect();
    let right: Vec<f64> = left.iter().map(|a| -a).collect();
    for (angles, orange) in [(left, true), (right, false)] {
        let scene = pendulum(&angles, 0.0);
        let rgb = render(&scene, (960, 960)).unwrap();
        // Between nodes, which carry white dots.
        let [a, b] = [scene.nodes[6], scene.nodes[7]];
        let middle = [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0];
        let [r, _, b] = pixel(&rgb, 960, pendulum_pixel(960, middle));
        assert_eq!(r > b, orange, "red {r}, blue {b}");
        assert!(r.abs_diff(b) > 60);
    }
}

#[test]
fn the_pendulum_never_leaves_the_picture() {
    // Without readouts nothing may touch the border, however far the rod is stretched or thrown.
    for stretch in [0.5, 1.0, 1.15, 1.5, 10.0] {
        for k in 0..12 {
            let angle = f64::from(k) * PI / 6.0;
            let mut scene = pendulum(&[angle, angle + 0.2, angle - 0.1, angle], 0.05);
            for p in &mut scene.nodes {
                *p = p.map(|v| v * stretch);
            }
            let size = (150, 120);
            let rgb = render(&scene, size).unwrap();
            for y in 0..size.1 {
                let row = pixel(&rgb, size.0, (0, y));
                assert_eq!(pixel(&rgb, size.0, (size.0 - 1, y)), row, "{stretch} {angle} row {y}");
            }
            for x in 0..size.0 {
                for y in [0, size.1 - 1] {
                    let corner = pixel(&rgb, size.0, (0, y));
                    assert_eq!(pixel(&rgb, size.0, (x, y)), corner, "{stretch} {angle} column {x}");
                }
            }
        }
    }
}

#[test]
fn torque_of_either_sense_shows() {
    let angles = [0.3; 6];
    let none = render(&pendulum(&angles, 0.0), (120, 120)).unwrap();
    let pictures = [-0.05, 0.05, 0.02].map(|t| render(&pendulum(&angles, t), (120, 120)).unwrap());
    for (i, picture) in pictures.iter().enumerate() {
        assert!(*picture != none);
        assert!(pictures[i + 1..].iter().all(|other| other != picture));
    }
}

#[test]
fn water_passes_the_fin_and_time_alone_moves_still_water_nowhere() {
    let (early, late) = (fin(&STRAIGHT_FIN, 1.0), fin(&STRAIGHT_FIN, 1.3));
    let size = (100, 100);
    assert!(render(&early, size).unwrap() != render(&late, size).unwrap());
    let still = |scene: &Scene| {
        let mut scene = scene.clone();
        scene.values.insert("flow_speed".into(), 0.0.into());
        render(&scene, size).unwrap()
    };
    assert!(still(&early) == still(&late));
}

#[test]
fn a_hull_that_swims_keeps_its_place_while_the_water_moves() {
    let size = (100, 100);
    let at = |x: f64| {
        let mut scene = fin(&STRAIGHT_FIN, 0.0);
        for node in &mut scene.nodes {
            node[0] += x;
        }
        scene.values.insert("hull_position".into(), x.into());
        render(&scene, size).unwrap()
    };
    let (start, later) = (at(0.0), at(-0.7137));
    let moved = start.iter().zip(&later).filter(|(a, b)| a.abs_diff(**b) > 8).count();
    assert!(moved > 100, "the water stands still: {moved} bytes differ");
    // The middle of the fin's root, dark and opaque.
    let darkest = |rgb: &[u8]| rgb.chunks(3).enumerate().min_by_key(|(_, p)| p[0]).unwrap().0;
    let (a, b) = (darkest(&start) as i64, darkest(&later) as i64);
    assert!((a % 100 - b % 100).abs() <= 1 && (a / 100 - b / 100).abs() <= 1);
}

#[test]
fn a_painter_shows_the_way_of_the_tip_until_the_next_episode() {
    let at = |steps, angle| Scene { steps, ..pendulum(&[angle; 6], 0.0) };
    let size = (200, 200);
    let mut painter = Painter::default();
    for step in 0..20 {
        painter.render(&at(step, 0.05 * f64::from(step)), size).unwrap();
    }
    let now = at(20, 1.0);
    let (with, without) = (painter.render(&now, size).unwrap(), render(&now, size).unwrap());
    let [x, y] = at(10, 0.5).nodes[6];
    let place = {
        let scale = 200.0 / (2.0 * 1.16 * 0.3);
        ((100.0 + x * scale) as u32, (100.0 - y * scale) as u32)
    };
    assert!(difference(pixel(&with, 200, place), pixel(&without, 200, place)) > 20);
    let start = at(0, 1.0);
    assert!(painter.render(&start, size).unwrap() == render(&start, size).unwrap());
}

#[test]
fn a_demanded_thrust_shows_in_the_trace() {
    let size = (480, 300);
    let pictures = [None, Some(0.02), Some(0.09)].map(|demand| {
        let mut scene = fin(&STRAIGHT_FIN, 0.0);
        if let Some(demand) = demand {
            scene.values.insert("demand".into(), demand.into());
        }
        render(&scene, size).unwrap()
    });
    assert!(pictures[0] != pictures[1] && pictures[1] != pictures[2]);
}

#[test]
fn a_picture_that_is_refused_is_not_remembered() {
    let at = |steps, angle| Scene { steps, ..pendulum(&[angle; 6], 0.0) };
    let mut painter = Painter::default();
    let size = (200, 200);
    painter.render(&at(0, 0.0), size).unwrap();
    let mut untouched = painter.clone();
    assert!(painter.render(&at(1, 2.0), (0, 0)).is_err());
    let next = at(2, 0.5);
    assert!(painter.render(&next, size).unwrap() == untouched.render(&next, size).unwrap());
}

#[test]
fn scenes_with_little_in_them_can_be_drawn() {
    let mut bare = pendulum(&[1.0], 0.0);
    bare.values.clear();
    bare.reward = f64::NAN;
    let mut null = fin(&STRAIGHT_FIN, f64::INFINITY);
    for value in null.values.values_mut() {
        *value = json!(null);
    }
    null.arrows.insert("fluid_force".into(), json!([[1.0, null], "x", [1e300, -1e300]]));
    let mut point = pendulum(&[0.0; 6], 0.0);
    point.nodes.fill([0.0, 0.0]);
    let long = pendulum(&[0.001; 1000], 0.0);
    let mut wild = pendulum(&[0.4; 6], 1e300);
    wild.curvature.fill(-1e308);
    wild.thickness.fill(0.0);
    wild.values.remove("torque_limit");
    for scene in [bare, null, point, long, wild] {
        for size in [(16, 16), (200, 170)] {
            assert_eq!(render(&scene, size).unwrap().len(), (3 * size.0 * size.1) as usize);
            let svg = render_svg(&scene, size).unwrap();
            assert!(!svg.contains("NaN") && !svg.contains("inf"));
        }
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_by_name() {
    let good = pendulum(&[1.0, 2.0], 0.0);
    let refused = |change: &dyn Fn(&mut Scene), size| {
        let mut scene = good.clone();
        change(&mut scene);
        render(&scene, size).unwrap_err().to_string()
    };
    let size = (100, 100);
    for (message, part) in [
        (refused(&|s| s.nodes[1] = [f64::NAN, 0.0], size), "scene.nodes[1] = (NaN, 0)"),
        (refused(&|s| s.nodes.truncate(1), size), "scene.nodes has shape (1,)"),
        (refused(&|s| s.thickness.truncate(2), size), "scene.thickness has shape (2,)"),
        (refused(&|s| s.curvature[2] = f64::INFINITY, size), "scene.curvature[2] = inf"),
        (refused(&|s| s.machine = "boat".into(), size), "scene.machine = boat"),
        (refused(&|_| (), (0, 100)), "picture width = 0"),
        (refused(&|_| (), (100, SIZE_LIMITS.1 + 1)), "picture height = 8193"),
    ] {
        assert!(message.starts_with(part), "{message}");
    }
    assert!(matches!(render(&good, (1, 1)), Err(Error::Parameter { .. })));
}

#[test]
fn svg_shows_every_shape_once() {
    let svg = render_svg(&pendulum(&[2.0, 2.5, 3.0], 0.03), (480, 480)).unwrap();
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    let paths = svg.matches("<path ").count();
    assert!(paths > 20, "{paths}");
    assert_eq!(svg.matches("/>").count(), paths + 3, "paths, two stops and the background");
}
