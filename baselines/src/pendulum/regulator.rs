//! The law that all our pendulum controllers share: a regulator that is also the swing-up.
//!
//! A sampled linear regulator of high control cost, its torque limited to a little more than the rod's
//! own weight at arm's length, brings a flexible rod up from anywhere: it pushes the base past the
//! rod, and the rod is thrown after. More torque would only bend the rod. Where that does not come up
//! (a motor that cannot lift the rod may hold it at an angle for ever), energy is pumped, swing by
//! swing, until the regulator can catch the rod.

use super::{Chain, MAX_COORDINATES, RodDesign, Weights};
use crate::error::Result;
use crate::linalg::{dare, sample_cost};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Gravity \[m/s^2\] that sets the law's pace and its torque where there is less. The swing of a rod in
/// hardly any gravity takes longer than an episode, and its weight is no measure of what moves it.
const PACE: f64 = 1.0;
/// Torque limit in units of m g L / 2, the torque that holds the straight rod level.
const ENOUGH: f64 = 1.1;
/// The regulator catches what costs less than this many times the straight rod at rest 1 rad from up.
const CATCH: f64 = 3.0;
/// Where the motor cannot quite lift the rod, it catches what costs less than this part of the cost at the tilt
/// that it can just hold.
const HELD: f64 = 0.8;
/// How long the regulator may try from a worse state before the pump starts, in units of sqrt(L/g).
const PATIENCE: f64 = 6.0;
/// Where the torque limit is below this part of m g L / 2, the pump starts at once.
const WEAK: f64 = 0.8;
/// Aimed energy of the pump above that of the rod at rest upright, relative to the latter.
const SURPLUS: f64 = 0.15;

/// Weights that make a regulator with a large basin: the motor is dear, so that it uses the rod's own
/// dynamics.
///
/// Without units: rates count in units of sqrt(g/L), torque in units of the limit. In less gravity than
/// `PACE` a dear motor would stand still, since nothing falls: there the law turns the rod with the
/// torque that gravity of that size would need.
pub fn gentle_weights(rod: &RodDesign) -> Weights {
    if rod.gravity < PACE {
        let enough = lever(rod) * PACE;
        return Weights { angle: 1.0, rate: rod.length / PACE, torque: 1.0 / (enough * enough) };
    }
    Weights {
        angle: 1.0,
        rate: 30.0 * rod.length / rod.gravity,
        torque: 3e4 / (rod.torque_limit * rod.torque_limit),
    }
}

/// Mass of the rod times the distance of its middle from the hinge \[kg m\].
pub(super) fn lever(rod: &RodDesign) -> f64 {
    0.5 * rod.node_mass() * rod.edges() as f64 * rod.length
}

/// Gravity that the law is scaled with \[m/s^2\].
pub(super) fn pace(rod: &RodDesign) -> f64 {
    rod.gravity.max(PACE)
}

/// Feedback from the coordinates of a reduced chain to base torque.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Regulator {
    chain: Chain,
    weights: Weights,
    gain: DVector<f64>,
    cost: DMatrix<f64>,
    up: Vec<f64>,
    /// Row that takes the swing's rate out of the coordinates' rates: angular momentum of the straight
    /// rod about its pivot, over its inertia. Bending has none of it.
    swing: Vec<f64>,
    up_energy: f64,
    limit: f64,
    patience: f64,
    /// The regulator catches what costs less.
    catch: f64,
    weak: bool,
    pumps: bool,
}

impl Regulator {
    /// Designs the law for a chain.
    ///
    /// # Errors
    /// A Riccati equation without solution (a rod without gravity and stiffness, say).
    pub fn new(chain: Chain, weights: Weights) -> Result<Self> {
        let k = chain.coordinates();
        let rod = chain.rod().clone();
        let mut up = chain.straight(PI);
        up.resize(2 * k, 0.0);
        let (a, b) = chain.linearize(&up, 0.0);
        let b = DMatrix::from_column_slice(2 * k, 1, b.as_slice());
        let (q, r) = weights.matrices(k);
        let s = sample_cost(&a, &b, &q, &r, rod.control_dt);
        let solution = dare(&s.a, &s.b, &s.q, &s.r, Some(&s.n))?;
        let mut tilted = chain.straight(1.0);
        tilted.resize(2 * k, 0.0);
        let tilted = DVector::from_vec(tilted);
        let scale = tilted.dot(&(&solution.cost * &tilted));
        let weight = 0.5 * rod.node_mass() * rod.edges() as f64 * rod.gravity * rod.length;
        // A motor that is nearly strong enough holds the rod up to a tilt, and would hold it there for ever.
        let held = if (WEAK * weight..weight).contains(&rod.torque_limit) {
            let tilt = libm::asin(rod.torque_limit / weight);
            HELD * tilt * tilt
        } else {
            CATCH
        };
        let enough = if rod.gravity < PACE { lever(&rod) * PACE } else { weight };
        Ok(Regulator {
            gain: solution.gain.transpose().column(0).into_owned(),
            cost: solution.cost / scale,
            up_energy: chain.energy(&up).total(),
            limit: rod.torque_limit.min(ENOUGH * enough),
            patience: PATIENCE * libm::sqrt(rod.length / pace(&rod)),
            swing: chain.coordinates_of(&swing_shares(rod.edges())),
            catch: CATCH.min(held),
            weak: rod.torque_limit < WEAK * weight,
            // Where gravity does not set the pace, a swing at the energy of the rod upright is no way up.
            pumps: rod.gravity >= PACE || rod.torque_limit < weight,
            up,
            chain,
            weights,
        })
    }

    /// What the design settled on, by name: weights, and the most torque \[N m\] that it asks for.
    pub fn parameters(&self) -> Vec<(&'static str, f64)> {
        let mut named = self.weights.by_name();
        named.push(("most_torque", self.limit));
        named
    }

    /// The model in whose coordinates the law is written.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// Gain K of T = -K z, z the coordinates and rates from up.
    pub fn gain(&self) -> &[f64] {
        self.gain.as_slice()
    }

    /// Coordinates and rates measured from the nearest way up, padded: whole turns of the base are taken off.
    fn measured_from_up(&self, state: &[f64]) -> [f64; 2 * MAX_COORDINATES] {
        let base = self.chain.base(&state[..self.chain.coordinates()]);
        let turns = libm::round((base - PI) / (2.0 * PI));
        let mut z = [0.0; 2 * MAX_COORDINATES];
        for (z, (x, up)) in z.iter_mut().zip(state.iter().zip(&self.up)) {
            // A whole turn of the rod is 2 pi in units of `up`, which is half a turn.
            *z = x - (1.0 + 2.0 * turns) * up;
        }
        z
    }

    /// Cost-to-go z'Pz, in units of that of the straight rod at rest 1 rad from up.
    fn cost(&self, z: &[f64]) -> f64 {
        let n = self.cost.nrows();
        let row = |j: usize| (0..n).map(|i| z[i] * self.cost[(i, j)]).sum::<f64>();
        (0..n).map(|j| row(j) * z[j]).sum()
    }

    /// The clock's value when an episode begins.
    pub fn start(&self) -> f64 {
        if self.weak { self.patience } else { 0.0 }
    }

    /// Torque \[N m\] at a state (coordinates, rates), called once a control period; `clock` is the
    /// law's memory: for how long \[s\] the rod has been out of reach.
    pub fn torque(&self, state: &[f64], clock: &mut f64) -> f64 {
        let z = self.measured_from_up(state);
        if self.cost(&z) < self.catch {
            *clock = self.start();
        } else if *clock < self.patience {
            *clock += self.chain.rod().control_dt;
        } else if self.pumps && self.up_energy > 0.0 {
            return self.pump(state);
        }
        let push: f64 = self.gain.iter().zip(&z).map(|(k, z)| k * z).sum();
        (-push).clamp(-self.limit, self.limit)
    }

    /// Pushes with the motion as long as energy is missing, against it where there is too much.
    fn pump(&self, state: &[f64]) -> f64 {
        let energy = self.chain.energy(state).total();
        let missing = 1.0 + SURPLUS - energy / self.up_energy;
        let rates = &state[self.chain.coordinates()..];
        let rate: f64 = self.swing.iter().zip(rates).map(|(s, r)| s * r).sum();
        // At rest any direction will do. (Up to where the rod moves by itself only: a push of one
        // direction below some rate would hold a heavy rod where the pushes balance its weight.)
        let along = if rate.abs() < 1e-3 { 1.0 } else { rate / (1.0 + rate.abs()) };
        (self.limit * missing * along).clamp(-self.limit, self.limit)
    }
}

/// Share of each edge's rate in the angular momentum of a straight chain about its pivot; they sum to 1.
fn swing_shares(edges: usize) -> Vec<f64> {
    let lever = |node: usize| node as f64 * if node == edges { 0.5 } else { 1.0 };
    let beyond: Vec<f64> = (1..=edges).map(|first| (first..=edges).map(lever).sum()).collect();
    let all: f64 = beyond.iter().sum();
    beyond.iter().map(|b| b / all).collect()
}
