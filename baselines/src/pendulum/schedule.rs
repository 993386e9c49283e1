//! Regulators of many rods: a table over stiffness and mass, and the law between its entries.

use super::prior::Prior;
use super::rods::ORDER;
use super::{Chain, Regulator, gentle_weights};
use crate::error::Result;
use serde::{Deserialize, Serialize};

/// Distance of the table's entries \[logarithm of stiffness over mass, of mass\].
const STEP: [f64; 2] = [0.14, 0.3];
/// How far beyond the prior the table goes.
const BEYOND: f64 = 0.2;

/// Regulators on a grid.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Schedule {
    low: [f64; 2],
    step: [f64; 2],
    count: [usize; 2],
    laws: Vec<Regulator>,
}

impl Schedule {
    /// Designs the regulators of a prior's rods.
    ///
    /// # Errors
    /// A Riccati equation without solution.
    pub fn new(prior: &Prior) -> Result<Self> {
        let (mut low, mut step, mut count) = ([0.0; 2], [1.0; 2], [1; 2]);
        for i in 0..2 {
            if prior.unknown()[i] {
                let reach = prior.reach[i] + BEYOND;
                count[i] = libm::ceil(2.0 * reach / STEP[i]) as usize + 1;
                step[i] = 2.0 * reach / (count[i] - 1) as f64;
                low[i] = -reach;
            }
        }
        let mut laws = Vec::with_capacity(count[0] * count[1]);
        for i in 0..count[0] {
            for j in 0..count[1] {
                let rod = prior.rod([low[0] + step[0] * i as f64, low[1] + step[1] * j as f64]);
                laws.push(Regulator::new(Chain::new(&rod, ORDER), gentle_weights(&rod))?);
            }
        }
        Ok(Schedule { low, step, count, laws })
    }

    /// Any of the regulators.
    pub fn first(&self) -> &Regulator {
        &self.laws[0]
    }

    /// Torque \[N m\] for a rod at a place of the prior: the regulators around it, weighed by how near they are.
    /// The clock goes on with the nearest.
    pub fn torque(&self, place: [f64; 2], state: &[f64], clock: &mut f64) -> f64 {
        let (mut cell, mut part) = ([0; 2], [0.0; 2]);
        for i in 0..2 {
            let last = (self.count[i] - 1) as f64;
            let at = ((place[i] - self.low[i]) / self.step[i]).clamp(0.0, last);
            cell[i] = (at as usize).min(self.count[i].saturating_sub(2));
            part[i] = at - cell[i] as f64;
        }
        let (mut torque, mut most, before) = (0.0, 0.0, *clock);
        for (i, one) in [(0, 1.0 - part[0]), (1, part[0])] {
            for (j, other) in [(0, 1.0 - part[1]), (1, part[1])] {
                let weight: f64 = one * other;
                if weight > 0.0 {
                    let law = &self.laws[(cell[0] + i) * self.count[1] + cell[1] + j];
                    let mut its = before;
                    torque += weight * law.torque(state, &mut its);
                    if weight > most {
                        (most, *clock) = (weight, its);
                    }
                }
            }
        }
        torque
    }
}
