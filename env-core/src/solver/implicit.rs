//! Implicit steps of any system: Newton's method in lanes, and smaller parts where it fails.

use super::scheme::{Scheme, Stage, Table};
use crate::lane::{Lanewise, Mask, Real};
use crate::lanewise;
use crate::watch::Watch;

/// Newton iterations before a stage counts as failed.
const ITERATIONS: usize = 12;
/// How often a failing step may be halved.
const HALVINGS: usize = 9;
/// Size of the smallest parts over that of the step.
const SMALLEST: f64 = 1.0 / (1 << HALVINGS) as f64;

/// Equations of motion, as a solver sees them: `x' = v`, `M v' = F(x, v)`, or anything else whose stages can be
/// predicted and corrected. All methods stand in hot loops: they must be `#[inline(always)]`.
pub trait System<R: Real> {
    /// What a step starts from and leaves behind.
    type State: Lanewise<R, Of<R> = Self::State>;

    /// The state: before a step, while it is solved for, and after it.
    fn state(&mut self) -> &mut Self::State;
    /// Begins a stage: writes what it starts from into `origin` (by `Stage::origin` from the part's `start`, from the
    /// state, which is the last stage, and from `before`), and a guess of its end into the state.
    fn predict(
        &mut self,
        stage: &Stage<R>,
        start: &Self::State,
        before: &Self::State,
        origin: &mut Self::State,
    );
    /// One Newton iteration on the lanes of `active`. Returns the sum of all moves, which is not finite where the
    /// iteration is lost, and where the state is one that the system may have.
    fn correct(&mut self, stage: &Stage<R>, origin: &Self::State, active: R::Mask) -> (R, R::Mask);
    /// The sum of all moves below which a stage has converged.
    fn tolerance(&self) -> R;
    /// A stage has been solved: completes the state. Returns where that went well.
    #[inline(always)]
    fn complete(&mut self, _stage: &Stage<R>, _origin: &Self::State) -> R::Mask {
        R::Mask::splat(true)
    }
    /// A part of the step has been taken in some lanes.
    #[inline(always)]
    fn accept(&mut self, _part: &Part<R::Mask>) {}
}

/// A part of a step: most often the whole.
#[derive(Clone, Copy, Debug)]
pub struct Part<M> {
    /// Where it begins, as a share of the step.
    pub from: f64,
    /// Its size over that of the step.
    pub size: f64,
    /// The lanes that take it.
    pub lanes: M,
}

/// What a scheme remembers of the step before, if it looks back.
#[derive(Clone, Debug)]
pub struct Past<R, S> {
    /// The state at the start of the step before.
    pub before: S,
    /// 1 where it is known, 0 where the motion has just begun.
    pub known: R,
    looks_back: bool,
}

lanewise!(Past<S>: before, known);

impl<R: Real, S: Lanewise<R, Of<R> = S>> Past<R, S> {
    /// Of steps by a scheme; `before` is memory for a state, left empty for schemes that do not look back.
    pub fn new(scheme: Scheme, before: impl FnOnce(bool) -> S) -> Self {
        let looks_back = scheme.looks_back();
        Past { before: before(looks_back), known: R::zero(), looks_back }
    }

    /// A lane was set to `now` from outside. (`before` is kept finite although it is not read, so that snapshots of
    /// equal states are equal.)
    pub fn forget(&mut self, lane: usize, now: &S) {
        if self.looks_back {
            self.before.pair(now, &mut |to, from: &R| to.set(lane, from.get(lane)));
        }
        self.known.set(lane, 0.0);
    }
}

/// A scheme, its step and its memory for one block of systems.
#[derive(Clone, Debug)]
pub struct Solver<M, S> {
    table: &'static Table,
    dt: f64,
    /// State at the start of the step, at that of a smaller part, and what a stage starts from.
    start: S,
    part: S,
    origin: S,
    /// Parts yet to be taken, the next one last: at most one of each size but two of the smallest.
    parts: [Part<M>; HALVINGS + 1],
}

impl<M: Mask, S> Solver<M, S> {
    /// For steps of `dt` \[s\]; `state` makes memory for a state.
    pub fn new(table: &'static Table, dt: f64, state: impl Fn() -> S) -> Self {
        let parts = [Part { from: 0.0, size: 1.0, lanes: M::splat(false) }; HALVINGS + 1];
        Solver { table, dt, start: state(), part: state(), origin: state(), parts }
    }

    /// Takes one step in `lanes`, unless who watches stops it. Returns where it was taken; all other lanes keep their
    /// state.
    ///
    /// Where a part of the step fails, its two halves are taken instead, each of which may fail again. (One loop, so
    /// that a system's equations are compiled once.)
    #[inline(always)]
    pub fn step<R: Real<Mask = M>, Y: System<R, State = S>>(
        &mut self,
        system: &mut Y,
        past: &mut Past<R, S>,
        lanes: M,
        watch: Watch<'_>,
    ) -> M
    where
        S: Lanewise<R, Of<R> = S>,
    {
        let Solver { table, dt, start, part: part_start, origin, parts } = self;
        start.copy_from(system.state());
        let mut sound = lanes;
        parts[0] = Part { from: 0.0, size: 1.0, lanes };
        let mut waiting = 1;
        while waiting > 0 && !watch.stops() {
            waiting -= 1;
            let mut part = parts[waiting];
            part.lanes = part.lanes.and(sound);
            if !part.lanes.any() {
                continue;
            }
            let whole = part.size == 1.0;
            let (from, table) = if whole {
                (&*start, *table)
            } else {
                part_start.copy_from(system.state());
                (&*part_start, table.parts)
            };
            let tried = part.lanes;
            for row in table.stages {
                let stage = row.stage(&part, *dt, past.known, table.stages[0].end);
                system.predict(&stage, from, &past.before, origin);
                let solved = newton(system, &stage, origin, part.lanes);
                part.lanes = solved.and(system.complete(&stage, origin));
            }
            if !part.lanes.all() {
                system.state().take(part.lanes.not(), from);
            }
            system.accept(&part);
            let failed = tried.and(part.lanes.not());
            if failed.any() {
                if part.size > SMALLEST {
                    let half = 0.5 * part.size;
                    parts[waiting] = Part { from: part.from + half, size: half, lanes: failed };
                    parts[waiting + 1] = Part { from: part.from, size: half, lanes: failed };
                    waiting += 2;
                } else {
                    sound = sound.and(failed.not());
                }
            }
        }
        if !sound.all() {
            system.state().take(sound.not(), start);
        }
        if past.looks_back {
            past.before.take(sound, start);
            past.known = R::select(sound, R::one(), past.known);
        }
        sound
    }
}

/// Solves a stage in `lanes`; returns where that succeeded.
#[inline(always)]
fn newton<R: Real, Y: System<R>>(
    system: &mut Y,
    stage: &Stage<R>,
    origin: &Y::State,
    lanes: R::Mask,
) -> R::Mask {
    let tolerance = system.tolerance();
    let (mut active, mut solved) = (lanes, R::Mask::splat(false));
    for _ in 0..ITERATIONS {
        // A converged lane stays frozen while its neighbours iterate.
        let (moved, fits) = system.correct(stage, origin, active);
        let small = moved.lt(tolerance).and(fits).and(active);
        solved = solved.or(small);
        active = active.and(small.not()).and(moved.is_finite());
        if !active.any() {
            break;
        }
    }
    solved
}
