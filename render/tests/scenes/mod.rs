//! Scenes for tests, made from edge angles as the core makes them.
#![allow(dead_code, reason = "each test file uses its own part")]

use rodgym_core::env::Scene;
use serde_json::json;

fn scene(machine: &str, nodes: Vec<[f64; 2]>, thickness: Vec<f64>, angles: &[f64]) -> Scene {
    let mut curvature: Vec<f64> =
        angles.windows(2).map(|w| 2.0 * ((w[1] - w[0]) / 2.0).tan()).collect();
    curvature.insert(0, 0.0);
    curvature.push(0.0);
    Scene {
        machine: machine.into(),
        time: 3.42,
        steps: 342,
        nodes,
        thickness,
        curvature,
        action: vec![0.6],
        reward: 0.83,
        episode_return: 123.4,
        values: Default::default(),
        arrows: Default::default(),
    }
}

/// A pendulum of length 0.3 m with these edge angles from hanging down \[rad\].
pub fn pendulum(angles: &[f64], torque: f64) -> Scene {
    let edge = 0.3 / angles.len() as f64;
    let mut nodes = vec![[0.0, 0.0]];
    for a in angles {
        let [x, y] = nodes[nodes.len() - 1];
        nodes.push([x + edge * a.sin(), y - edge * a.cos()]);
    }
    let n = nodes.len();
    let mut scene = scene("pendulum", nodes, vec![0.007; n], angles);
    let values = json!({"torque": torque, "torque_limit": 0.05, "length": 0.3});
    scene.values = values.as_object().expect("an object").clone();
    scene
}

/// The thesis fin with these edge angles from downstream \[rad\].
pub fn fin(angles: &[f64; 7], time: f64) -> Scene {
    let at = |from: [f64; 2], a: f64, way: f64| {
        [from[0] + way * 0.02 * a.cos(), from[1] + way * 0.02 * a.sin()]
    };
    let pivot = [0.0, 0.0];
    let node2 = at(pivot, angles[1], -1.0);
    let mut nodes = vec![at(node2, angles[0], -1.0), node2, pivot];
    for a in &angles[2..] {
        nodes.push(at(nodes[nodes.len() - 1], *a, 1.0));
    }
    let thickness = vec![0.0, 0.0185, 0.0185, 0.0168, 0.0134, 0.0099, 0.0036, 0.002];
    let mut scene = scene("fin", nodes, thickness, angles);
    scene.time = time;
    let values = json!({"pitch": angles[2], "pitch_target": 0.3, "flow_speed": 0.05,
        "thrust": 0.12});
    scene.values = values.as_object().expect("an object").clone();
    let force: Vec<[f64; 2]> =
        (0..8).map(|i| [-0.01 * f64::from(i), 0.04 * f64::from(i - 3)]).collect();
    scene.arrows.insert("fluid_force".into(), json!(force));
    scene
}
