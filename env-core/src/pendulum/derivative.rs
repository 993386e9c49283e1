//! Derivatives of a pendulum's steps by its state vector, by torque or action, and by parameters.
//!
//! Directions go in groups of eight: each group is the same pendulum in dual numbers. What happens once a step (a rod
//! from its parameters, torques from an action, what sensors and tasks make of it) they go through as any number does;
//! through physics steps they are carried along the tape of the step itself (`solver::carry`).

use super::config::{Config, PARAMETERS, at, uniform};
use super::plant::Plant;
use super::sim::BarePendulum;
use super::vector::{empty, set_vector, size, vector};
use crate::batch::{Differentiated, Gradient};
use crate::directions::{check_size, group_count, has_any, seeded, seeded_at};
use crate::error::Result;
use crate::given::place;
use crate::lane::{DIRECTIONS, Dual, Lanewise, Real};
use crate::rod::{Motion, Rod};
use crate::simulation::Named;
use crate::solver::{Carried, Integrator, Phase, Scheme, Tape, carry, pull_back};
use crate::watch::Watch;

/// Physics steps that a tape of the bare pendulum holds at once.
const TAPE: usize = 64;

/// A pendulum on its way, apart from what stays.
#[derive(Clone)]
struct Course {
    motion: Motion<f64>,
    integrator: Integrator<f64>,
    steps: u64,
}

impl BarePendulum {
    /// What the next `n` physics steps under a constant torque \[N m\] would be.
    ///
    /// # Errors
    /// A step that fails in the smallest parts.
    pub fn tape(&self, torque: f64, n: usize) -> Result<Tape> {
        let mut tape = Tape::new(self.nodes(), n);
        self.record(&mut self.course(), torque, n, Watch::nobody(), &mut tape)?;
        Ok(tape)
    }

    fn course(&self) -> Course {
        let BarePendulum { motion, integrator, steps, .. } = self;
        Course { motion: motion.clone(), integrator: integrator.clone(), steps: *steps }
    }

    /// `n` physics steps, written down.
    fn record(
        &self,
        course: &mut Course,
        torque: f64,
        n: usize,
        watch: Watch<'_>,
        tape: &mut Tape,
    ) -> Result<()> {
        let Course { motion, integrator, steps } = course;
        for _ in 0..n {
            if !integrator.record(&self.rod, motion, torque, 1, watch, tape) && !watch.stops() {
                return Err(self.failed(*steps));
            }
            *steps += 1;
        }
        Ok(())
    }

    /// Derivatives of the state after `n` physics steps under a constant torque \[N m\]: `A` by the state, `B` by the
    /// torque, `P` by the parameters of these names. They mean nothing once `watch` has stopped them.
    ///
    /// # Errors
    /// A torque that is not finite, an unknown name, a step that fails in the smallest parts.
    pub fn jacobian(
        &self,
        torque: f64,
        n: u64,
        parameters: &[String],
        watch: Watch<'_>,
    ) -> Result<Vec<Named>> {
        super::sim::check_torque(torque)?;
        let chosen = chosen(parameters)?;
        let (scheme, nodes) = (self.config.scheme, self.nodes());
        let state = self.state_vector();
        let (s, p) = (state.len(), chosen.len());
        let mut groups: Vec<_> = (0..group_count(s + 1 + p))
            .map(|group| {
                let rod = has_any(group, s + 1, p)
                    .then(|| uniform(nodes, &seeded_at(&self.values, &chosen, s + 1, group)).rod());
                let (mut motion, mut past) = empty(scheme, nodes);
                set_vector(scheme, &seeded(&state, 0, group), &mut motion, &mut past);
                (rod, motion, past, seeded(&[torque], s, group)[0])
            })
            .collect();
        let mut course = self.course();
        let hand = course.motion.x[1];
        let tape = Tape::new(nodes, n.min(TAPE as u64) as usize);
        let mut phases = [Phase { tape, torque, hand: [hand, hand] }];
        let mut left = n;
        while left > 0 && !watch.stops() {
            let [Phase { tape, hand, .. }] = &mut phases;
            tape.clear();
            hand[0] = course.motion.x[1];
            let run = left.min(TAPE as u64);
            left -= run;
            self.record(&mut course, torque, run as usize, watch, tape)?;
            hand[1] = course.motion.x[1];
            let mut carried: Vec<_> = groups
                .iter_mut()
                .map(|(rod, motion, past, torque)| Carried {
                    rod: rod.as_ref(),
                    motion,
                    past,
                    torques: vec![*torque],
                })
                .collect();
            carry(&self.rod, &phases, &mut carried)?;
        }
        if n > 0 {
            // From now on the step before is known, whatever was.
            groups.iter_mut().for_each(|(_, _, past, _)| past.known = Dual::default());
        }
        let next: Vec<_> =
            groups.iter().map(|(_, motion, past, _)| vector(scheme, motion, past)).collect();
        let next: Vec<&[Dual]> = next.iter().map(Vec::as_slice).collect();
        Ok(vec![
            Named::slopes("A", &next, 0, s),
            Named::slopes("B", &next, s, 1),
            Named::slopes("P", &next, s + 1, p),
        ])
    }
}

impl BarePendulum {
    /// The way back: from the gradient of a number by the state after `n` physics steps to those by the state (`x`), by
    /// the torque (`input`) and by parameters (`parameters`): its product with the matrices of `jacobian`.
    ///
    /// # Errors
    /// Those of `jacobian`; not as many numbers as the state has.
    pub fn pull_back(
        &self,
        torque: f64,
        n: u64,
        parameters: &[String],
        gradient: &[f64],
    ) -> Result<Vec<Named>> {
        super::sim::check_torque(torque)?;
        let chosen = chosen(parameters)?;
        let (scheme, nodes) = (self.config.scheme, self.nodes());
        check_size("gradient", gradient, size(scheme, nodes))?;
        let materials = materials(nodes, &self.values, &chosen);
        let (mut motion, mut past) = empty(scheme, nodes);
        set_vector(scheme, gradient, &mut motion, &mut past);
        let (mut by_torque, mut by_parameters) = (0.0, vec![0.0; materials.len() * DIRECTIONS]);
        // Where every tape begins.
        let mut starts = vec![self.course()];
        let tapes = n.div_ceil(TAPE as u64);
        for _ in 1..tapes {
            let mut course = starts[starts.len() - 1].clone();
            let Course { motion, integrator, steps } = &mut course;
            for _ in 0..TAPE {
                if !integrator.advance_one(&self.rod, motion, torque, 1) {
                    return Err(self.failed(*steps));
                }
                *steps += 1;
            }
            starts.push(course);
        }
        let mut left = n - n.min((tapes.max(1) - 1) * TAPE as u64);
        for mut course in starts.into_iter().rev() {
            let start = course.motion.x[1];
            let mut tape = Tape::new(nodes, left as usize);
            self.record(&mut course, torque, left as usize, Watch::nobody(), &mut tape)?;
            left = TAPE as u64;
            let phases = [Phase { tape, torque, hand: [start, course.motion.x[1]] }];
            let (torques, sums) =
                pull_back(&self.rod, &phases, &materials, (&mut motion, &mut past))?;
            by_torque += torques[0];
            by_parameters.iter_mut().zip(sums).for_each(|(to, more)| *to += more);
        }
        by_parameters.truncate(chosen.len());
        if n > 0 {
            past.known = 0.0;
        }
        Ok(vec![
            Named::vector("x", vector(scheme, &motion, &past)),
            Named::vector("input", vec![by_torque]),
            Named::vector("parameters", by_parameters),
        ])
    }
}

/// Rods of which the directions are those of the parameters, in groups.
fn materials(nodes: usize, values: &[f64], chosen: &[usize]) -> Vec<Rod<Dual>> {
    let group = |group| uniform(nodes, &seeded_at(values, chosen, 0, group)).rod();
    (0..group_count(chosen.len())).map(group).collect()
}

/// Places of the bare pendulum's parameters of these names.
fn chosen(names: &[String]) -> Result<Vec<usize>> {
    let known: Vec<_> = PARAMETERS[..at::TORQUE_LIMIT].iter().map(|row| row.name).collect();
    names.iter().map(|name| place(name, &known)).collect()
}

/// How many of the torques that were asked for the next control step still needs.
fn on_their_way(config: &Config) -> usize {
    config.delay.div_ceil(config.substeps)
}

/// The state of a pendulum with its motor: see `vector`; then the torques on their way to it, newest first.
pub fn plant_vector<R: Real>(config: &Config, plant: &Plant<R>) -> Vec<R> {
    let mut all = vector(config.scheme, &plant.motion, &plant.integrator.past);
    all.extend_from_slice(&plant.commands[..on_their_way(config)]);
    all
}

/// The numbers by which a state is differentiated.
#[derive(Clone, Copy, PartialEq)]
pub enum By {
    /// All of its vector.
    Vector,
    /// Those of `essence`.
    Essence,
}

/// Whether velocity v and acceleration a matter to the next steps as v + a dt/2 alone, as the first half of a Verlet step
/// has it.
fn merges(config: &Config) -> bool {
    config.scheme == Scheme::Verlet
}

/// The state as as few numbers as its future depends on: where `merges`, x and v + a dt/2 of every node, with the
/// acceleration a that there is without a torque. Then the torques on their way.
pub fn essence<R: Real>(config: &Config, plant: &Plant<R>) -> Vec<R> {
    let mut all = plant_vector(config, plant);
    if merges(config) {
        let list = 2 * (config.nodes - 1);
        let half = R::splat(0.5 * config.physics_dt);
        for i in list..2 * list {
            let kick = all[list + i] * half;
            all[i] += kick;
        }
        all.drain(2 * list..3 * list);
    }
    all
}

/// Positions and velocities of the nodes that move.
pub fn coordinates<R: Real>(config: &Config, plant: &Plant<R>) -> Vec<R> {
    let mut all = vector(config.scheme, &plant.motion, &plant.integrator.past);
    all.truncate(4 * (config.nodes - 1));
    all
}

/// The state's numbers, of which those that it is differentiated by have the first directions; how many these are.
fn directed(config: &Config, state: &[f64], by: By, group: usize) -> (Vec<Dual>, usize) {
    if by == By::Vector || !merges(config) {
        return (seeded(state, 0, group), state.len());
    }
    // By v a state changes as by v + a dt/2.
    let list = 2 * (config.nodes - 1);
    let mut seeds = seeded(&state[..2 * list], 0, group);
    seeds.extend(state[2 * list..3 * list].iter().map(|&a| Dual::constant(a)));
    seeds.extend(seeded(&state[3 * list..], 2 * list, group));
    (seeds, state.len() - list)
}

/// A plant as it is, in groups of directions: by its state, its last action and the parameters in these places.
pub fn variables(
    config: &Config,
    plant: &Plant<f64>,
    by: By,
    chosen: &[usize],
) -> Vec<Plant<Dual>> {
    let state = plant_vector(config, plant);
    let own = state.len() - on_their_way(config);
    let s = directed(config, &state, by, 0).1;
    let memory = Plant::<Dual>::new(config);
    let mut groups = vec![memory; group_count(s + 1 + chosen.len())];
    for (group, dual) in groups.iter_mut().enumerate() {
        dual.pair(plant, &mut |to: &mut Dual, from| *to = Dual::constant(*from));
        let parameters = seeded_at(&plant.parameters, chosen, s + 1, group);
        dual.parameters.copy_from_slice(&parameters);
        uniform(config.nodes, &dual.parameters).shape(&mut dual.rod);
        let (seeds, _) = directed(config, &state, by, group);
        set_vector(config.scheme, &seeds[..own], &mut dual.motion, &mut dual.integrator.past);
        dual.commands[..state.len() - own].copy_from_slice(&seeds[own..]);
        dual.action = seeded(&[plant.action], s, group)[0];
        dual.posture = dual.take_posture();
    }
    groups
}

/// What an action is: its value within the bounds, and whether it was within them, where it has a slope.
#[derive(Clone, Copy)]
pub struct Told {
    pub action: f64,
    pub inside: bool,
    /// The torque that disturbs the step \[N m\].
    pub disturbance: f64,
}

/// Takes a control step, written down; `None` where the solver gave up.
pub fn advance(config: &Config, plant: &mut Plant<f64>, told: Told) -> Option<Vec<Phase>> {
    let mut phases = vec![];
    for (torque, steps) in plant.take(config, told.action, told.disturbance) {
        plant.torque = torque;
        if steps == 0 {
            continue;
        }
        let mut tape = Tape::new(config.nodes, steps);
        let Plant { rod, motion, integrator, torque, .. } = plant;
        let start = motion.x[1];
        if !integrator.record(rod, motion, *torque, steps, Watch::nobody(), &mut tape) {
            return None;
        }
        phases.push(Phase { tape, torque: *torque, hand: [start, motion.x[1]] });
    }
    plant.posture = plant.take_posture();
    Some(phases)
}

/// One control step and its derivatives, see `Machine::differentiate`.
pub fn differentiate(
    config: &Config,
    plant: &Plant<f64>,
    told: Told,
    by: By,
    chosen: &[usize],
) -> Result<Option<Differentiated<Plant<Dual>>>> {
    let mut plants = variables(config, plant, by, chosen);
    let s = directed(config, &plant_vector(config, plant), by, 0).1;
    let mut torques = vec![vec![]; plants.len()];
    for (group, dual) in plants.iter_mut().enumerate() {
        let mut action = seeded(&[told.action], s, group)[0];
        if !told.inside {
            action = Dual::constant(told.action);
        }
        for (torque, steps) in dual.take(config, action, Dual::constant(told.disturbance)) {
            dual.torque = torque;
            if steps > 0 {
                torques[group].push(dual.torque);
            }
        }
    }
    let mut values = plant.clone();
    let Some(phases) = advance(config, &mut values, told) else { return Ok(None) };
    let mut carried: Vec<_> = plants
        .iter_mut()
        .zip(torques)
        .enumerate()
        .map(|(group, (plant, torques))| {
            let Plant { rod, motion, integrator: Integrator { past, .. }, .. } = plant;
            let rod = has_any(group, s + 1, chosen.len()).then_some(&*rod);
            Carried { rod, motion, past, torques }
        })
        .collect();
    carry(&plant.rod, &phases, &mut carried)?;
    for dual in &mut plants {
        let value = &mut |to: &mut Dual, from: &f64| to.value = *from;
        dual.motion.pair(&values.motion, value);
        dual.integrator.pair(&values.integrator, value);
        dual.integrator.past.known = Dual::constant(values.integrator.past.known);
        dual.posture = dual.take_posture();
    }
    let next = plants.iter().map(|dual| match by {
        By::Vector => plant_vector(config, dual),
        By::Essence => essence(config, dual),
    });
    let next = next.collect();
    Ok(Some(Differentiated { next, plants }))
}

/// The way back through one control step, see `Machine::pull_back`.
pub fn pull_back_step(
    config: &Config,
    plant: &Plant<f64>,
    told: Told,
    chosen: &[usize],
    gradient: &[f64],
) -> Result<Option<Gradient>> {
    let mut values = plant.clone();
    let Some(phases) = advance(config, &mut values, told) else { return Ok(None) };
    let (late, part) = (on_their_way(config), config.delay % config.substeps);
    let own = gradient.len() - late;
    let (mut motion, mut past) = empty(config.scheme, config.nodes);
    set_vector(config.scheme, &gradient[..own], &mut motion, &mut past);
    let materials = materials(config.nodes, &plant.parameters, chosen);
    let (torques, mut parameters) =
        pull_back(&plant.rod, &phases, &materials, (&mut motion, &mut past))?;
    // By the commands once the new one has come in: see `Plant::take`.
    let mut commands = vec![0.0; plant.commands.len()];
    commands[..late].copy_from_slice(&gradient[own..]);
    let old = config.delay / config.substeps;
    commands[old] += torques[torques.len() - 1];
    if part > 0 {
        commands[old + 1] += torques[0];
    }
    parameters.truncate(chosen.len());
    for (by, &i) in parameters.iter_mut().zip(chosen) {
        if i == at::TORQUE_LIMIT {
            *by += commands[0] * told.action * config.gain;
        }
    }
    past.known = 0.0;
    let mut state = vector(config.scheme, &motion, &past);
    state.extend_from_slice(&commands[1..=late]);
    let slope = if told.inside { plant.parameters[at::TORQUE_LIMIT] * config.gain } else { 0.0 };
    Ok(Some(Gradient { state, action: vec![commands[0] * slope], parameters }))
}
