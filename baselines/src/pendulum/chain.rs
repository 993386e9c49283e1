//! A reduced nonlinear model: the inextensible rod whose angle is a polynomial along its length.
//!
//! The chain of thesis (4.3)-(4.6) with n edges has angles theta; here theta = S q with k <= n columns,
//! the discrete Legendre polynomials of the edge number. For k = n that is the thesis' model in other
//! coordinates; for k < n it is Galerkin's projection of it (mass, gravity, bending and torque are
//! those of the fine chain), which has the fine chain's low modes whatever n is. That is what lets a
//! controller of order 12 hold a rod of 31 nodes.

use super::RodDesign;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Most coordinates that a model may have.
pub const MAX_COORDINATES: usize = 16;

/// A vector of coordinates, padded.
type Coordinates = [f64; MAX_COORDINATES];

/// The reduced chain.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(from = "Made", into = "Made")]
pub struct Chain {
    rod: RodDesign,
    coordinates: usize,
    /// Rows of S, one an edge.
    shape: Vec<Coordinates>,
    /// Mass of the node at the far end of each edge \[kg\].
    mass: Vec<f64>,
}

/// What a chain is made of: all that a file needs to hold.
#[derive(Serialize, Deserialize)]
struct Made {
    rod: RodDesign,
    coordinates: usize,
}

impl From<Made> for Chain {
    fn from(made: Made) -> Self {
        Chain::new(&made.rod, made.coordinates)
    }
}

impl From<Chain> for Made {
    fn from(chain: Chain) -> Self {
        Made { rod: chain.rod, coordinates: chain.coordinates }
    }
}

/// Energy of the chain \[J\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChainEnergy {
    /// Of motion.
    pub kinetic: f64,
    /// Of bending.
    pub bending: f64,
    /// Of height, 0 with every node at the pivot.
    pub gravity: f64,
}

impl ChainEnergy {
    /// The sum.
    pub fn total(&self) -> f64 {
        self.kinetic + self.bending + self.gravity
    }
}

/// Position and velocity of a node, as the sums along the chain build them up.
#[derive(Clone, Copy, Default)]
struct Node {
    y: f64,
    vx: f64,
    vy: f64,
}

impl Chain {
    /// The chain of a rod with at most `coordinates` coordinates (no more than there are edges).
    pub fn new(rod: &RodDesign, coordinates: usize) -> Self {
        let n = rod.edges();
        let k = coordinates.clamp(1, n.min(MAX_COORDINATES));
        let basis = legendre(n, k);
        let shape = (0..n)
            .map(|i| {
                let mut row = [0.0; MAX_COORDINATES];
                (0..k).for_each(|j| row[j] = basis[(i, j)]);
                row
            })
            .collect();
        let mass = (0..n)
            .map(|i| if i == n - 1 { 0.5 * rod.node_mass() } else { rod.node_mass() })
            .collect();
        Chain { rod: rod.clone(), coordinates: k, shape, mass }
    }

    /// Number of coordinates k; the state has 2k numbers.
    pub fn coordinates(&self) -> usize {
        self.coordinates
    }

    /// Number of edges n of the chain.
    pub fn edges(&self) -> usize {
        self.shape.len()
    }

    /// The rod it was made of.
    pub fn rod(&self) -> &RodDesign {
        &self.rod
    }

    /// S, (n, k): angles of the edges from coordinates.
    pub fn shape(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.shape.len(), self.coordinates, |i, j| self.shape[i][j])
    }

    /// Angle of the base edge \[rad\] (or its rate, from rates).
    pub fn base(&self, q: &[f64]) -> f64 {
        dot(&self.shape[0], q)
    }

    /// Row of S of the base edge: base angle = row . q.
    pub fn base_row(&self) -> Vec<f64> {
        self.shape[0][..self.coordinates].to_vec()
    }

    /// Angles of every edge (or rates, from rates).
    pub fn angles(&self, q: &[f64]) -> Vec<f64> {
        self.shape.iter().map(|row| dot(row, q)).collect()
    }

    /// Coordinates nearest to given angles of every edge (or rates); S has orthogonal columns.
    pub fn coordinates_of(&self, angles: &[f64]) -> Vec<f64> {
        let mut q = vec![0.0; self.coordinates];
        self.project(angles.iter().copied(), &mut q);
        q
    }

    /// As `coordinates_of`, into a slice of zeros.
    pub fn project(&self, angles: impl Iterator<Item = f64>, q: &mut [f64]) {
        for (row, angle) in self.shape.iter().zip(angles) {
            for (q, s) in q.iter_mut().zip(row) {
                *q += s * angle;
            }
        }
    }

    /// Coordinates of the straight rod at an angle.
    pub fn straight(&self, angle: f64) -> Vec<f64> {
        self.coordinates_of(&vec![angle; self.shape.len()])
    }

    /// Accelerations of the coordinates under a base torque \[N m\]: thesis (4.3)-(4.7), with drag zeta and
    /// bending damping beta.
    pub fn acceleration(&self, q: &[f64], rates: &[f64], torque: f64, out: &mut [f64]) {
        let k = self.coordinates;
        let l = self.rod.edge_length();
        let stiffness = self.rod.bending_stiffness() / l;
        let (gravity, drag, beta) = (self.rod.gravity, self.rod.damping, self.rod.bending_damping);
        let mut inertia = [[0.0; MAX_COORDINATES]; MAX_COORDINATES];
        let mut force = [0.0; MAX_COORDINATES];
        // Jacobian of the current node, its velocity, and its acceleration at constant rates.
        let (mut jx, mut jy) = ([0.0; MAX_COORDINATES], [0.0; MAX_COORDINATES]);
        let (mut vx, mut vy, mut ax, mut ay) = (0.0, 0.0, 0.0, 0.0);
        let (mut before, mut rate_before) = ((0.0, 0.0), 0.0);
        for (i, (row, &mass)) in self.shape.iter().zip(&self.mass).enumerate() {
            let (angle, rate) = (dot(row, q), dot(row, rates));
            let (sin, cos) = libm::sincos(angle);
            for j in 0..k {
                jx[j] += l * cos * row[j];
                jy[j] += l * sin * row[j];
            }
            vx += l * cos * rate;
            vy += l * sin * rate;
            ax -= l * sin * rate * rate;
            ay += l * cos * rate * rate;
            let fx = -mass * ax - drag * vx;
            let fy = -mass * (ay + gravity) - drag * vy;
            for a in 0..k {
                force[a] += jx[a] * fx + jy[a] * fy;
                let (mx, my) = (mass * jx[a], mass * jy[a]);
                for b in 0..=a {
                    inertia[a][b] += mx * jx[b] + my * jy[b];
                }
            }
            if i > 0 {
                let (sin_before, cos_before) = before;
                let cross = cos_before * sin - sin_before * cos;
                let curvature = 2.0 * cross / (1.0 + cos_before * cos + sin_before * sin);
                let moment = stiffness
                    * (curvature * (1.0 + 0.25 * curvature * curvature)
                        + beta * (rate - rate_before));
                for j in 0..k {
                    force[j] -= moment * (row[j] - self.shape[i - 1][j]);
                }
            }
            (before, rate_before) = ((sin, cos), rate);
        }
        for j in 0..k {
            force[j] += self.shape[0][j] * torque;
        }
        solve(&mut inertia, &mut force, k);
        out[..k].copy_from_slice(&force[..k]);
    }

    /// One step of the classical Runge-Kutta method: state (coordinates, rates), torque held.
    pub fn step(&self, state: &mut [f64], torque: f64, dt: f64) {
        let k = self.coordinates;
        let start: Vec<f64> = state.to_vec();
        let mut at = start.clone();
        let mut slope = [0.0; 2 * MAX_COORDINATES];
        for (weight, ahead) in [(1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)] {
            let (q, rates) = at.split_at(k);
            slope[..k].copy_from_slice(rates);
            self.acceleration(q, rates, torque, &mut slope[k..2 * k]);
            for i in 0..2 * k {
                state[i] += dt / 6.0 * weight * slope[i];
                at[i] = start[i] + dt * ahead * slope[i];
            }
        }
    }

    /// A = df/dx and B = df/dT of the state equation at a state and torque, by central differences of
    /// the accelerations (their error, 1e-9 of the terms, is nothing to the model's own).
    pub fn linearize(&self, state: &[f64], torque: f64) -> (DMatrix<f64>, DVector<f64>) {
        let k = self.coordinates;
        let mut a = DMatrix::zeros(2 * k, 2 * k);
        let (mut plus, mut minus) = ([0.0; MAX_COORDINATES], [0.0; MAX_COORDINATES]);
        let mut at = state.to_vec();
        for j in 0..2 * k {
            let h = if j < k { 1e-5 } else { 1e-3 };
            at[j] = state[j] + h;
            self.acceleration(&at[..k], &at[k..], torque, &mut plus);
            at[j] = state[j] - h;
            self.acceleration(&at[..k], &at[k..], torque, &mut minus);
            at[j] = state[j];
            for i in 0..k {
                a[(k + i, j)] = (plus[i] - minus[i]) / (2.0 * h);
            }
        }
        a.view_mut((0, k), (k, k)).fill_with_identity();
        // The torque enters linearly.
        self.acceleration(&at[..k], &at[k..], torque + 1.0, &mut plus);
        self.acceleration(&at[..k], &at[k..], torque, &mut minus);
        let mut b = DVector::zeros(2 * k);
        for i in 0..k {
            b[k + i] = plus[i] - minus[i];
        }
        (a, b)
    }

    /// Energy at a state.
    pub fn energy(&self, state: &[f64]) -> ChainEnergy {
        let (q, rates) = state.split_at(self.coordinates);
        let l = self.rod.edge_length();
        let stiffness = self.rod.bending_stiffness() / l;
        let mut energy = ChainEnergy::default();
        let mut node = Node::default();
        let mut before: Option<(f64, f64)> = None;
        for (row, &mass) in self.shape.iter().zip(&self.mass) {
            let (angle, rate) = (dot(row, q), dot(row, rates));
            let (sin, cos) = libm::sincos(angle);
            node.y -= l * cos;
            node.vx += l * cos * rate;
            node.vy += l * sin * rate;
            energy.kinetic += 0.5 * mass * (node.vx * node.vx + node.vy * node.vy);
            energy.gravity += mass * self.rod.gravity * node.y;
            if let Some((sin_before, cos_before)) = before {
                let cross = cos_before * sin - sin_before * cos;
                let curvature = 2.0 * cross / (1.0 + cos_before * cos + sin_before * sin);
                energy.bending += 0.5 * stiffness * curvature * curvature;
            }
            before = Some((sin, cos));
        }
        energy
    }
}

#[inline(always)]
fn dot(row: &Coordinates, q: &[f64]) -> f64 {
    q.iter().zip(row).map(|(q, s)| q * s).sum()
}

/// Orthonormal columns: polynomials of degree 0..k of the edge number, by Gram and Schmidt (twice, for
/// rounding).
fn legendre(n: usize, k: usize) -> DMatrix<f64> {
    let mut basis = DMatrix::zeros(n, k);
    for degree in 0..k {
        let mut column = if degree == 0 {
            DVector::from_element(n, 1.0)
        } else {
            // Multiplying the last polynomial by the coordinate raises its degree by one.
            DVector::from_fn(n, |i, _| {
                let s = (2 * i + 1) as f64 / n as f64 - 1.0;
                s * basis[(i, degree - 1)]
            })
        };
        for _ in 0..2 {
            for j in 0..degree {
                let previous = basis.column(j).into_owned();
                let overlap = previous.dot(&column);
                column -= previous * overlap;
            }
        }
        basis.set_column(degree, &column.normalize());
    }
    basis
}

/// Solves M x = f in place by Cholesky's decomposition; M is given by its lower half.
#[inline(always)]
fn solve(m: &mut [[f64; MAX_COORDINATES]; MAX_COORDINATES], f: &mut Coordinates, k: usize) {
    for i in 0..k {
        for j in 0..=i {
            let mut sum = m[i][j];
            for c in 0..j {
                sum -= m[i][c] * m[j][c];
            }
            m[i][j] = if i == j { libm::sqrt(sum) } else { sum / m[j][j] };
        }
    }
    for i in 0..k {
        for c in 0..i {
            f[i] -= m[i][c] * f[c];
        }
        f[i] /= m[i][i];
    }
    for i in (0..k).rev() {
        for c in i + 1..k {
            f[i] -= m[c][i] * f[c];
        }
        f[i] /= m[i][i];
    }
}
