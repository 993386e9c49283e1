//! What a rod did, moment by moment: all that is needed to carry derivatives along the same way, forwards or backwards.

use super::{Part, Stage, System};
use crate::lane::Mask;
use crate::vec2::Vec2;

/// How a moment was come to.
#[derive(Clone, Copy, Debug)]
pub enum Move {
    /// By a Verlet step of this size \[s\].
    Verlet(f64),
    /// By a stage of an implicit scheme.
    Stage {
        /// The stage.
        stage: Stage<f64>,
        /// Whether it is the first of a part.
        part_begins: bool,
        /// Whether it is the first of a step.
        step_begins: bool,
    },
}

/// Moments at which forces were taken, in their order. Parts of steps that failed are not among them.
#[derive(Clone, Debug)]
pub struct Tape {
    nodes: usize,
    moves: Vec<Move>,
    /// Positions and velocities, moment by moment.
    x: Vec<Vec2<f64>>,
    v: Vec<Vec2<f64>>,
    /// What else a machine keeps of each moment, as many vectors every time.
    more: Vec<Vec2<f64>>,
    /// Where the step and its part begin.
    step: usize,
    part: usize,
}

impl Tape {
    /// An empty one for rods of `nodes` nodes, with memory for so many moments.
    pub fn new(nodes: usize, moments: usize) -> Self {
        let memory = || Vec::with_capacity(moments * nodes);
        let moves = Vec::with_capacity(moments);
        Tape { nodes, moves, x: memory(), v: memory(), more: vec![], step: 0, part: 0 }
    }

    /// How the moments were come to.
    pub fn moves(&self) -> &[Move] {
        &self.moves
    }

    /// Whether its moments are stages of an implicit scheme.
    pub(super) fn implicit(&self) -> bool {
        matches!(self.moves.first(), Some(Move::Stage { .. }))
    }

    /// Positions and velocities at a moment.
    pub fn moment(&self, at: usize) -> (&[Vec2<f64>], &[Vec2<f64>]) {
        let nodes = at * self.nodes..(at + 1) * self.nodes;
        (&self.x[nodes.clone()], &self.v[nodes])
    }

    /// What else there is of a moment.
    pub fn more(&self, at: usize) -> &[Vec2<f64>] {
        let size = self.more.len() / self.moves.len();
        &self.more[at * size..(at + 1) * size]
    }

    /// Forgets all, but keeps the memory.
    pub fn clear(&mut self) {
        self.cut(0);
        self.begin_step();
    }

    /// Adds a moment.
    pub(crate) fn push(
        &mut self,
        way: Move,
        x: &[Vec2<f64>],
        v: impl Iterator<Item = Vec2<f64>>,
        more: &[&[Vec2<f64>]],
    ) {
        self.moves.push(way);
        self.x.extend_from_slice(x);
        self.v.extend(v);
        more.iter().for_each(|list| self.more.extend_from_slice(list));
    }

    /// Forgets what came after the first `count` moments.
    pub(super) fn cut(&mut self, count: usize) {
        if count < self.moves.len() {
            let more = self.more.len() / self.moves.len();
            self.moves.truncate(count);
            self.x.truncate(count * self.nodes);
            self.v.truncate(count * self.nodes);
            self.more.truncate(count * more);
        }
    }

    /// A step begins.
    pub(crate) fn begin_step(&mut self) {
        (self.step, self.part) = (self.moves.len(), self.moves.len());
    }
}

/// A system of which every stage can be written down.
pub(crate) trait Told: System<f64> {
    /// Writes down the stage that has just been completed.
    fn tell(&self, way: Move, origin: &Self::State, tape: &mut Tape);
}

/// A system of which every stage is written down.
pub(crate) struct Recorded<'a, S> {
    pub system: S,
    pub tape: &'a mut Tape,
}

impl<S: Told> System<f64> for Recorded<'_, S> {
    type State = S::State;

    #[inline(always)]
    fn state(&mut self) -> &mut S::State {
        self.system.state()
    }
    #[inline(always)]
    fn predict(
        &mut self,
        stage: &Stage<f64>,
        start: &S::State,
        before: &S::State,
        origin: &mut S::State,
    ) {
        self.system.predict(stage, start, before, origin);
    }
    #[inline(always)]
    fn correct(&mut self, stage: &Stage<f64>, origin: &S::State, active: bool) -> (f64, bool) {
        self.system.correct(stage, origin, active)
    }
    #[inline(always)]
    fn tolerance(&self) -> f64 {
        self.system.tolerance()
    }
    #[inline(always)]
    fn complete(&mut self, stage: &Stage<f64>, origin: &S::State) -> bool {
        let complete = self.system.complete(stage, origin);
        let Tape { moves, step, part, .. } = &*self.tape;
        let (part_begins, step_begins) = (moves.len() == *part, moves.len() == *step);
        let way = Move::Stage { stage: *stage, part_begins, step_begins };
        self.system.tell(way, origin, self.tape);
        complete
    }
    #[inline(always)]
    fn accept(&mut self, part: &Part<bool>) {
        if part.lanes.all() {
            self.tape.part = self.tape.moves.len();
        } else {
            self.tape.cut(self.tape.part);
        }
        self.system.accept(part);
    }
}
