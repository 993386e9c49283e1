//! Steps of fixed size by the chosen scheme, with smaller ones where a step fails.

use super::implicit::{self, Method, Workspace};
use super::{Constant, Drive, prepare, verlet};
use crate::lane::{Lanewise, Mask, Real};
use crate::rod::{Motion, Rod};
use crate::vec2::Vec2;

/// Which scheme advances a rod.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    /// Velocity Verlet.
    Verlet,
    /// Backward Euler, as in the thesis.
    BackwardEuler,
    /// SDIRK2, second order.
    Implicit,
}

impl Scheme {
    /// The word that users type.
    pub fn name(self) -> &'static str {
        match self {
            Scheme::Verlet => "verlet",
            Scheme::BackwardEuler => "backward_euler",
            Scheme::Implicit => "implicit",
        }
    }
}

/// How often a failing implicit step may be halved.
const HALVINGS: u32 = 8;
/// How often a failing run of Verlet steps may be repeated with half the step.
const VERLET_HALVINGS: u32 = 5;

/// A scheme, its step and its memory for one block of rods.
#[derive(Clone, Debug)]
pub struct Integrator<R> {
    scheme: Scheme,
    dt: f64,
    /// Where a run of Verlet steps began.
    saved: Motion<R>,
    work: Workspace<R>,
    spare: Spare,
}

/// Memory to repeat a step of one lane in smaller parts.
#[derive(Clone, Debug)]
struct Spare {
    rod: Rod<f64>,
    /// Before the step, now, and before the part that is being tried.
    before: Motion<f64>,
    now: Motion<f64>,
    part: Motion<f64>,
    work: Workspace<f64>,
}

impl<R: Real> Integrator<R> {
    /// For rods of `nodes` nodes and steps of `dt` \[s\].
    pub fn new(scheme: Scheme, dt: f64, nodes: usize) -> Self {
        let motion = || Motion::new(nodes);
        let verlet = scheme == Scheme::Verlet;
        Integrator {
            scheme,
            dt,
            saved: if verlet { Motion::new(nodes) } else { Motion::default() },
            work: if verlet { Workspace::default() } else { Workspace::new(nodes) },
            spare: Spare {
                rod: Rod::new(nodes),
                before: motion(),
                now: motion(),
                part: motion(),
                work: if verlet { Workspace::default() } else { Workspace::new(nodes) },
            },
        }
    }

    /// To be called when positions and velocities were set from outside: fills what is carried between
    /// steps.
    pub fn prepare(scheme: Scheme, rod: &Rod<f64>, motion: &mut Motion<f64>) {
        match scheme {
            Scheme::Verlet => prepare(rod, motion),
            // What the first implicit step guesses from: no acceleration known yet.
            _ => {
                motion.a.fill(Vec2::zero());
                motion.a_before.fill(Vec2::zero());
            }
        }
    }

    /// Takes `steps` steps under `drive` (Verlet takes its torque once, at the start). Returns where all went well; a
    /// lane that failed even in the smallest parts keeps the state before the step that failed.
    #[inline(always)]
    pub fn advance<D: Drive<R>>(
        &mut self,
        rod: &Rod<R>,
        motion: &mut Motion<R>,
        drive: &D,
        steps: usize,
    ) -> R::Mask {
        let method = match self.scheme {
            Scheme::Verlet => return self.advance_verlet(rod, motion, drive, steps),
            Scheme::BackwardEuler => Method::BackwardEuler,
            Scheme::Implicit => Method::Sdirk2,
        };
        let mut sound = R::Mask::splat(true);
        for _ in 0..steps {
            let mut done = implicit::step(method, rod, motion, drive, self.dt, &mut self.work);
            if !done.and(sound).all() {
                done = self.repair(method, rod, motion, drive, done, sound);
                sound = sound.and(done);
            }
        }
        sound
    }

    /// Repeats a failed implicit step lane by lane in smaller parts.
    #[inline(never)]
    fn repair<D: Drive<R>>(
        &mut self,
        method: Method,
        rod: &Rod<R>,
        motion: &mut Motion<R>,
        drive: &D,
        mut done: R::Mask,
        sound: R::Mask,
    ) -> R::Mask {
        for lane in 0..R::LANES {
            if done.get(lane) && sound.get(lane) {
                continue;
            }
            self.work.read_start(lane, &mut self.spare.before);
            rod.read_lane(lane, &mut self.spare.rod);
            self.spare.now.copy_from(&self.spare.before);
            let repaired = sound.get(lane)
                && self.spare.in_halves(method, &drive.lane(lane), self.dt, HALVINGS);
            motion.set_lane(lane, if repaired { &self.spare.now } else { &self.spare.before });
            done.set(lane, repaired);
        }
        done
    }

    #[inline(always)]
    fn advance_verlet<D: Drive<R>>(
        &mut self,
        rod: &Rod<R>,
        motion: &mut Motion<R>,
        drive: &D,
        steps: usize,
    ) -> R::Mask {
        self.saved.copy_from(motion);
        let torque = drive.torque(&motion.x, &motion.v);
        let sound = verlet(rod, motion, torque, self.dt, steps);
        if sound.all() { sound } else { self.repair_verlet(rod, motion, torque, steps, sound) }
    }

    /// Repeats a failed run of Verlet steps lane by lane with smaller steps.
    #[inline(never)]
    fn repair_verlet(
        &mut self,
        rod: &Rod<R>,
        motion: &mut Motion<R>,
        torque: R,
        steps: usize,
        mut sound: R::Mask,
    ) -> R::Mask {
        for lane in 0..R::LANES {
            if sound.get(lane) {
                continue;
            }
            let Spare { rod: single, before, now, .. } = &mut self.spare;
            self.saved.read_lane(lane, before);
            rod.read_lane(lane, single);
            let repaired = (1..=VERLET_HALVINGS).any(|halvings| {
                let parts = 1usize << halvings;
                now.copy_from(before);
                let dt = self.dt / parts as f64;
                verlet(single, now, torque.get(lane), dt, steps * parts)
            });
            motion.set_lane(lane, if repaired { now } else { before });
            sound.set(lane, repaired);
        }
        sound
    }
}

impl Spare {
    /// Takes a step of `dt` as two halves, each of which may be halved again. False: `now` is not valid.
    fn in_halves<D: Drive<f64>>(&mut self, method: Method, drive: &D, dt: f64, depth: u32) -> bool {
        (0..2).all(|_| {
            self.part.copy_from(&self.now);
            let Spare { rod, now, work, .. } = self;
            if implicit::step(method, rod, now, drive, 0.5 * dt, work) {
                return true;
            }
            self.now.copy_from(&self.part);
            depth > 0 && self.in_halves(method, drive, 0.5 * dt, depth - 1)
        })
    }
}

impl Integrator<f64> {
    /// One rod under a constant torque \[N m\]: `steps` steps; false where the solver gave up.
    pub fn advance_one(
        &mut self,
        rod: &Rod<f64>,
        motion: &mut Motion<f64>,
        torque: f64,
        steps: usize,
    ) -> bool {
        self.advance(rod, motion, &Constant(torque), steps)
    }
}
