//! Derivatives of a control step of the fin with its servo, and the way back through it.

use super::tangent::Carried;
use super::vector::{SERVO, set_vector, size, vector};
use super::{by_parameters, carry, direct, gradient_vector, gradients, materials, pull_back};
use crate::batch::{Differentiated, Gradient};
use crate::directions::{group_count, seeded};
use crate::error::Result;
use crate::fin::motion::Loads;
use crate::fin::plant::{Stepper, command, forgets};
use crate::fin::servo::Servo;
use crate::fin::{Body, Config, Plant};
use crate::lane::{DIRECTIONS, Dual, Lanewise, Real};
use crate::solver::Tape;
use crate::watch::Watch;

/// How many of the commands that were given the next control step still needs.
fn on_their_way(config: &Config) -> usize {
    config.delay.div_ceil(config.substeps)
}

/// The state of a fin with its servo: see `vector`; then the commands on their way to it, newest first, and the smoothed
/// thrust.
pub(in crate::fin) fn plant_vector<R: Real>(config: &Config, plant: &Plant<R>) -> Vec<R> {
    let mut all = vector(&plant.body, &plant.servo);
    all.extend_from_slice(&plant.commands[..on_their_way(config)]);
    all.push(plant.smooth_thrust);
    all
}

/// What a control step is measured by, beside the state: mean loads and speed.
fn measures<R: Real>(plant: &mut Plant<R>) -> Vec<&mut R> {
    let loads = &mut plant.mean;
    let mut all = vec![
        &mut loads.thrust,
        &mut loads.shed_thrust,
        &mut loads.resistive_thrust,
        &mut loads.mount_thrust,
        &mut loads.torque,
        &mut loads.power,
        &mut loads.positive_power,
    ];
    all.push(&mut plant.speed);
    all
}

/// How many such numbers there are: the loads and the speed.
pub(in crate::fin) fn measured() -> usize {
    let mut count = 1;
    Loads::<f64>::default().visit(&mut |_: &f64| count += 1);
    count
}

/// A plant as it is, in groups of directions: by its vector, from `first` on by its last action and by the parameters in
/// these places.
fn groups(config: &Config, plant: &Plant<f64>, chosen: &[usize], first: usize) -> Vec<Plant<Dual>> {
    let state = plant_vector(config, plant);
    let (own, late) = (size(&config.design), on_their_way(config));
    let memory = Plant::<Dual>::new(config);
    let mut groups = vec![memory; group_count(first + 1 + chosen.len())];
    for (group, dual) in groups.iter_mut().enumerate() {
        dual.pair(plant, &mut |to: &mut Dual, from| *to = Dual::constant(*from));
        direct(&mut dual.body, &plant.body, chosen, first + 1, group);
        let seeds = seeded(&state, 0, group);
        set_vector(&seeds[..own], &mut dual.body, &mut dual.servo);
        dual.commands[..late].copy_from_slice(&seeds[own..own + late]);
        dual.smooth_thrust = seeds[own + late];
    }
    groups
}

/// A plant as it is, in groups of directions: by its vector, by what its last control step is measured by, by its last
/// action and by the parameters in these places.
pub(in crate::fin) fn variables(
    config: &Config,
    plant: &Plant<f64>,
    chosen: &[usize],
) -> Vec<Plant<Dual>> {
    let s = plant_vector(config, plant).len();
    let mut plant = plant.clone();
    let values: Vec<f64> = measures(&mut plant).into_iter().map(|x| *x).collect();
    let mut groups = groups(config, &plant, chosen, s + values.len());
    for (group, dual) in groups.iter_mut().enumerate() {
        for (to, seed) in measures(dual).into_iter().zip(seeded(&values, s, group)) {
            *to = seed;
        }
        if on_their_way(config) == 0 {
            dual.commands[0] = seeded(&[plant.commands[0]], s + values.len(), group)[0];
        }
    }
    groups
}

/// What an action is: its value within the bounds, and whether it was within them, where it has a slope.
#[derive(Clone, Copy)]
pub(in crate::fin) struct Told {
    pub action: f64,
    pub inside: bool,
    /// What is added to the command on its way.
    pub disturbance: Option<f64>,
}

/// Writes down the physics steps that it takes.
struct Written(Tape);

impl Stepper<f64> for Written {
    fn stops(&self) -> bool {
        false
    }
    fn step(&mut self, body: &mut Body<f64>, pitch: f64) -> bool {
        body.record(pitch, Watch::nobody(), &mut self.0)
    }
}

/// Takes a control step, written down; `None` where the solver gave up.
pub(in crate::fin) fn advance(config: &Config, plant: &mut Plant<f64>, told: Told) -> Option<Tape> {
    let mut written = Written(Tape::new(plant.body.nodes(), config.substeps));
    let sound = plant.control_step_by(config, told.action, told.disturbance, &mut written);
    sound.then_some(written.0)
}

/// One control step and its derivatives, see `Machine::differentiate`.
pub(in crate::fin) fn differentiate(
    config: &Config,
    plant: &Plant<f64>,
    told: Told,
    chosen: &[usize],
) -> Result<Option<Differentiated<Plant<Dual>>>> {
    let mut values = plant.clone();
    let Some(tape) = advance(config, &mut values, told) else { return Ok(None) };
    let s = plant_vector(config, plant).len();
    let mut plants = groups(config, plant, chosen, s);
    let pivot = config.design.geometry.pivot;
    let starts: Vec<Dual> = plants.iter().map(|dual| dual.body.now.x[pivot].x).collect();
    let mut carried = vec![];
    for (group, dual) in plants.iter_mut().enumerate() {
        let mut action = seeded(&[told.action], s, group)[0];
        if !told.inside {
            action = Dual::constant(told.action);
        }
        dual.take(action);
        let Plant { body, servo, commands, .. } = dual;
        let pitches = pitches(config, servo, commands, told.disturbance);
        carried.push(Carried { body, pitches, loads: Loads::default() });
    }
    carry(&plant.body, &tape, &mut carried)?;
    let loads: Vec<Loads<Dual>> = carried.into_iter().map(|one| one.loads).collect();
    for ((dual, loads), start) in plants.iter_mut().zip(loads).zip(starts) {
        let value = &mut |to: &mut Dual, from: &f64| to.value = *from;
        dual.body.pair(&values.body, value);
        dual.body.past.known = Dual::constant(values.body.past.known);
        dual.mean = Loads::default();
        dual.mean.add(Dual::constant(1.0 / config.substeps as f64), &loads);
        dual.mean.pair(&values.mean, value);
        dual.conclude(config, start);
        dual.pair(&values, value);
    }
    let next = plants.iter().map(|dual| plant_vector(config, dual)).collect();
    Ok(Some(Differentiated { next, plants }))
}

/// The pitches to which the physics steps of a control step come; the servo is at the last one then.
fn pitches(
    config: &Config,
    servo: &mut Servo<Dual>,
    commands: &[Dual],
    disturbance: Option<f64>,
) -> Vec<Dual> {
    let turn = |step| {
        let disturbance = disturbance.map(Dual::constant);
        servo.advance(command(config, commands, step, disturbance), &config.ticks);
        servo.angle
    };
    (0..config.substeps).map(turn).collect()
}

/// The way back through one control step, see `Machine::pull_back`.
pub(in crate::fin) fn pull_back_step(
    config: &Config,
    plant: &Plant<f64>,
    told: Told,
    chosen: &[usize],
    gradient: &[f64],
) -> Result<Option<Gradient>> {
    let mut values = plant.clone();
    let Some(tape) = advance(config, &mut values, told) else { return Ok(None) };
    let (own, late) = (size(&config.design), on_their_way(config));
    let (by_own, by_more) = gradient.split_at(own);
    let (by_commands, by_rest) = by_more.split_at(late);
    let (mut by_smooth, by_measures) = (by_rest[0], &by_rest[1..]);
    let materials = materials(&plant.body, chosen);
    let (mut pulled, by_servo) = gradients(&plant.body, by_own, config.substeps, materials.len());
    // What the step is measured by.
    let mut measured = values;
    for (to, by) in measures(&mut measured).into_iter().zip(by_measures) {
        *to = *by;
    }
    let Plant { mut mean, speed: by_speed, .. } = measured;
    mean.shed_thrust += forgets(config) * by_smooth;
    by_smooth *= 1.0 - forgets(config);
    pulled.loads.add(1.0 / config.substeps as f64, &mean);
    let pivot = config.design.geometry.pivot;
    let by_way = by_speed / config.control_dt;
    pulled.now.x[pivot].x -= by_way;
    pull_back(&plant.body, &tape, &materials, &mut pulled)?;
    pulled.now.x[pivot].x += by_way;
    // The servo's own derivatives: by its numbers, and by the two commands that it may be told.
    let mut numbers = vec![];
    plant.servo.visit(&mut |x| numbers.push(*x));
    let old = config.delay / config.substeps;
    let mut commands = vec![told.action];
    commands.extend_from_slice(&plant.commands[..plant.commands.len() - 1]);
    numbers.extend_from_slice(&commands[old..]);
    let mut by_numbers = vec![0.0; numbers.len()];
    for group in 0..group_count(numbers.len()) {
        let seeds = seeded(&numbers, 0, group);
        let (mut servo, mut next) = (Servo::default(), seeds.iter());
        servo.visit_mut(&mut |x| *x = *next.next().expect("there are more"));
        let mut told_commands: Vec<Dual> = commands.iter().map(|&x| Dual::constant(x)).collect();
        told_commands[old..].copy_from_slice(&seeds[SERVO..]);
        let mut add = |x: &Dual, by: f64| {
            let first = group * DIRECTIONS;
            for (to, slope) in by_numbers[first..].iter_mut().zip(x.slopes) {
                *to += by * slope;
            }
        };
        let pitches = pitches(config, &mut servo, &told_commands, told.disturbance);
        for (pitch, by) in pitches.iter().zip(&pulled.pitches[1..]) {
            add(pitch, *by);
        }
        let (mut ends, mut by_ends) = (vec![], vec![]);
        servo.visit(&mut |x| ends.push(*x));
        by_servo.visit(&mut |by| by_ends.push(*by));
        ends.iter().zip(by_ends).for_each(|(end, by)| add(end, by));
    }
    by_numbers[0] += pulled.pitches[0];
    let mut by_start = Servo::default();
    let mut next = by_numbers.iter();
    by_start.visit_mut(&mut |x| *x = *next.next().expect("there are more"));
    // By the commands once the new one has come in: see `Plant::take`.
    let mut by_told = vec![0.0; commands.len()];
    by_told[..late].copy_from_slice(by_commands);
    for (to, by) in by_told[old..].iter_mut().zip(&by_numbers[SERVO..]) {
        *to += by;
    }
    let mut state = gradient_vector(&plant.body, &pulled, &by_start);
    state.extend_from_slice(&by_told[1..=late]);
    state.push(by_smooth);
    let action = vec![if told.inside { by_told[0] } else { 0.0 }];
    Ok(Some(Gradient { state, action, parameters: by_parameters(&pulled, chosen.len()) }))
}
