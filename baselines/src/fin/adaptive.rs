//! A gait that is chosen by what the fin feels like.
//!
//! At each step every stiffness that is possible is weighed by how well it explains the torques so far ([`Feel`]). The gait is the
//! one that returns most, on the average over these weights: at first the best gait for all fins, soon the best for this one.
//! Phase and pitch go on where the gait changes.

use super::feel::{Feel, MEMORY, SENSORS, remember};
use super::gait::{demand, demanded};
use super::play::{Episodes, STEPS};
use crate::controller::{Controller, Quantity};
use crate::error::{Error, Result};
use crate::saved;
use crate::target::Target;
use rodgym_core::draw::Draw;
use rodgym_core::fin::Parameters;
use rodgym_core::seed::Stream;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::f64::consts::TAU;

/// The keyword that is felt.
const STIFFNESS: &str = "youngs_modulus";
/// Most stiffnesses that are told apart.
const MOST: usize = 25;
/// Largest distance of two, in the logarithm, as long as there are not more than `MOST`.
const STEP: f64 = 0.2;
/// Factors of the nominal stiffness that are believed possible where an environment draws none.
const ABOUT: (f64, f64) = (0.3, 3.0);
/// What a step leaves of the evidence before it.
const FORGET: f64 = 0.98;
/// Another gait is taken where it returns more by this part of the best return of all.
const MARGIN: f64 = 0.015;
/// Frequencies \[Hz\] of the gaits: faster ones do not pass the command's low-pass.
const FREQUENCIES: [f64; 15] =
    [0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5, 2.75, 3.0, 3.25, 3.5, 3.75, 4.0];
/// Amplitudes of the gaits, in units of the action.
const AMPLITUDES: [f64; 10] = [0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0];
/// Fins of each stiffness that are played to learn its torque, with gaits that change at random.
const PUPILS: usize = 24;
/// Part of the steps in which a pupil's gait changes.
const CHANGE: f64 = 0.03;
/// Fins by which the estimate is judged.
const JUDGES: usize = 600;
/// Steps after which a judge's estimates count, and distance of those that do.
const SETTLED: usize = 40;
const APART: usize = 20;
/// Fewest estimates that an interval is made of.
const ENOUGH: usize = 60;
/// Seeds of a design's episodes begin here, far from those that people use.
const SEED: u64 = 1 << 32;
/// Half of an interval that holds nine of ten normal numbers, in deviations.
const NINE_OF_TEN: f64 = 1.645;

/// A sinusoidal pitch command whose frequency and amplitude follow the stiffness that is felt.
///
/// State: steps taken, phase \[rad\], the gait's number, evidence of each stiffness, the last steps' measurements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GaitAdaptive {
    control_dt: f64,
    observation_size: usize,
    /// Where in the observation pitch, its rate, thrust and torque are.
    sensors: [usize; SENSORS],
    demand: Option<usize>,
    /// Logarithms of the stiffnesses, evenly spaced.
    grid: Vec<f64>,
    feel: Feel,
    /// Return of each gait, frequency by amplitude, one row a stiffness.
    returns: Vec<Vec<f64>>,
    /// By how much more than the present one another gait must return.
    margin: f64,
    /// Where the truth lies for an estimate at each stiffness: 5 %, 50 % and 95 % of its distances.
    distances: Vec<[f64; 3]>,
}

/// Where the evidence begins in a state.
const FIRST: usize = 3;

/// What a state says of the stiffness: mean and deviation of its logarithm.
struct Belief {
    mean: f64,
    deviation: f64,
}

impl GaitAdaptive {
    /// Learns the fins of an environment by playing it.
    ///
    /// # Errors
    /// An environment that does not show pitch, thrust and torque, or cannot be made again from its keywords.
    pub fn for_target(target: &Target) -> Result<Self> {
        let (low, high) = possible(&target.config)?;
        let count = libm::ceil(libm::log(high / low) / STEP) as usize + 1;
        let count = count.clamp(3, MOST);
        let gap = libm::log(high / low) / (count - 1) as f64;
        let mut gait = GaitAdaptive {
            control_dt: target.config.get("control_dt").and_then(Value::as_f64).unwrap_or(0.04),
            observation_size: target.observation.size(),
            sensors: sensors(&target.observation.names)?,
            demand: demand(target),
            grid: (0..count).map(|i| libm::log(low) + gap * i as f64).collect(),
            feel: Feel::default(),
            returns: Vec::new(),
            margin: 0.0,
            distances: vec![[0.0; 3]; count],
        };
        for i in 0..count {
            // Fins between this stiffness and the next, so that a model knows how far it is off there.
            let ends = [-0.5, 0.5].map(|side| libm::exp(gait.grid[i] + side * gap));
            let memories = gait.pupils(&with_stiffness(target, ends), i as u64)?;
            gait.feel.learn(&memories)?;
            let fins = with_stiffness(target, [libm::exp(gait.grid[i]); 2]);
            gait.returns.push(gait.play(&fins, i as u64)?);
        }
        gait.margin = MARGIN * gait.returns.iter().flatten().fold(0.0, |most: f64, x| most.max(*x));
        gait.distances = gait.judged(target)?;
        Ok(gait)
    }

    /// Number of gaits, and what a gait's frequency \[Hz\] and amplitude are.
    fn gait(number: usize) -> (f64, f64) {
        (FREQUENCIES[number / AMPLITUDES.len()], AMPLITUDES[number % AMPLITUDES.len()])
    }

    /// Return of every gait with fins of one stiffness.
    fn play(&self, fins: &Target, seed: u64) -> Result<Vec<f64>> {
        let gaits = FREQUENCIES.len() * AMPLITUDES.len();
        let mut episodes = Episodes::new(fins, (0..gaits).map(|_| SEED + seed))?;
        let mut returns = vec![0.0; gaits];
        for step in 0..STEPS {
            let time = step as f64 * self.control_dt;
            let rewards = episodes.step(|i, observation, action| {
                let (frequency, amplitude) = GaitAdaptive::gait(i);
                let scale = demanded(self.demand, observation);
                let command = scale * amplitude * libm::sin(TAU * frequency * time);
                action[0] = command.clamp(-1.0, 1.0) as f32;
            })?;
            returns.iter_mut().zip(rewards).for_each(|(sum, reward)| *sum += reward);
        }
        Ok(returns)
    }

    /// What fins of one stiffness measure while their gaits change at random.
    fn pupils(&self, fins: &Target, seed: u64) -> Result<Vec<[f64; MEMORY]>> {
        let mut stream = Stream::new(SEED + seed);
        let mut draw =
            || (stream.uniform(0.6, 4.0), stream.uniform(0.2, 1.0), stream.unit() < CHANGE);
        let mut gaits: Vec<(f64, f64)> = (0..PUPILS).map(|_| (draw().0, draw().1)).collect();
        let mut phases = [0.0; PUPILS];
        let mut memories = [[0.0; MEMORY]; PUPILS];
        let mut all = Vec::with_capacity(PUPILS * STEPS);
        let seeds = (0..PUPILS as u64).map(|i| SEED + PUPILS as u64 * seed + i);
        let mut episodes = Episodes::new(fins, seeds)?;
        for step in 0..STEPS {
            episodes.step(|i, observation, action| {
                remember(self.sensors.map(|at| f64::from(observation[at])), &mut memories[i]);
                if step * SENSORS >= MEMORY {
                    all.push(memories[i]);
                }
                let (frequency, amplitude, changes) = draw();
                if changes {
                    gaits[i] = (frequency, amplitude);
                }
                let (frequency, amplitude) = gaits[i];
                action[0] = (amplitude * libm::sin(phases[i])) as f32;
                phases[i] += TAU * frequency * self.control_dt;
            })?;
        }
        Ok(all)
    }

    /// How far the truth is from the estimates, by the estimate: fins that are drawn as the environment draws them.
    fn judged(&self, target: &Target) -> Result<Vec<[f64; 3]>> {
        let ends = [self.grid[0], self.grid[self.grid.len() - 1]].map(libm::exp);
        let target = with_stiffness(target, ends);
        let seeds = (0..JUDGES as u64).map(|i| SEED + 1_000_000 + i);
        let mut episodes = Episodes::new(&target, seeds)?;
        let truth: Vec<f64> = (0..JUDGES)
            .map(|i| libm::log(episodes.parameter(i, STIFFNESS).unwrap_or(f64::NAN)))
            .collect();
        let mut states = vec![vec![0.0; self.state_size()]; JUDGES];
        let mut found = Vec::new();
        for step in 0..STEPS {
            episodes.step(|i, observation, action| {
                if step == 0 {
                    self.start(observation, &mut states[i]);
                }
                self.act(observation, &mut states[i], action);
                if step >= SETTLED && (step - SETTLED).is_multiple_of(APART) {
                    let mean = self.belief(&states[i]).mean;
                    found.push((mean, truth[i] - mean));
                }
            })?;
        }
        Ok(self.grid.iter().map(|at| distances(*at, &mut found)).collect())
    }

    /// Weights of the stiffnesses, in the first places; their sum is 1.
    fn weights(&self, evidence: &[f64]) -> [f64; MOST] {
        let most = evidence.iter().fold(f64::NEG_INFINITY, |most, one| most.max(*one));
        let (mut weights, mut sum) = ([0.0; MOST], 0.0);
        for (weight, one) in weights.iter_mut().zip(evidence) {
            *weight = libm::exp(one - most);
            sum += *weight;
        }
        weights.map(|weight| weight / sum)
    }

    fn belief(&self, state: &[f64]) -> Belief {
        let weights = self.weights(&state[FIRST..FIRST + self.grid.len()]);
        let (mut mean, mut square) = (0.0, 0.0);
        for (weight, at) in weights.iter().zip(&self.grid) {
            mean += weight * at;
            square += weight * at * at;
        }
        Belief { mean, deviation: libm::sqrt((square - mean * mean).max(0.0)) }
    }

    /// What a gait returns on the average over the stiffnesses.
    fn expected(&self, number: usize, weights: &[f64]) -> f64 {
        weights.iter().zip(&self.returns).map(|(weight, row)| weight * row[number]).sum()
    }

    /// The gait that returns most on the average over the stiffnesses.
    fn best(&self, weights: &[f64]) -> usize {
        let (mut best, mut most) = (0, f64::NEG_INFINITY);
        for number in 0..FREQUENCIES.len() * AMPLITUDES.len() {
            let expected = self.expected(number, weights);
            if expected > most {
                (best, most) = (number, expected);
            }
        }
        best
    }
}

/// The stiffnesses that an environment draws; where it draws none, those about its one.
fn possible(config: &Map<String, Value>) -> Result<(f64, f64)> {
    let table = Parameters::table();
    let at = table.iter().position(|row| row.name == STIFFNESS).expect("a fin has a stiffness");
    if let Some(randomize) = config.get("randomize") {
        for (row, draw) in Draw::ranges(randomize, &table)? {
            if row == at {
                return Ok(draw.bounds());
            }
        }
    }
    let nominal = config.get(STIFFNESS).and_then(Value::as_f64).unwrap_or(table[at].default);
    let allowed = |x: f64| x.clamp(table[at].low, table[at].high);
    Ok((allowed(ABOUT.0 * nominal), allowed(ABOUT.1 * nominal)))
}

/// The environment with fins whose stiffness is drawn from a range, or is the one that both ends are.
fn with_stiffness(target: &Target, [low, high]: [f64; 2]) -> Target {
    let table = Parameters::table();
    let row = table.iter().find(|row| row.name == STIFFNESS).expect("a fin has a stiffness");
    let [low, high] = [low, high].map(|end| end.clamp(row.low, row.high));
    let mut target = target.clone();
    let none = || Value::Object(Map::new());
    let draws = target.config.entry("randomize").or_insert_with(none);
    if !draws.is_object() {
        *draws = none();
    }
    let draws = draws.as_object_mut().expect("made one above");
    if low < high {
        draws.insert(STIFFNESS.into(), json!(["log_uniform", low, high]));
    } else {
        draws.remove(STIFFNESS);
        target.config.insert(STIFFNESS.into(), low.into());
    }
    target
}

/// Where an observation has pitch, its rate, thrust and torque.
fn sensors(names: &[String]) -> Result<[usize; SENSORS]> {
    let mut found = [0; SENSORS];
    for (at, begins) in
        found.iter_mut().zip(["pitch /", "pitch rate", "mean thrust", "mean torque"])
    {
        *at = names.iter().position(|name| name.starts_with(begins)).ok_or_else(|| {
            let reason = format!(
                "it feels pitch, thrust and torque (observation='full'), but nothing in an observation begins with \
                 '{begins}'"
            );
            Error::Unsuitable { controller: "GaitAdaptive", reason }
        })?;
    }
    Ok(found)
}

/// Quantiles (5, 50, 95 %) of the distances that belong to the estimates nearest to a place.
fn distances(place: f64, found: &mut [(f64, f64)]) -> [f64; 3] {
    let from = |one: &(f64, f64)| (one.0 - place).abs();
    found.sort_by(|a, b| from(a).total_cmp(&from(b)));
    let near = found.iter().filter(|one| from(one) < 0.5 * STEP).count();
    let mut near: Vec<f64> = found.iter().take(near.max(ENOUGH)).map(|one| one.1).collect();
    near.sort_by(f64::total_cmp);
    [0.05, 0.5, 0.95].map(|share| near[(share * (near.len() - 1) as f64) as usize])
}

impl Controller for GaitAdaptive {
    fn observation_size(&self) -> usize {
        self.observation_size
    }

    fn state_size(&self) -> usize {
        FIRST + self.grid.len() + MEMORY
    }

    fn numbers(&self) -> Option<Vec<u8>> {
        saved::written(self)
    }

    fn start(&self, observation: &[f32], state: &mut [f64]) {
        state.fill(0.0);
        // Before it began, the fin was as it is.
        let memory = &mut state[FIRST + self.grid.len()..];
        let measured = self.sensors.map(|at| f64::from(observation[at]));
        for _ in 0..MEMORY / SENSORS {
            remember(measured, memory);
        }
    }

    fn act(&self, observation: &[f32], state: &mut [f64], action: &mut [f32]) {
        let (clock, rest) = state.split_at_mut(FIRST);
        let [steps, phase, number] = clock else { unreachable!("split at three") };
        let (evidence, memory) = rest.split_at_mut(self.grid.len());
        if *steps > 0.0 {
            remember(self.sensors.map(|at| f64::from(observation[at])), memory);
            self.feel.surprise(memory, |i, surprise| {
                evidence[i] = FORGET * evidence[i] - surprise;
            });
        }
        let weights = self.weights(evidence);
        let best = self.best(&weights);
        let more = self.expected(best, &weights) - self.expected(*number as usize, &weights);
        if *steps == 0.0 || more > self.margin {
            *number = best as f64;
        }
        *steps += 1.0;
        let (frequency, amplitude) = GaitAdaptive::gait(*number as usize);
        let scale = demanded(self.demand, observation);
        let command = scale * amplitude * libm::sin(*phase);
        action[0] = command.clamp(-1.0, 1.0) as f32;
        *phase += TAU * frequency * self.control_dt;
        if *phase >= TAU {
            *phase -= TAU;
        }
    }

    fn estimate(&self, state: &[f64], tell: &mut dyn FnMut(Quantity)) {
        let Belief { mean, deviation } = self.belief(state);
        let nearest = |a: &usize, b: &usize| {
            let from = |i: &usize| (self.grid[*i] - mean).abs();
            from(a).total_cmp(&from(b))
        };
        let at = (0..self.grid.len()).min_by(nearest).expect("there are stiffnesses");
        let [low, middle, high] = self.distances[at];
        let wide = NINE_OF_TEN * deviation;
        tell(Quantity {
            name: STIFFNESS,
            unit: "Pa",
            value: libm::exp(mean + middle),
            low: libm::exp(mean + low.min(middle - wide)),
            high: libm::exp(mean + high.max(middle + wide)),
        });
    }
}
