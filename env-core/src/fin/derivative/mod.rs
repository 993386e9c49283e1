//! Derivatives of a fin's steps by its state vector, by pitch or action, and by parameters.
//!
//! Directions go in groups of eight: each group is the same fin in dual numbers. What happens once a step (servo, material,
//! what sensors and tasks make of it) they go through as any number does; through physics steps they are carried along
//! the tape of the step itself.

mod adjoint;
mod linear;
mod material;
mod plant;
mod tangent;
mod vector;

pub(super) use plant::{
    Told, advance, differentiate, measured, plant_vector, pull_back_step, variables,
};

use super::motion::Loads;
use super::servo::{STAGES, Servo};
use super::{BareFin, Body, Parameters};
use crate::directions::{check_size, group_count, seeded, seeded_at};
use crate::error::{Error, Result};
use crate::given::place;
use crate::lane::{DIRECTIONS, Dual, Lanewise};
use crate::simulation::{Named, Simulation};
use crate::solver::Tape;
use crate::watch::Watch;
use adjoint::{Pulled, pull_back};
use tangent::{Carried, carry};
use vector::{set_vector, size, vector};

/// Physics steps that a tape of the bare fin holds at once.
const TAPE: usize = 64;

/// The same fin, the parameters in some places as directions from `first` on, as a group has them.
fn in_directions(body: &Body<f64>, chosen: &[usize], first: usize, group: usize) -> Body<Dual> {
    let mut dual = Body::<Dual>::new(body.design.as_ref().clone()).expect("checked before");
    direct(&mut dual, body, chosen, first, group);
    dual
}

/// Makes a fin in dual numbers such a one.
fn direct(dual: &mut Body<Dual>, body: &Body<f64>, chosen: &[usize], first: usize, group: usize) {
    dual.pair(body, &mut |to: &mut Dual, from| *to = Dual::constant(*from));
    let mut values = vec![];
    body.parameters.visit(&mut |x| values.push(*x));
    let mut seeds = seeded_at(&values, chosen, first, group).into_iter();
    dual.parameters.visit_mut(&mut |x| *x = seeds.next().expect("one each"));
    dual.shape();
}

/// Fins of which the directions are those of the parameters, in groups.
fn materials(body: &Body<f64>, chosen: &[usize]) -> Vec<Body<Dual>> {
    let count = group_count(chosen.len());
    (0..count).map(|group| in_directions(body, chosen, 0, group)).collect()
}

/// Places of the parameters of these names.
fn chosen(names: &[String]) -> Result<Vec<usize>> {
    let table = Parameters::table();
    let known: Vec<_> = table.iter().map(|row| row.name).collect();
    names.iter().map(|name| place(name, &known)).collect()
}

/// Gradients that are to be taken back, from those by a state vector; a vector of the same shape takes them in the end.
fn gradients(body: &Body<f64>, state: &[f64], steps: usize, groups: usize) -> (Pulled, Servo<f64>) {
    let mut shape = body.clone();
    let mut servo = Servo::default();
    set_vector(state, &mut shape, &mut servo);
    let (mut now, mut before) = (shape.now, shape.past.before);
    for at in [&mut now, &mut before] {
        // (The state has no momentum of its own.)
        at.p.fill(crate::vec2::Vec2::zero());
    }
    let pulled = Pulled {
        now,
        before,
        pitches: vec![0.0; steps + 1],
        loads: Loads::default(),
        parameters: vec![[0.0; DIRECTIONS]; groups],
    };
    (pulled, servo)
}

/// The gradient by a state vector.
fn gradient_vector(body: &Body<f64>, pulled: &Pulled, servo: &Servo<f64>) -> Vec<f64> {
    let mut shape = body.clone();
    shape.now.copy_from(&pulled.now);
    shape.past.before.copy_from(&pulled.before);
    shape.past.known = 0.0;
    vector(&shape, servo)
}

/// Gradients by parameters, a number each.
fn by_parameters(pulled: &Pulled, count: usize) -> Vec<f64> {
    pulled.parameters.as_flattened()[..count].to_vec()
}

impl BareFin {
    /// Derivatives of the state after `n` physics steps that end at a pitch \[rad\]: `A` by the state, `B` by the pitch,
    /// `P` by the parameters of these names. They mean nothing once `watch` has stopped them.
    ///
    /// # Errors
    /// A pitch that is not finite, an unknown name, a step that fails in the smallest parts.
    pub fn jacobian(
        &self,
        pitch: f64,
        n: u64,
        parameters: &[String],
        watch: Watch<'_>,
    ) -> Result<Vec<Named>> {
        check_pitch(pitch)?;
        let chosen = chosen(parameters)?;
        let state = self.state_vector();
        let (s, p) = (state.len(), chosen.len());
        let mut groups: Vec<(Body<Dual>, Servo<Dual>, Dual)> = (0..group_count(s + 1 + p))
            .map(|group| {
                let mut body = in_directions(&self.body, &chosen, s + 1, group);
                let mut servo = Servo::default();
                set_vector(&seeded(&state, 0, group), &mut body, &mut servo);
                (body, servo, seeded(&[pitch], s, group)[0])
            })
            .collect();
        let mut sim = self.clone();
        let mut tape = Tape::new(self.body.nodes(), n.min(TAPE as u64) as usize);
        let mut left = n;
        while left > 0 && !watch.stops() {
            tape.clear();
            let run = left.min(TAPE as u64);
            left -= run;
            for _ in 0..run {
                sim.record(pitch, watch, &mut tape)?;
            }
            let mut carried: Vec<_> = groups
                .iter_mut()
                .map(|(body, _, pitch)| Carried {
                    body,
                    pitches: vec![*pitch; run as usize],
                    loads: Loads::default(),
                })
                .collect();
            carry(&self.body, &tape, &mut carried)?;
        }
        let next = |(body, servo, pitch): &mut (Body<Dual>, Servo<Dual>, Dual)| {
            if n > 0 {
                body.past.known = Dual::default();
                *servo = settled(*pitch);
            }
            vector(body, servo)
        };
        let next: Vec<_> = groups.iter_mut().map(next).collect();
        let next: Vec<&[Dual]> = next.iter().map(Vec::as_slice).collect();
        Ok(vec![
            Named::slopes("A", &next, 0, s),
            Named::slopes("B", &next, s, 1),
            Named::slopes("P", &next, s + 1, p),
        ])
    }

    /// The way back: from the gradient of a number by the state after `n` physics steps to those by the state (`x`), by
    /// the pitch (`input`) and by parameters (`parameters`): its product with the matrices of `jacobian`.
    ///
    /// # Errors
    /// Those of `jacobian`; not as many numbers as the state has.
    pub fn pull_back(
        &self,
        pitch: f64,
        n: u64,
        parameters: &[String],
        gradient: &[f64],
    ) -> Result<Vec<Named>> {
        check_pitch(pitch)?;
        let chosen = chosen(parameters)?;
        check_size("gradient", gradient, size(&self.body.design))?;
        let materials = materials(&self.body, &chosen);
        let (mut pulled, mut servo) = gradients(&self.body, gradient, 0, materials.len());
        let mut state = gradient.to_vec();
        let mut by_pitch = 0.0;
        if n > 0 {
            servo.visit(&mut |x| by_pitch += x);
            // (Rates are 0 then, whatever was before.)
            by_pitch -= servo.rate + servo.smoothed.iter().map(|stage| stage.rate).sum::<f64>();
            servo = Servo::default();
            // Where every tape begins.
            let mut starts = vec![self.clone()];
            let tapes = n.div_ceil(TAPE as u64);
            for _ in 1..tapes {
                let mut sim = starts[starts.len() - 1].clone();
                Simulation::step(&mut sim, pitch, TAPE as u64)?;
                starts.push(sim);
            }
            let mut left = n - (tapes - 1) * TAPE as u64;
            for start in starts.into_iter().rev() {
                let mut tape = Tape::new(self.body.nodes(), left as usize);
                let mut sim = start.clone();
                for _ in 0..left {
                    sim.record(pitch, Watch::nobody(), &mut tape)?;
                }
                pulled.pitches = vec![0.0; left as usize + 1];
                left = TAPE as u64;
                pull_back(&start.body, &tape, &materials, &mut pulled)?;
                by_pitch += pulled.pitches[1..].iter().sum::<f64>();
                // The pitch before is that of the run before this one; that before the first is the servo's.
                servo.angle = pulled.pitches[0];
                by_pitch += servo.angle;
            }
            by_pitch -= servo.angle;
            state = gradient_vector(&self.body, &pulled, &servo);
        }
        Ok(vec![
            Named::vector("x", state),
            Named::vector("input", vec![by_pitch]),
            Named::vector("parameters", by_parameters(&pulled, chosen.len())),
        ])
    }

    /// What the next `n` physics steps to a pitch \[rad\] would be.
    ///
    /// # Errors
    /// A step that fails in the smallest parts.
    pub fn tape(&self, pitch: f64, n: usize) -> Result<Tape> {
        let mut sim = self.clone();
        let mut tape = Tape::new(self.body.nodes(), n);
        for _ in 0..n {
            sim.record(pitch, Watch::nobody(), &mut tape)?;
        }
        Ok(tape)
    }

    /// A physics step that ends at this pitch, written down.
    fn record(&mut self, pitch: f64, watch: Watch<'_>, tape: &mut Tape) -> Result<()> {
        if !self.body.record(pitch, watch, tape) && !watch.stops() {
            return Err(self.failed(pitch));
        }
        self.steps += 1;
        self.servo.place(0, pitch, 0.0, pitch);
        Ok(())
    }
}

/// A servo that stands still.
fn settled(angle: Dual) -> Servo<Dual> {
    let zero = Dual::default();
    let stage = super::servo::Lag { angle, rate: zero };
    Servo { angle, rate: zero, smoothed: [stage; STAGES] }
}

/// Refuses a pitch that is not finite.
pub(super) fn check_pitch(pitch: f64) -> Result<()> {
    if pitch.is_finite() {
        return Ok(());
    }
    Err(Error::parameter("pitch", pitch, "finite"))
}
