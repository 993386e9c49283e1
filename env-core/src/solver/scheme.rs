//! Schemes of time stepping, the implicit ones as tables.

use super::Part;
use crate::lane::Real;
use crate::vec2::Vec2;

/// Which scheme advances a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    /// Velocity Verlet, explicit.
    Verlet,
    /// Backward Euler, as in the thesis (Fig. 2.4, 2.26): first order.
    BackwardEuler,
    /// SDIRK2 (Alexander 1977): two stages, second order, L-stable, stiffly accurate.
    Implicit,
    /// Second-order backward differences, started by a step of backward Euler.
    Bdf2,
}

impl Scheme {
    /// The word that users type.
    pub fn name(self) -> &'static str {
        match self {
            Scheme::Verlet => "verlet",
            Scheme::BackwardEuler => "backward_euler",
            Scheme::Implicit => "implicit",
            Scheme::Bdf2 => "bdf2",
        }
    }

    /// The stages of an implicit scheme.
    pub fn table(self) -> Option<&'static Table> {
        match self {
            Scheme::Verlet => None,
            Scheme::BackwardEuler => Some(&BACKWARD_EULER),
            Scheme::Implicit => Some(&SDIRK2),
            Scheme::Bdf2 => Some(&BDF2),
        }
    }
}

/// An implicit scheme: a step solves one stage after the other, and ends where the last one ends.
#[derive(Debug)]
pub struct Table {
    /// The stages.
    pub stages: &'static [Row],
    /// The scheme of smaller parts, where a step fails.
    pub parts: &'static Table,
    /// Whether a stage starts from the step before.
    pub looks_back: bool,
}

/// A stage: `x = x* + size dt x'(x)`.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Its size over that of the step.
    pub size: f64,
    /// Where it ends, as a share of the step.
    pub end: f64,
    /// What x* is.
    pub origin: Origin,
    /// Its distance from the last stage over the distance between the last two, for a guess by a straight line.
    pub ahead: f64,
}

/// Where a stage starts from, with weights w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Origin<R = f64> {
    /// The start of the step.
    Start,
    /// `start + w (last stage - start)`.
    Stage(R),
    /// `(1 + w) start - w before`, where `before` is the start of the step before. Where that is not known, the stage
    /// is one of backward Euler.
    Before(R),
}

/// 1 - 1/sqrt(2).
const GAMMA: f64 = 0.292_893_218_813_452_4;

static BACKWARD_EULER: Table = Table {
    stages: &[Row { size: 1.0, end: 1.0, origin: Origin::Start, ahead: 1.0 }],
    parts: &BACKWARD_EULER,
    looks_back: false,
};

static SDIRK2: Table = Table {
    stages: &[
        Row { size: GAMMA, end: GAMMA, origin: Origin::Start, ahead: GAMMA / (1.0 - GAMMA) },
        Row {
            size: GAMMA,
            end: 1.0,
            origin: Origin::Stage((1.0 - GAMMA) / GAMMA),
            ahead: (1.0 - GAMMA) / GAMMA,
        },
    ],
    parts: &SDIRK2,
    looks_back: false,
};

static BDF2: Table = Table {
    stages: &[Row {
        size: 1.0 - 1.0 / 3.0,
        end: 1.0,
        origin: Origin::Before(1.0 / 3.0),
        ahead: 1.0,
    }],
    parts: &BACKWARD_EULER,
    looks_back: true,
};

/// A stage in numbers.
#[derive(Clone, Copy, Debug)]
pub struct Stage<R> {
    /// Where it ends, as a share of the whole step.
    pub end: f64,
    /// Time from the start of the part to the end of the stage \[s\].
    pub elapsed: R,
    /// Its size h \[s\].
    pub h: R,
    /// 1/h: the derivative of velocities by positions \[1/s\].
    pub rate: R,
    /// See `Row::ahead`.
    pub ahead: R,
    /// Where it starts from.
    pub origin: Origin<R>,
}

impl Row {
    /// The stage within a part of a step of `dt` \[s\]; `known` is 1 where the step before is known, else 0.
    #[inline(always)]
    pub(super) fn stage<R: Real, M>(&self, part: &Part<M>, dt: f64, known: R) -> Stage<R> {
        let dt = dt * part.size;
        let mut size = R::splat(self.size);
        let origin = match self.origin {
            Origin::Start => Origin::Start,
            Origin::Stage(weight) => Origin::Stage(R::splat(weight)),
            Origin::Before(weight) => {
                let there = R::zero().lt(known);
                size = R::select(there, size, R::one());
                Origin::Before(R::select(there, R::splat(weight), R::zero()))
            }
        };
        let h = R::splat(dt) * size;
        Stage {
            end: part.from + part.size * self.end,
            elapsed: R::splat(dt * self.end),
            h,
            rate: R::one() / h,
            ahead: R::splat(self.ahead),
            origin,
        }
    }
}

impl<R: Real> Stage<R> {
    /// What the stage starts from at one node, for one of the state's vectors: at the start of the step, and of all
    /// nodes at the last stage and at the start of the step before.
    #[inline(always)]
    pub fn origin(
        &self,
        start: Vec2<R>,
        last: &[Vec2<R>],
        before: &[Vec2<R>],
        node: usize,
    ) -> Vec2<R> {
        match self.origin {
            Origin::Start => start,
            Origin::Stage(weight) => start + (last[node] - start).scale(weight),
            Origin::Before(weight) => start.scale(R::one() + weight) - before[node].scale(weight),
        }
    }
}
