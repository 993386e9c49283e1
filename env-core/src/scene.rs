//! What there is to draw of one environment.

use crate::episodes::ResetOptions;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

/// What there is to draw of one environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// `pendulum` or `fin`.
    pub machine: String,
    /// Simulated time since the episode began \[s\].
    pub time: f64,
    /// Steps since the episode began.
    pub steps: u32,
    /// Node positions \[m\].
    pub nodes: Vec<[f64; 2]>,
    /// Thickness at the nodes \[m\].
    pub thickness: Vec<f64>,
    /// Signed curvature kappa at the nodes (0 at both ends, integrated: no unit).
    pub curvature: Vec<f64>,
    /// The last action, after clipping.
    pub action: Vec<f64>,
    /// Reward of the last step.
    pub reward: f64,
    /// Sum of rewards since the episode began.
    pub episode_return: f64,
    /// Named numbers that the picture may use: `torque` \[N m\], `torque_limit`, `length`, `thrust` \[N\],
    /// `pitch`, `flow_speed`, `hull_position`, ...
    pub values: Map<String, Value>,
    /// Named vectors that start at nodes, such as `fluid_force` \[N\]; one (x, y) a node.
    pub arrows: Map<String, Value>,
}

/// Positions \[m\] and velocities \[m/s\] of the nodes of one rod, (x, y) a node.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NodeState {
    /// Positions \[m\].
    pub positions: Vec<[f64; 2]>,
    /// Velocities \[m/s\].
    pub velocities: Vec<[f64; 2]>,
}

/// Exact starts are read alike for environments and simulations.
impl From<NodeState> for ResetOptions {
    fn from(state: NodeState) -> Self {
        let value = json!({"positions": state.positions, "velocities": state.velocities});
        ResetOptions { state: Some(value), ..ResetOptions::default() }
    }
}
