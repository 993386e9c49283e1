//! The controllers of thesis chapter 4, to the letter, inside its backward Euler step.
//!
//! The continuous regulator's fastest closed-loop pole is near -15000 1/s, so its torque cannot be
//! sampled and held even at the thesis' step of 1e-4 s: it is solved for together with the new state.
//! The observer (4.17) is stepped by backward Euler too; then its torque is a linear law of the new
//! base angle and rate, which the implicit step takes as it takes the regulator's.

use super::hybrid::{SWING_AMPLITUDE, SWITCH_ANGLE};
use super::{RodDesign, Weights, upright};
use crate::error::{Error, Result};
use crate::linalg::care;
use nalgebra::{DMatrix, DVector};
use rodgym_core::pendulum::BarePendulum;
use rodgym_core::simulation::Simulation;

use std::f64::consts::{PI, TAU};

/// What the thesis' `kalman` call means by Q_n = 0.001; the text leaves it open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessNoise {
    /// On the torque: covariance B Q_n B'.
    Torque,
    /// On every state: covariance Q_n I.
    State,
}

/// Gains of thesis 4.2.2 and 4.3 for a rod, bending damping and drag left out.
#[derive(Clone, Debug)]
pub struct ThesisDesign {
    a: DMatrix<f64>,
    b: DVector<f64>,
    /// K of u = -K z (twice the edges).
    pub regulator: DVector<f64>,
    /// L of the observer (twice the edges, 2).
    pub observer: DMatrix<f64>,
    swing_frequency: f64,
}

impl ThesisDesign {
    /// Solves both Riccati equations.
    ///
    /// # Errors
    /// A rod that is not allowed, or an equation without solution.
    pub fn new(rod: &RodDesign, noise: ProcessNoise) -> Result<Self> {
        rod.check()?;
        let plain = RodDesign { bending_damping: 0.0, damping: 0.0, ..rod.clone() };
        let model = upright(&plain);
        let states = 2 * rod.edges();
        let (q, r) = Weights::default().matrices(rod.edges());
        let regulator = care(&model.a, &model.b, &q, &r, None)?.gain;
        let process = match noise {
            ProcessNoise::Torque => &model.b * model.b.transpose() * 1e-3,
            ProcessNoise::State => DMatrix::identity(states, states) * 1e-3,
        };
        // The filter's equation is the regulator's of the transposed system.
        let sensors = DMatrix::identity(2, 2);
        let filter = care(&model.a.transpose(), &model.c.transpose(), &process, &sensors, None)?;
        Ok(ThesisDesign {
            b: model.b.column(0).into_owned(),
            a: model.a,
            regulator: regulator.transpose().column(0).into_owned(),
            observer: filter.gain.transpose(),
            swing_frequency: libm::sqrt(rod.gravity / rod.length),
        })
    }

    /// B: what a unit of torque does.
    pub fn torque_column(&self) -> &DVector<f64> {
        &self.b
    }

    /// A - L C: the error dynamics of the observer (4.19).
    pub fn error_dynamics(&self) -> DMatrix<f64> {
        let edges = self.b.len() / 2;
        let mut a = self.a.clone();
        for (column, at) in [(0, 0), (1, edges)] {
            let l = self.observer.column(column).into_owned();
            let mut target = a.column_mut(at);
            target -= l;
        }
        a
    }
}

/// What the controller did in the last step.
#[derive(Clone, Debug, PartialEq)]
pub struct ThesisStep {
    /// Whether the linear law acted (else the swing-up).
    pub linear: bool,
    /// Base torque at the end of the step \[N m\].
    pub torque: f64,
    /// The observer's estimate of z after the step; empty while it is off or for state feedback.
    pub estimate: Vec<f64>,
}

/// A thesis controller on its way through one simulation.
#[derive(Clone, Debug)]
pub struct ThesisRun {
    design: ThesisDesign,
    observes: bool,
    latches: bool,
    estimate: Option<DVector<f64>>,
}

impl ThesisRun {
    /// State feedback, or output feedback through the observer. The text leaves open whether the linear
    /// law goes off again beyond 60 degrees; an observer that `latches` stays on once it was.
    pub fn new(design: ThesisDesign, observes: bool, latches: bool) -> Self {
        ThesisRun { design, observes, latches, estimate: None }
    }

    /// One physics step. On or off is decided from the state at its start, the swing-up's torque is
    /// that of its end.
    ///
    /// # Errors
    /// The implicit step failed even in its smallest parts.
    pub fn step(&mut self, sim: &mut BarePendulum) -> Result<ThesisStep> {
        let (angle, rate) = base(sim);
        let stays = self.latches && self.estimate.is_some();
        if angle.abs() >= SWITCH_ANGLE && !stays {
            self.estimate = None;
            let time = sim.time() + sim.physics_dt();
            let torque = SWING_AMPLITUDE * libm::cos(self.design.swing_frequency * time);
            sim.step(torque, 1)?;
            return Ok(ThesisStep { linear: false, torque, estimate: vec![] });
        }
        if self.observes { self.observed(sim, angle, rate) } else { self.direct(sim) }
    }

    fn direct(&self, sim: &mut BarePendulum) -> Result<ThesisStep> {
        let gain: Vec<f64> = self.design.regulator.iter().map(|k| -k).collect();
        sim.step_feedback(0.0, &gain, 1)?;
        let z = sim.angles().into_iter().map(from_up).chain(sim.rates());
        let torque = gain.iter().zip(z).map(|(g, z)| g * z).sum();
        Ok(ThesisStep { linear: true, torque, estimate: vec![] })
    }

    /// Backward Euler of observer and rod together: z+ = M (z + dt L y+), M = (1 - dt (A - BK - LC))^-1.
    fn observed(&mut self, sim: &mut BarePendulum, angle: f64, rate: f64) -> Result<ThesisStep> {
        let design = &self.design;
        let states = design.b.len();
        let edges = states / 2;
        let dt = sim.physics_dt();
        // The observer starts with the base's angle and rate for every edge.
        let start = DVector::from_fn(states, |i, _| if i < edges { angle } else { rate });
        let before = self.estimate.take().unwrap_or(start);
        let closed = design.error_dynamics() - &design.b * design.regulator.transpose();
        let step = (DMatrix::identity(states, states) - closed * dt).lu();
        let solve = |x: &DVector<f64>| {
            step.solve(x).ok_or_else(|| Error::NoSolution {
                equation: "observer's implicit step",
                reason: "its matrix is singular".into(),
            })
        };
        let drift = solve(&before)?;
        let by_angle = solve(&(design.observer.column(0) * dt))?;
        let by_rate = solve(&(design.observer.column(1) * dt))?;
        let mut gain = vec![0.0; states];
        gain[0] = -design.regulator.dot(&by_angle);
        gain[edges] = -design.regulator.dot(&by_rate);
        sim.step_feedback(-design.regulator.dot(&drift), &gain, 1)?;
        let (angle, rate) = base(sim);
        let estimate = drift + by_angle * angle + by_rate * rate;
        let torque = -design.regulator.dot(&estimate);
        let out = estimate.iter().copied().collect();
        self.estimate = Some(estimate);
        Ok(ThesisStep { linear: true, torque, estimate: out })
    }
}

/// The angle measured from up, in (-pi, pi].
fn from_up(angle: f64) -> f64 {
    let z = angle - PI;
    if z <= -PI { z + TAU } else { z }
}

/// Base angle from up and base rate.
fn base(sim: &BarePendulum) -> (f64, f64) {
    (from_up(sim.angles()[0]), sim.rates()[0])
}
