//! The linear motion of the pendulum near a state.

use super::sim::BarePendulum;
use crate::linear::Banded;
use crate::rod::{Motion, add_stiffness};

/// Matrices of the motion near a state, row-major: `dz/dt = A (z - z0) + B T`, `y = C (z - z0)`.
///
/// z = displacements of the nodes after the pinned one (x, y a node) \[m\], then their velocities \[m/s\]: 4(N-1)
/// states. y = the angle of every edge \[rad\], then its rate \[rad/s\].
#[derive(Clone, Debug, PartialEq)]
pub struct Linear {
    /// Number of states.
    pub states: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// (states, states).
    pub a: Vec<f64>,
    /// (states, 1).
    pub b: Vec<f64>,
    /// (outputs, states).
    pub c: Vec<f64>,
}

impl BarePendulum {
    /// The linear motion near the present state, for a base torque near `torque` \[N m\]. Poles and the like mean
    /// something where the state is an equilibrium; upright, every edge is a little shorter than at
    /// rest, by the weight above it, and without that gravity would not turn the rod over.
    pub fn linearize(&self, torque: f64) -> Linear {
        let nodes = self.rod.nodes();
        let n = 2 * (nodes - 1);
        let Motion { x, v, .. } = &self.motion;
        let stiffness = |rate: f64| {
            let mut matrix = Banded::new(nodes - 1);
            add_stiffness(&self.rod, x, v, torque, rate, 1, &mut matrix);
            matrix
        };
        let (k, kd) = (stiffness(0.0), stiffness(1.0));
        let states = 2 * n;
        let mut a = vec![0.0; states * states];
        let mut b = vec![0.0; states];
        let mut c = vec![0.0; n * states];
        for i in 0..n {
            a[i * states + n + i] = 1.0;
            let inverse = self.rod.inverse_mass[i / 2 + 1];
            for j in 0..n {
                a[(n + i) * states + j] = -inverse * k.get(i, j);
                a[(n + i) * states + n + j] = -inverse * (kd.get(i, j) - k.get(i, j));
            }
        }
        for (edge, (e, de)) in self.edges().enumerate() {
            let length2 = e.dot(e);
            let slope = e.perp().scale(1.0 / length2);
            let turn = (-de.perp() - e.scale(2.0 * e.cross(de) / length2)).scale(1.0 / length2);
            if edge == 0 {
                b[n] = self.rod.inverse_mass[1] * slope.x;
                b[n + 1] = self.rod.inverse_mass[1] * slope.y;
            }
            // The edge's end is node edge + 1, at column 2 edge; its start is one node before.
            for (column, sign) in [(2 * edge, 1.0), ((2 * edge).wrapping_sub(2), -1.0)] {
                if column >= n {
                    continue;
                }
                let rates = edge + nodes - 1;
                for (offset, (s, t)) in [(slope.x, turn.x), (slope.y, turn.y)].iter().enumerate() {
                    c[edge * states + column + offset] = sign * s;
                    c[rates * states + column + offset] = sign * t;
                    c[rates * states + n + column + offset] = sign * s;
                }
            }
        }
        Linear { states, outputs: n, a, b, c }
    }
}
