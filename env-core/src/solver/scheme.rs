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
    /// TR-BDF2 (Bank 1985): half a step of the trapezoidal rule, then one of backward differences. Second order,
    /// L-stable, and of second order for the stiff parts too.
    TrBdf2,
    /// ESDIRK3(2)4L\[2\]SA (Kennedy and Carpenter 2016): an explicit and three implicit stages, third order, L-stable,
    /// stages of second order.
    Esdirk3,
}

impl Scheme {
    /// The word that users type.
    pub fn name(self) -> &'static str {
        match self {
            Scheme::Verlet => "verlet",
            Scheme::BackwardEuler => "backward_euler",
            Scheme::Implicit => "implicit",
            Scheme::Bdf2 => "bdf2",
            Scheme::TrBdf2 => "tr_bdf2",
            Scheme::Esdirk3 => "esdirk3",
        }
    }

    /// Whether a step goes on from the acceleration at the end of the one before.
    pub fn carries_acceleration(self) -> bool {
        self.table().is_none_or(|table| table.slopes() > 0)
    }

    /// Whether a step starts from the one before it.
    pub fn looks_back(self) -> bool {
        self.table().is_some_and(|table| table.looks_back)
    }

    /// The stages of an implicit scheme.
    pub fn table(self) -> Option<&'static Table> {
        match self {
            Scheme::Verlet => None,
            Scheme::BackwardEuler => Some(&BACKWARD_EULER),
            Scheme::Implicit => Some(&SDIRK2),
            Scheme::Bdf2 => Some(&BDF2),
            Scheme::TrBdf2 => Some(&TR_BDF2),
            Scheme::Esdirk3 => Some(&ESDIRK3),
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
    /// `start + dt sum_j from_j z'_j` with the slopes z' at the start of the step and at the stages so far. The
    /// acceleration is guessed as `sum_j guess_j` times theirs.
    Slopes {
        /// Weights of the slopes.
        from: &'static [f64],
        /// Weights of a polynomial through the accelerations (sum 1); of a single one, the guess is a straight line
        /// through it and the stage before the step.
        guess: &'static [f64],
    },
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

/// 2 - sqrt(2): where the trapezoidal rule of TR-BDF2 ends.
const TR: f64 = 2.0 - std::f64::consts::SQRT_2;

static TR_BDF2: Table = Table {
    stages: &[
        Row {
            size: GAMMA,
            end: TR,
            origin: Origin::Slopes { from: &[GAMMA], guess: &[1.0] },
            ahead: TR / (1.0 - TR),
        },
        Row {
            size: GAMMA,
            end: 1.0,
            origin: Origin::Slopes {
                from: &[0.5 * (1.0 - GAMMA), 0.5 * (1.0 - GAMMA)],
                guess: &[1.0 - 1.0 / TR, 1.0 / TR],
            },
            ahead: 0.0,
        },
    ],
    parts: &TR_BDF2,
    looks_back: false,
};

/// The root of `g^3 - 3 g^2 + 3 g/2 - 1/6` that makes an L-stable scheme.
const ETA: f64 = 0.435_866_521_508_459;
/// Where the stages of ESDIRK3 end; the third is chosen.
const ENDS: [f64; 3] = [2.0 * ETA, 0.6, 1.0];
/// From conditions of second order of the third stage and of third order of the last.
const THIRD: f64 = ENDS[1] * (ENDS[1] - ENDS[0]) / (4.0 * ETA);
const LAST: [f64; 2] = [
    (-2.0 + 3.0 * ENDS[1] + 6.0 * ETA * (1.0 - ENDS[1])) / (12.0 * ETA * (ENDS[1] - ENDS[0])),
    (1.0 - 6.0 * ETA + 6.0 * ETA * ETA) / (3.0 * ENDS[1] * (ENDS[1] - ENDS[0])),
];

static ESDIRK3: Table = Table {
    stages: &[
        Row {
            size: ETA,
            end: ENDS[0],
            origin: Origin::Slopes { from: &[ETA], guess: &[1.0] },
            ahead: ENDS[0] / (1.0 - ENDS[1]),
        },
        Row {
            size: ETA,
            end: ENDS[1],
            origin: Origin::Slopes {
                from: &[ENDS[1] - THIRD - ETA, THIRD],
                guess: &[1.0 - ENDS[1] / ENDS[0], ENDS[1] / ENDS[0]],
            },
            ahead: 0.0,
        },
        Row {
            size: ETA,
            end: 1.0,
            origin: Origin::Slopes {
                from: &[1.0 - LAST[0] - LAST[1] - ETA, LAST[0], LAST[1]],
                // The parabola through 0, ENDS[0] and ENDS[1], at 1.
                guess: &[
                    (1.0 - ENDS[0]) * (1.0 - ENDS[1]) / (ENDS[0] * ENDS[1]),
                    (1.0 - ENDS[1]) / (ENDS[0] * (ENDS[0] - ENDS[1])),
                    (1.0 - ENDS[0]) / (ENDS[1] * (ENDS[1] - ENDS[0])),
                ],
            },
            ahead: 0.0,
        },
    ],
    parts: &TR_BDF2,
    looks_back: false,
};

impl Table {
    /// How many slopes a step must keep.
    pub fn slopes(&self) -> usize {
        let kept = |row: &Row| match row.origin {
            Origin::Slopes { from, .. } => from.len(),
            _ => 0,
        };
        self.stages.iter().map(kept).max().unwrap_or(0)
    }
}

/// A stage in numbers.
#[derive(Clone, Copy, Debug)]
pub struct Stage<R> {
    /// Where it ends, as a share of the whole step.
    pub end: f64,
    /// Time from the start of the part to the end of the stage \[s\].
    pub elapsed: R,
    /// Its size h \[s\].
    pub h: R,
    /// Size of the part \[s\].
    pub dt: R,
    /// Whether the part ends here.
    pub last: bool,
    /// Where the stage ends, and where the first one does, as shares of the part.
    pub end_of_part: f64,
    /// See `end_of_part`.
    pub first_end: f64,
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
    pub(super) fn stage<R: Real, M>(
        &self,
        part: &Part<M>,
        dt: f64,
        known: R,
        first_end: f64,
    ) -> Stage<R> {
        let dt = dt * part.size;
        let mut size = R::splat(self.size);
        let mut origin = self.origin.splat();
        if let Origin::Before(weight) = &mut origin {
            let there = R::zero().lt(known);
            size = R::select(there, size, R::one());
            *weight = R::select(there, *weight, R::zero());
        }
        let h = R::splat(dt) * size;
        Stage {
            end: part.from + part.size * self.end,
            elapsed: R::splat(dt * self.end),
            h,
            dt: R::splat(dt),
            last: self.end == 1.0,
            end_of_part: self.end,
            first_end,
            rate: R::one() / h,
            ahead: R::splat(self.ahead),
            origin,
        }
    }
}

impl Origin {
    /// The same in every lane.
    #[inline(always)]
    pub fn splat<R: Real>(self) -> Origin<R> {
        match self {
            Origin::Start => Origin::Start,
            Origin::Stage(weight) => Origin::Stage(R::splat(weight)),
            Origin::Before(weight) => Origin::Before(R::splat(weight)),
            Origin::Slopes { from, guess } => Origin::Slopes { from, guess },
        }
    }
}

impl<R: Real> Origin<R> {
    /// What the stage starts from at one node, for one of the state's vectors: at the start of the step, and of all
    /// nodes at the last stage and at the start of the step before.
    #[inline(always)]
    pub fn of(&self, start: Vec2<R>, last: &[Vec2<R>], before: &[Vec2<R>], node: usize) -> Vec2<R> {
        match *self {
            // (Of slopes the system itself keeps account.)
            Origin::Start | Origin::Slopes { .. } => start,
            Origin::Stage(weight) => start + (last[node] - start).scale(weight),
            Origin::Before(weight) => start.scale(R::one() + weight) - before[node].scale(weight),
        }
    }
}
