//! An extended Kalman filter on the reduced chain, from base angle and rate alone.

use super::Chain;
use nalgebra::{DMatrix, DVector};
use serde_json::{Map, Value};
use std::f64::consts::PI;

/// What the filter believes of noise and start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Standard deviation of the measured base angle \[rad\].
    pub angle: f64,
    /// Standard deviation of the measured base rate \[rad/s\].
    pub rate: f64,
    /// Variance added to every coordinate at each step, for what the model lacks.
    pub process: f64,
    /// The same for every rate.
    pub process_rate: f64,
    /// Variance of every coordinate and rate at the start.
    pub start: f64,
}

impl Default for Noise {
    /// Sensors are believed ten times noisier than the usual 1 mrad and 10 mrad/s: who trusts them more
    /// extrapolates from base to tip by the model alone, and a rod a little thinner or thicker than
    /// believed is lost.
    fn default() -> Self {
        Noise { angle: 1e-2, rate: 1e-1, process: 1e-5, process_rate: 1e-4, start: 1e-2 }
    }
}

impl Noise {
    /// What an environment's keyword `sensor_noise` says; the default stands for less.
    pub fn of_sensors(config: &Map<String, Value>) -> Self {
        let least = Noise::default();
        let read = |name: &str, least: f64| {
            let value = config.get("sensor_noise").and_then(|noise| noise.get(name)?.as_f64());
            value.unwrap_or(0.0).max(least)
        };
        Noise { angle: read("angle", least.angle), rate: read("rate", least.rate), ..least }
    }
}

/// The filter; its memory is a row of numbers that the caller keeps: 2k means, then the covariance
/// (2k, 2k) by columns.
#[derive(Clone, Debug)]
pub struct Estimator {
    chain: Chain,
    noise: Noise,
    substeps: usize,
}

/// Longest step of the filter's Runge-Kutta method, in units of 1/(highest frequency).
const RUNGE_KUTTA_STEP: f64 = 1.5;

/// Rate that no rod of ours reaches \[rad/s\].
const FASTEST: f64 = 1e3;

impl Estimator {
    /// A filter for a chain, called every control period.
    pub fn new(chain: Chain, noise: Noise) -> Self {
        let k = chain.coordinates();
        let mut up = chain.straight(PI);
        up.resize(2 * k, 0.0);
        // Bending makes the fast modes; they are about the same in every pose.
        let fastest = crate::linalg::spectral_radius(&chain.linearize(&up, 0.0).0);
        let dt = chain.rod().control_dt;
        let substeps = libm::ceil(dt * fastest / RUNGE_KUTTA_STEP).max(dt / 2e-3).max(1.0) as usize;
        Estimator { chain, noise, substeps }
    }

    /// The model.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// Length of the memory.
    pub fn memory(&self) -> usize {
        let n = 2 * self.chain.coordinates();
        n + n * n
    }

    /// Starts with a straight rod at the measured base angle and rate.
    pub fn start(&self, angle: f64, rate: f64, memory: &mut [f64]) {
        let k = self.chain.coordinates();
        memory.fill(0.0);
        memory[..k].copy_from_slice(&self.chain.straight(angle));
        memory[k..2 * k].copy_from_slice(&self.chain.straight(rate));
        for i in 0..2 * k {
            memory[2 * k + i * (2 * k + 1)] = self.noise.start;
        }
    }

    /// Whether the estimate is one of a rod: finite, and no coordinate faster than any real one.
    pub fn sound(&self, memory: &[f64]) -> bool {
        let n = 2 * self.chain.coordinates();
        memory[n / 2..n].iter().all(|rate| rate.abs() < FASTEST)
            && memory.iter().all(|x| x.is_finite())
    }

    /// One control period under a held torque \[N m\].
    pub fn predict(&self, torque: f64, memory: &mut [f64]) {
        let n = 2 * self.chain.coordinates();
        let (mean, covariance) = memory.split_at_mut(n);
        let dt = self.chain.rod().control_dt;
        let mut p = DMatrix::from_column_slice(n, n, covariance);
        let step = dt / self.substeps as f64;
        let half = self.substeps / 2;
        for _ in 0..half {
            self.chain.step(mean, torque, step);
        }
        // One linearization, in the middle of the period, serves all of it.
        let (a, _) = self.chain.linearize(mean, torque);
        for _ in half..self.substeps {
            self.chain.step(mean, torque, step);
        }
        let phi = transition(&a, dt);
        p = &phi * p * phi.transpose();
        for i in 0..n {
            p[(i, i)] += if i < n / 2 { self.noise.process } else { self.noise.process_rate };
        }
        covariance.copy_from_slice(p.as_slice());
    }

    /// Takes in a measured base angle (modulo whole turns) and rate.
    pub fn update(&self, angle: f64, rate: f64, memory: &mut [f64]) {
        let k = self.chain.coordinates();
        let n = 2 * k;
        let (mean, covariance) = memory.split_at_mut(n);
        let mut x = DVector::from_column_slice(mean);
        let mut p = DMatrix::from_column_slice(n, n, covariance);
        let base = self.chain.base_row();
        let noise = [self.noise.angle, self.noise.rate];
        // Independent sensors may be taken in one after the other, which needs no matrix inverse.
        for (offset, sigma) in [0, k].into_iter().zip(noise) {
            let mut row = DVector::zeros(n);
            row.rows_mut(offset, k).copy_from_slice(&base);
            let expected = row.dot(&x);
            let innovation = if offset == 0 { wrap(angle - expected) } else { rate - expected };
            let pr = &p * &row;
            let variance = row.dot(&pr) + sigma * sigma;
            x += &pr * (innovation / variance);
            p -= &pr * pr.transpose() / variance;
        }
        mean.copy_from_slice(x.as_slice());
        covariance.copy_from_slice(crate::linalg::symmetric(&p).as_slice());
    }
}

/// The angle brought into [-pi, pi].
fn wrap(angle: f64) -> f64 {
    angle - 2.0 * PI * libm::round(angle / (2.0 * PI))
}

/// exp(A t) by a Taylor series of a fraction of the time, squared back.
fn transition(a: &DMatrix<f64>, time: f64) -> DMatrix<f64> {
    let n = a.nrows();
    let mut halvings = 0;
    let mut fraction = time;
    // The 1-norm of this mixed matrix overstates its eigenvalues by far; they are what must be small.
    let size = libm::sqrt(a.view((n / 2, 0), (n / 2, n / 2)).norm())
        + a.view((n / 2, n / 2), (n / 2, n / 2)).norm();
    while size * fraction > 0.5 {
        fraction *= 0.5;
        halvings += 1;
    }
    let a = a * fraction;
    let mut phi = DMatrix::identity(n, n);
    for order in (1..=6).rev() {
        phi = DMatrix::identity(n, n) + &a * phi / order as f64;
    }
    for _ in 0..halvings {
        phi = &phi * &phi;
    }
    phi
}
