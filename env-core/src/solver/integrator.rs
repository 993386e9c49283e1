//! Steps of fixed size of a pinned rod by the chosen scheme, with smaller ones where a step fails.

use super::pinned::{Elimination, Pinned};
use super::tape::{Move, Recorded, Tape};
use super::{Constant, Drive, Past, Scheme, Solver, Witness, prepare, verlet};
use crate::lane::{Lanewise, Mask, Real};
use crate::lanewise;
use crate::rod::{Motion, Rod};
use crate::vec2::Vec2;
use crate::watch::Watch;

/// How often a failing run of Verlet steps may be repeated with half the step.
const VERLET_HALVINGS: u32 = 5;

/// A scheme, its step and its memory for one block of rods.
#[derive(Clone, Debug)]
pub struct Integrator<R: Real> {
    /// What the scheme remembers of the step before.
    pub past: Past<R, Motion<R>>,
    method: Method<R>,
}

lanewise!(Integrator: past);

#[derive(Clone, Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "one stands in each block, in place, beside its arrays"
)]
enum Method<R: Real> {
    Verlet(Verlet<R>),
    Implicit(Solver<R::Mask, Motion<R>>, Elimination<R>),
}

impl<R: Real> Integrator<R> {
    /// For rods of `nodes` nodes and steps of `dt` \[s\].
    pub fn new(scheme: Scheme, dt: f64, nodes: usize) -> Self {
        let motion = || Motion::new(nodes);
        let method = match scheme.table() {
            None => Method::Verlet(Verlet { dt, saved: motion(), kept: motion() }),
            Some(table) => {
                let slopes = table.slopes().max(table.parts.slopes());
                Method::Implicit(Solver::new(table, dt, motion), Elimination::new(nodes, slopes))
            }
        };
        let past = Past::new(scheme, |kept| if kept { motion() } else { Motion::default() });
        Integrator { past, method }
    }

    /// To be called when positions and velocities were set from outside: fills what a motion carries between
    /// steps.
    pub fn prepare(scheme: Scheme, rod: &Rod<f64>, motion: &mut Motion<f64>) {
        match scheme {
            Scheme::Verlet => prepare(rod, motion),
            Scheme::TrBdf2 | Scheme::Esdirk3 => {
                prepare(rod, motion);
                motion.a_before.copy_from_slice(&motion.a);
            }
            // What the first implicit step guesses from: no acceleration known yet.
            _ => {
                motion.a.fill(Vec2::zero());
                motion.a_before.fill(Vec2::zero());
            }
        }
    }

    /// To be called when a lane of a motion was set from outside: the step before it is forgotten.
    pub fn forget(&mut self, lane: usize, motion: &Motion<R>) {
        self.past.forget(lane, motion);
    }

    /// Takes `steps` steps under `drive` (Verlet takes its torque once, at the start). Returns where all went well; a
    /// lane that failed even in the smallest parts keeps the state before the step that failed (Verlet: before the
    /// first).
    #[inline(always)]
    pub fn advance<D: Drive<R>>(
        &mut self,
        rod: &Rod<R>,
        motion: &mut Motion<R>,
        drive: &D,
        steps: usize,
    ) -> R::Mask {
        self.advance_unless(rod, motion, drive, steps, Watch::nobody())
    }

    /// The same, ending when who watches says so.
    #[inline(always)]
    pub fn advance_unless<D: Drive<R>>(
        &mut self,
        rod: &Rod<R>,
        motion: &mut Motion<R>,
        drive: &D,
        steps: usize,
        watch: Watch<'_>,
    ) -> R::Mask {
        let Integrator { past, method } = self;
        match method {
            Method::Verlet(run) => {
                let torque = drive.torque(&motion.x, &motion.v);
                run.advance(rod, motion, torque, steps, watch)
            }
            Method::Implicit(solver, work) => {
                let mut system = Pinned { rod, motion, drive, work };
                let mut sound = R::Mask::splat(true);
                for _ in 0..steps {
                    if watch.stops() {
                        break;
                    }
                    sound = solver.step(&mut system, past, sound, watch);
                }
                sound
            }
        }
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

    /// `advance_unless` of one rod under a constant torque \[N m\], to the same bits, written down on a tape.
    pub fn record(
        &mut self,
        rod: &Rod<f64>,
        motion: &mut Motion<f64>,
        torque: f64,
        steps: usize,
        watch: Watch<'_>,
        tape: &mut Tape,
    ) -> bool {
        let Integrator { past, method } = self;
        match method {
            Method::Verlet(run) => run.record(rod, motion, torque, steps, watch, tape),
            Method::Implicit(solver, work) => {
                let drive = &Constant(torque);
                let mut system = Recorded { system: Pinned { rod, motion, drive, work }, tape };
                let mut sound = true;
                for _ in 0..steps {
                    if watch.stops() {
                        break;
                    }
                    system.tape.begin_step();
                    sound = solver.step(&mut system, past, sound, watch);
                }
                sound
            }
        }
    }

    /// Lets Newton's method go on until what remains is below this share of what it is for others. Steps become a
    /// smooth function of their state, to the last digits, which small differences of them need.
    pub fn sharpen(&mut self, share: f64) {
        if let Method::Implicit(_, work) = &mut self.method {
            work.sharpness = share;
        }
    }
}

/// Runs of Verlet steps.
#[derive(Clone, Debug)]
struct Verlet<R> {
    dt: f64,
    /// Where a run began, and where it ended in the lanes that went well.
    saved: Motion<R>,
    kept: Motion<R>,
}

impl<R: Real> Verlet<R> {
    /// Takes a run of steps, and takes it again from its start with half, a quarter, ... of the step in the lanes where
    /// it fails. (One loop, so that the step is compiled once.)
    #[inline(always)]
    fn advance(
        &mut self,
        rod: &Rod<R>,
        motion: &mut Motion<R>,
        torque: R,
        steps: usize,
        watch: Watch<'_>,
    ) -> R::Mask {
        self.saved.copy_from(motion);
        let mut left = R::Mask::splat(true);
        for halving in 0..=VERLET_HALVINGS {
            let parts = 1usize << halving;
            let dt = self.dt / parts as f64;
            let sound = verlet(rod, motion, torque, dt, steps * parts, watch, &mut ());
            if halving == 0 && sound.all() {
                return sound;
            }
            self.kept.take(left.and(sound), motion);
            left = left.and(sound.not());
            if !left.any() {
                break;
            }
            motion.copy_from(&self.saved);
        }
        motion.copy_from(&self.kept);
        motion.take(left, &self.saved);
        left.not()
    }
}

impl Verlet<f64> {
    /// `advance`, with every step written down.
    fn record(
        &mut self,
        rod: &Rod<f64>,
        motion: &mut Motion<f64>,
        torque: f64,
        steps: usize,
        watch: Watch<'_>,
        tape: &mut Tape,
    ) -> bool {
        self.saved.copy_from(motion);
        let begin = tape.moves().len();
        for halving in 0..=VERLET_HALVINGS {
            let parts = 1usize << halving;
            let dt = self.dt / parts as f64;
            let written = &mut Written { tape, dt };
            if verlet(rod, motion, torque, dt, steps * parts, watch, written) {
                return true;
            }
            tape.cut(begin);
            motion.copy_from(&self.saved);
        }
        false
    }
}

/// Verlet steps of this size \[s\], written down.
struct Written<'a> {
    tape: &'a mut Tape,
    dt: f64,
}

impl Witness<f64> for Written<'_> {
    fn forces_taken(&mut self, x: &[Vec2<f64>], v: &[Vec2<f64>]) {
        self.tape.push(Move::Verlet(self.dt), x, v.iter().copied(), &[]);
    }
}
