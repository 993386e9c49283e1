//! Output feedback that learns its rod: a bank of filters over the rods that are possible.
//!
//! Each of eight filters believes in another rod and learns stiffness and mass from there. All of them know the
//! torque that arrives; the one to whom the measurements were the least surprising drives, with the
//! regulator of the rod that it has found.

use super::bank::{Bank, Estimate, LANES, Step, bank};
use super::filter::{Learning, Pace};
use super::lqg::{measured, needs_base};
use super::prior::Prior;
use super::schedule::Schedule;
use super::{Arrival, Noise};
use crate::controller::{Controller, Quantity};
use crate::error::Result;
use crate::registry::Target;
use crate::saved;
use serde::{Deserialize, Serialize};

/// What a step leaves of the evidence before it.
const MEMORY: f64 = 0.99;
/// Most that one measurement can count against a filter.
const MOST: f64 = 50.0;
/// Deviation of a filter's belief at the start, over the distance of the filters.
const OVERLAP: f64 = 0.5;
/// Deviation by which stiffness and mass are believed to change in a step.
const DRIFT: f64 = 3e-4;
/// Half of an interval that holds nine of ten truths, in the filter's deviations. Of normal numbers that would be
/// 1.645; what the filter believes of the sensors and of change makes it less sure than it could be. (Measured
/// on 360 episodes of 120 rods, E +-30 %.)
const NINE_OF_TEN: f64 = 1.07;

/// Swing-up and balance, from base angle and rate, of a rod that is only roughly known.
///
/// Observation: cos, sin, rate / (10 rad/s) of the base edge; a NaN among them is a lost sample.
/// State: steps taken, the regulator's clock \[s\], actions on their way, the filters' scores, their beliefs.
pub struct LqgAdaptive {
    numbers: Numbers,
    bank: Box<dyn Bank>,
}

/// What a design comes to.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Numbers {
    prior: Prior,
    /// Where each filter starts.
    places: [[f64; 2]; LANES],
    noise: Noise,
    arrival: Arrival,
    pace: Pace,
    learning: Learning,
    schedule: Schedule,
}

impl TryFrom<Numbers> for LqgAdaptive {
    type Error = crate::Error;

    fn try_from(numbers: Numbers) -> Result<Self> {
        let rods = numbers.places.map(|place| numbers.prior.rod(place));
        let bank = bank(&rods, numbers.noise, numbers.pace, numbers.learning)?;
        Ok(LqgAdaptive { numbers, bank })
    }
}

/// Parts of a row of the state.
struct Row<'a> {
    steps: &'a mut f64,
    clock: &'a mut f64,
    actions: &'a mut [f64],
    scores: &'a mut [f64],
    beliefs: &'a mut [f64],
}

impl LqgAdaptive {
    /// Designs it for rods that may be anywhere in a prior.
    ///
    /// # Errors
    /// A rod that is not allowed; a Riccati equation without solution.
    pub fn new(prior: Prior, noise: Noise, arrival: Arrival) -> Result<Self> {
        let unknown = prior.unknown();
        // Two rows of filters where the mass is unknown too: of the two numbers it shows the sooner.
        let masses = if unknown[1] { 2 } else { 1 };
        let counts = [LANES / masses, masses];
        let gap: [f64; 2] = std::array::from_fn(|i| 2.0 * prior.reach[i] / counts[i] as f64);
        let places = std::array::from_fn(|lane| {
            let cell = [lane / masses, lane % masses];
            std::array::from_fn(|i| {
                if unknown[i] { (cell[i] as f64 + 0.5) * gap[i] - prior.reach[i] } else { 0.0 }
            })
        });
        let square = |x: f64| x * x;
        let known = |i: usize, x: f64| if unknown[i] { square(x) } else { 0.0 };
        let learning = Learning {
            start: std::array::from_fn(|i| known(i, OVERLAP * gap[i])),
            process: [known(0, DRIFT), known(1, DRIFT)],
        };
        let rods = places.map(|place| prior.rod(place));
        let pace = Pace::of(&rods, &arrival);
        let schedule = Schedule::new(&prior)?;
        Numbers { prior, places, noise, arrival, pace, learning, schedule }.try_into()
    }

    /// Reads what `Controller::numbers` wrote.
    ///
    /// # Errors
    /// Bytes of something else.
    pub fn from_numbers(bytes: &[u8]) -> Result<Self> {
        saved::read::<Numbers>(bytes)?.try_into()
    }

    /// Designs the controller for an environment: the rods that it draws, or those about its nominal one.
    ///
    /// # Errors
    /// As [`LqgAdaptive::new`]; [`Error::Unsuitable`](crate::Error) where an observation is not that of the base edge.
    pub fn for_target(target: &Target) -> Result<Self> {
        needs_base("LqgAdaptive", target.observation.size())?;
        let prior = Prior::from_config(&target.config)?;
        let arrival = Arrival::from_config(&target.config, prior.middle.control_dt)?;
        LqgAdaptive::new(prior, Noise::LEARNER.with_sensors(&target.config), arrival)
    }

    fn row<'a>(&self, state: &'a mut [f64]) -> Row<'a> {
        let (law, rest) = state.split_at_mut(2);
        let [steps, clock] = law else { unreachable!("split at two") };
        let (actions, rest) = rest.split_at_mut(self.numbers.arrival.memory());
        let (scores, beliefs) = rest.split_at_mut(LANES);
        Row { steps, clock, actions, scores, beliefs }
    }

    /// Where in the prior a filter believes its rod.
    fn place(&self, lane: usize, estimate: &Estimate) -> [f64; 2] {
        let [stiffness, mobility] = estimate.feel;
        [self.numbers.places[lane][0] + stiffness, self.numbers.places[lane][1] - mobility]
    }
}

/// The filter with the best score.
fn likeliest(scores: &[f64]) -> usize {
    (1..scores.len()).fold(0, |best, lane| if scores[lane] > scores[best] { lane } else { best })
}

impl Controller for LqgAdaptive {
    fn observation_size(&self) -> usize {
        3
    }
    fn state_size(&self) -> usize {
        2 + self.numbers.arrival.memory() + LANES + self.bank.memory()
    }
    fn takes_lost_samples(&self) -> bool {
        true
    }
    fn parameters(&self) -> Vec<(&'static str, f64)> {
        [self.numbers.schedule.first().parameters(), self.numbers.noise.by_name()].concat()
    }
    fn numbers(&self) -> Option<Vec<u8>> {
        saved::written(&self.numbers)
    }
    fn start(&self, observation: &[f32], state: &mut [f64]) {
        state.fill(0.0);
        let row = self.row(state);
        *row.clock = self.numbers.schedule.first().start();
        let (angle, rate) = measured(observation).unwrap_or((0.0, 0.0));
        self.bank.start(angle, rate, row.beliefs);
    }
    fn act(&self, observation: &[f32], state: &mut [f64], action: &mut [f32]) {
        let row = self.row(state);
        let limit = self.numbers.prior.middle.torque_limit;
        let step = Step {
            torques: self.numbers.arrival.acting(row.actions).map(|action| action * limit),
            measured: measured(observation),
            moved: *row.steps > 0.0,
        };
        *row.steps += 1.0;
        let news = self.bank.step(&step, row.beliefs);
        for (lane, score) in row.scores.iter_mut().enumerate() {
            if step.measured.is_some() || news.lost[lane] {
                *score = MEMORY * *score - news.surprise(lane, MOST);
            }
        }
        let lane = likeliest(row.scores);
        let estimate = self.bank.estimate(lane, row.beliefs);
        let (x, n) =
            self.bank.forecast(lane, &self.numbers.arrival, row.actions, limit, row.beliefs);
        let torque = self.numbers.schedule.torque(self.place(lane, &estimate), &x[..n], row.clock);
        action[0] = (torque / limit).clamp(-1.0, 1.0) as f32;
        self.numbers.arrival.push(f64::from(action[0]), row.actions);
    }

    fn estimate(&self, state: &[f64], tell: &mut dyn FnMut(Quantity)) {
        let from = 2 + self.numbers.arrival.memory();
        let (scores, beliefs) = state[from..].split_at(LANES);
        let lane = likeliest(scores);
        let estimate = self.bank.estimate(lane, beliefs);
        let [stiffness, mass] = self.place(lane, &estimate);
        let rod = self.numbers.prior.rod([stiffness, mass]);
        let [a, b, c] = estimate.spread;
        // Logarithms of all that is told are sums of those of stiffness over mass, and of mobility.
        let mut quantity = |name, unit, value: f64, of: [f64; 2]| {
            let variance = of[0] * of[0] * a + 2.0 * of[0] * of[1] * b + of[1] * of[1] * c;
            let factor = libm::exp(NINE_OF_TEN * libm::sqrt(variance.max(0.0)));
            tell(Quantity { name, unit, value, low: value / factor, high: value * factor });
        };
        let area = rod.width * rod.width;
        quantity("bending_stiffness", "N m^2", rod.bending_stiffness(), [1.0, -1.0]);
        quantity("mass", "kg", rod.density * area * rod.length, [0.0, -1.0]);
        if !self.numbers.prior.any_density {
            quantity("youngs_modulus", "Pa", rod.youngs_modulus, [1.0, 1.0]);
            quantity("width", "m", rod.width, [0.0, -0.5]);
        }
    }
}
