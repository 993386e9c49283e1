//! Gaits of the fin: periodic pitch commands, the open-loop controllers to beat.
//!
//! A gait knows its waveform, amplitude and frequency and counts steps. The best pair is found by playing the
//! environment itself, with all its limits: first a grid, then two finer grids about the best point, each gait
//! meeting the same fins (`SEEDS`). The search is part of `for_target`, so a gait is always the best for
//! the keywords at hand.

use super::play::{Episodes, STEPS};
use crate::controller::Controller;
use crate::error::Result;
use crate::saved;
use crate::target::Target;
use rodgym_core::fin::cycle::Waveform;
use rodgym_core::fin::sensors::THRUST_UNIT;
use rodgym_core::fin::tasks::DEMAND;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::f64::consts::TAU;

/// Fins that every gait of the search meets.
const SEEDS: usize = 8;
/// Demanded thrust at which a gait has its nominal amplitude \[N\]; thrust grows with its square.
const USUAL_DEMAND: f64 = 0.1;
/// Frequencies \[Hz\] of the first grid. Faster ones lie beyond what the model of the water holds for, and earn
/// nothing behind the low-pass of the command.
const FREQUENCIES: [f64; 10] = [0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, FASTEST];
/// Fastest gait \[Hz\].
const FASTEST: f64 = 5.0;
/// Amplitudes of the first grid, in units of the action.
const AMPLITUDES: [f64; 8] = [0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0];

/// A periodic command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gait {
    /// Shape.
    pub waveform: Waveform,
    /// Amplitude of the action.
    pub amplitude: f64,
    /// Frequency \[Hz\].
    pub frequency: f64,
    /// Mean return of the search's episodes.
    pub found_return: f64,
    control_dt: f64,
    observation_size: usize,
    /// Where in the observation the demanded thrust is, if anywhere.
    demand: Option<usize>,
}

impl Gait {
    /// The best gait of this waveform for an environment.
    ///
    /// # Errors
    /// An environment that cannot be made again from its keywords.
    pub fn for_target(waveform: Waveform, target: &Target) -> Result<Gait> {
        let control_dt = target.config.get("control_dt").and_then(Value::as_f64).unwrap_or(0.04);
        let observation_size = target.observation.size();
        let demand = demand(target);
        let gait = |amplitude: f64, frequency: f64| Gait {
            waveform,
            amplitude,
            frequency,
            found_return: f64::NEG_INFINITY,
            control_dt,
            observation_size,
            demand,
        };
        let mut best = gait(0.0, 1.0);
        let mut grid = Vec::new();
        for frequency in FREQUENCIES {
            grid.extend(AMPLITUDES.map(|amplitude| gait(amplitude, frequency)));
        }
        let (mut df, mut da) = (0.25, 0.2);
        for _ in 0..3 {
            for (found, candidate) in returns(target, &grid)?.into_iter().zip(&grid) {
                if found > best.found_return {
                    best = Gait { found_return: found, ..candidate.clone() };
                }
            }
            grid.clear();
            for i in -2..=2 {
                for j in -2..=2 {
                    let amplitude = best.amplitude * (1.0 + da * f64::from(j));
                    let frequency = best.frequency + df * f64::from(i);
                    grid.push(gait(amplitude.min(1.0), frequency.clamp(0.1, FASTEST)));
                }
            }
            (df, da) = (0.4 * df, 0.4 * da);
        }
        Ok(best)
    }

    /// The best gait of any waveform.
    ///
    /// # Errors
    /// As [`Gait::for_target`].
    pub fn best_for_target(target: &Target) -> Result<Gait> {
        let mut best: Option<Gait> = None;
        for (_, waveform) in Waveform::NAMES {
            let gait = Gait::for_target(waveform, target)?;
            if best.as_ref().is_none_or(|b| gait.found_return > b.found_return) {
                best = Some(gait);
            }
        }
        Ok(best.expect("there are waveforms"))
    }
}

/// Where an environment's observation has the thrust that is demanded, if anywhere.
pub(super) fn demand(target: &Target) -> Option<usize> {
    target.observation.names.iter().position(|name| name == DEMAND)
}

/// Factor of the amplitude for the thrust that is demanded.
pub(super) fn demanded(demand: Option<usize>, observation: &[f32]) -> f64 {
    demand.map_or(1.0, |at| {
        libm::sqrt((f64::from(observation[at]) * THRUST_UNIT / USUAL_DEMAND).max(0.0))
    })
}

/// Mean returns of gaits, each over the same `SEEDS` episodes.
fn returns(target: &Target, gaits: &[Gait]) -> Result<Vec<f64>> {
    let seeds = (0..gaits.len() * SEEDS).map(|i| (i % SEEDS) as u64);
    let mut episodes = Episodes::new(target, seeds)?;
    let mut clocks = vec![[0.0]; episodes.count()];
    let mut sums = vec![0.0; gaits.len()];
    for _ in 0..STEPS {
        let rewards = episodes.step(|i, observation, action| {
            gaits[i / SEEDS].act(observation, &mut clocks[i], action);
        })?;
        for (i, reward) in rewards.iter().enumerate() {
            sums[i / SEEDS] += reward / SEEDS as f64;
        }
    }
    Ok(sums)
}

impl Controller for Gait {
    fn observation_size(&self) -> usize {
        self.observation_size
    }

    fn state_size(&self) -> usize {
        1
    }

    fn numbers(&self) -> Option<Vec<u8>> {
        saved::written(self)
    }

    fn start(&self, _observation: &[f32], state: &mut [f64]) {
        state[0] = 0.0;
    }

    fn act(&self, observation: &[f32], state: &mut [f64], action: &mut [f32]) {
        let phase = TAU * self.frequency * self.control_dt * state[0];
        let command = demanded(self.demand, observation) * self.amplitude * self.waveform.at(phase);
        action[0] = command.clamp(-1.0, 1.0) as f32;
        state[0] += 1.0;
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("amplitude", self.amplitude),
            ("frequency", self.frequency),
            ("found_return", self.found_return),
        ]
    }
}
