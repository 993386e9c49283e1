//! Steps of fixed size by the chosen scheme, with smaller ones where a step fails.

use super::implicit::{self, Method, Workspace};
use super::{Constant, Drive, prepare, verlet};
use crate::lane::{Mask, Real};
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
}

impl<R: Real> Integrator<R> {
    /// For rods of `nodes` nodes and steps of `dt` \[s\].
    pub fn new(scheme: Scheme, dt: f64, nodes: usize) -> Self {
        let (saved, work) = match scheme {
            Scheme::Verlet => (Motion::new(nodes), Workspace::default()),
            _ => (Motion::default(), Workspace::new(nodes)),
        };
        Integrator { scheme, dt, saved, work }
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
            let before = self.work.before(lane);
            let mut after = before.clone();
            let mut work = Workspace::new(rod.nodes());
            let (rod, drive) = (rod.lane(lane), drive.lane(lane));
            let repaired = sound.get(lane)
                && in_halves(method, &rod, &mut after, &drive, self.dt, HALVINGS, &mut work);
            motion.set_lane(lane, if repaired { &after } else { &before });
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
        for lane in (0..R::LANES).filter(|&lane| !sound.get(lane)).collect::<Vec<_>>() {
            let before = self.saved.lane(lane);
            let rod = rod.lane(lane);
            let mut after = before.clone();
            let repaired = (1..=VERLET_HALVINGS).any(|halvings| {
                let parts = 1usize << halvings;
                after.copy_from(&before);
                let dt = self.dt / parts as f64;
                verlet(&rod, &mut after, torque.get(lane), dt, steps * parts)
            });
            motion.set_lane(lane, if repaired { &after } else { &before });
            sound.set(lane, repaired);
        }
        sound
    }
}

/// Takes a step of `dt` as two halves, each of which may be halved again.
fn in_halves<D: Drive<f64>>(
    method: Method,
    rod: &Rod<f64>,
    motion: &mut Motion<f64>,
    drive: &D,
    dt: f64,
    depth: u32,
    work: &mut Workspace<f64>,
) -> bool {
    let before = motion.clone();
    for _ in 0..2 {
        let start = motion.clone();
        if implicit::step(method, rod, motion, drive, 0.5 * dt, work) {
            continue;
        }
        motion.copy_from(&start);
        if depth == 0 || !in_halves(method, rod, motion, drive, 0.5 * dt, depth - 1, work) {
            motion.copy_from(&before);
            return false;
        }
    }
    true
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
