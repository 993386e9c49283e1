//! The inextensible chain about the upright equilibrium, thesis (4.9)-(4.12).

use super::RodDesign;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// z' = A z + B u, y = C z.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearModel {
    /// State matrix (s, s).
    pub a: DMatrix<f64>,
    /// Input matrix (s, 1): base torque \[N m\].
    pub b: DMatrix<f64>,
    /// Output matrix (2, s): base angle \[rad\] and base rate \[rad/s\], thesis (4.18).
    pub c: DMatrix<f64>,
}

/// Weights of the regulator's cost, thesis (4.14).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Weights {
    /// Q_theta, on every angle \[1/rad^2\].
    pub angle: f64,
    /// Q_thetadot, on every rate \[s^2/rad^2\].
    pub rate: f64,
    /// R, on the torque \[1/(N m)^2\].
    pub torque: f64,
}

impl Default for Weights {
    /// The weights of the thesis.
    fn default() -> Self {
        Weights { angle: 100.0, rate: 0.01, torque: 1.0 }
    }
}

impl Weights {
    /// The weights by name, for reports.
    pub fn by_name(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("angle_weight", self.angle),
            ("rate_weight", self.rate),
            ("torque_weight", self.torque),
        ]
    }

    /// Q and R for a chain of `edges`.
    pub fn matrices(&self, edges: usize) -> (DMatrix<f64>, DMatrix<f64>) {
        let diagonal = |i: usize| if i < edges { self.angle } else { self.rate };
        let q =
            DMatrix::from_fn(2 * edges, 2 * edges, |i, j| if i == j { diagonal(i) } else { 0.0 });
        (q, DMatrix::from_element(1, 1, self.torque))
    }
}

/// The model about up: state (theta_i - pi, thetadot_i), input base torque.
///
/// With M the inertia (4.4) at equal angles, D the difference of neighbours and S_b = (EI/l) D'D,
/// M z'' = (G - S_b) z - (beta S_b + Z) z' + e_1 u, where G is the diagonal of gravity and Z the drag
/// zeta on every node. For zeta = beta = 0 this is (4.10)-(4.12).
pub fn upright(rod: &RodDesign) -> LinearModel {
    let n = rod.edges();
    let l = rod.edge_length();
    let stiffness = rod.bending_stiffness() / l;
    let inertia = DMatrix::from_fn(n, n, |i, j| l * l * rod.mass_beyond(i.max(j)));
    let mut bending = DMatrix::<f64>::zeros(n, n);
    for i in 1..n {
        bending[(i - 1, i - 1)] += stiffness;
        bending[(i, i)] += stiffness;
        bending[(i - 1, i)] -= stiffness;
        bending[(i, i - 1)] -= stiffness;
    }
    let stiff = DMatrix::from_fn(n, n, |i, j| {
        let gravity = if i == j { rod.gravity * l * rod.mass_beyond(i) } else { 0.0 };
        gravity - bending[(i, j)]
    });
    let drag = DMatrix::from_fn(n, n, |i, j| {
        let nodes_beyond = (n - i.max(j)) as f64;
        -rod.damping * l * l * nodes_beyond - rod.bending_damping * bending[(i, j)]
    });
    let inertia = inertia.cholesky().expect("the inertia of a chain is positive definite");

    let mut a = DMatrix::zeros(2 * n, 2 * n);
    a.view_mut((0, n), (n, n)).fill_with_identity();
    a.view_mut((n, 0), (n, n)).copy_from(&inertia.solve(&stiff));
    a.view_mut((n, n), (n, n)).copy_from(&inertia.solve(&drag));
    let mut e1 = DMatrix::zeros(n, 1);
    e1[0] = 1.0;
    let mut b = DMatrix::zeros(2 * n, 1);
    b.view_mut((n, 0), (n, 1)).copy_from(&inertia.solve(&e1));
    let mut c = DMatrix::zeros(2, 2 * n);
    c[(0, 0)] = 1.0;
    c[(1, n)] = 1.0;
    LinearModel { a, b, c }
}
