//! Which scheme and step keep a promise: after a free swing of 1 s from the horizontal the tip is within `CONTRACT` of
//! the rod's length from the path that smaller steps converge to, and without damping less than 1 % of the swing's
//! energy is lost in 10 s.
//!
//! **The rule.** How far a rod bends decides how its vibration counts beside its swing, and so which steps are needed:
//! that is its *sag*, `12 g rho L^3 / (E w^2)`, weight over bending stiffness. Rods of equal sag, number of nodes, damping
//! and time scale (`L/g`) need nearly the same steps. `tests/long/accuracy.py` has measured them over a grid, against
//! converged runs, and wrote for Verlet and ESDIRK3 the number of steps in 10 ms that all rods of a cell need
//! (`table.rs`: to 0.6 of the contract, by the errors of all smaller steps, too; a cell needs at least half of what its
//! neighbours do; and Verlet's step is at most 0.85 of its limit of stability). Ranges of `randomize` take the most of
//! all cells that they touch. Of both schemes the one with less work is taken. The estimate for any step is what the
//! table has, in proportion to the step for Verlet (damping makes it first order), to its square for ESDIRK3: a bound.

mod table;

use super::config::at;
use crate::solver::Scheme;
use table::{BINS, CLASSES, ESDIRK3, FIRST, LENGTHS, NEVER, Steps, VERLET};

/// Distance of the tip from the converged path after 1 s, over the rod's length, that a default step promises.
pub const CONTRACT: f64 = 1e-4;
/// Verlet's longest step, over its limit of stability about the straight rod.
const MARGIN: f64 = 0.85;
/// Time that the table counts steps in \[s\].
const UNIT: f64 = 0.01;
/// Bending damping from which on a rod counts as damped \[s\].
const DAMPED: f64 = 5e-4;
/// The gravity of the grid \[m/s^2\].
const GRAVITY: f64 = 9.81;
/// Most steps of each scheme in 10 ms that are taken for the sake of the contract.
const MOST: [f64; 2] = [1600.0, 160.0];
/// Work of a step \[ns\] of a rod of so many nodes, in lanes with AVX-512, under torques that an agent draws: the more
/// nodes, the more iterations ESDIRK3 takes then. (In free swing it needs about 60 ns a node.)
fn work(scheme: Scheme, nodes: usize) -> f64 {
    let nodes = nodes as f64;
    if scheme == Scheme::Verlet { 2.6 * (nodes - 1.0) } else { (60.0 + 4.0 * nodes) * nodes }
}

/// A scheme, its step, and what is known of its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// The scheme.
    pub scheme: Scheme,
    /// Steps of a control step.
    pub steps: usize,
    /// A bound of the tip's error after 1 s of free swing, over the rod's length.
    pub error: f64,
}

/// Numbers of steps that control steps are divided into: physics steps are round where control steps are.
fn round(steps: f64) -> usize {
    let mut unit = 1.0;
    loop {
        for part in [1.0, 1.25, 1.6, 2.0, 2.5, 4.0, 5.0, 8.0] {
            let n = part * unit;
            if n >= steps && n == n.floor() {
                return n as usize;
            }
        }
        unit *= 10.0;
    }
}

/// Steps in 10 ms that all rods within the bounds of the parameters need, for the sake of accuracy alone.
fn needed(table: &Steps, nodes: usize, bounds: &[(f64, f64)]) -> f64 {
    let class = CLASSES.iter().position(|&most| nodes <= most).unwrap_or(CLASSES.len() - 1);
    let place = |sag: f64| {
        let bin = libm::floor(2.0 * libm::log10(sag.max(1e-300))) - f64::from(FIRST);
        bin.clamp(0.0, (BINS - 1) as f64) as usize
    };
    let range = |i: usize| bounds[i];
    let sag = |side: fn((f64, f64)) -> f64, other: fn((f64, f64)) -> f64| {
        let length = side(range(at::LENGTH));
        let width = other(range(at::WIDTH));
        let weight = 12.0 * side(range(at::GRAVITY)) * side(range(at::DENSITY));
        weight * length * length * length / (other(range(at::YOUNGS_MODULUS)) * width * width)
    };
    let (least, most) = (|range: (f64, f64)| range.0, |range: (f64, f64)| range.1);
    let bins = place(sag(least, most))..=place(sag(most, least));
    // A rod under less gravity moves as a longer one does.
    let scale = |length: f64, gravity: f64| length * GRAVITY / gravity.max(1e-300);
    let short = scale(range(at::LENGTH).0, range(at::GRAVITY).1);
    let long = scale(range(at::LENGTH).1, range(at::GRAVITY).0);
    let first = LENGTHS.iter().rposition(|&length| length <= short * (1.0 + 1e-9)).unwrap_or(0);
    let last = LENGTHS.iter().position(|&length| length >= long * (1.0 - 1e-9));
    let rows = first..=last.unwrap_or(LENGTHS.len() - 1).max(first);
    let damping = range(at::BENDING_DAMPING);
    let damped = usize::from(damping.0 >= DAMPED)..=usize::from(damping.1 > 0.0);
    let mut steps = 0;
    for cells in &table[class][damped] {
        for row in &cells[rows.clone()] {
            steps = steps.max(*row[bins.clone()].iter().max().expect("at least one bin"));
        }
    }
    // Beyond the grid: shorter rods are quicker, and more nodes have quicker modes.
    f64::from(steps) * (LENGTHS[0] / short).max(1.0)
}

/// The table of a scheme that there is one for.
fn table(scheme: Scheme) -> Option<&'static Steps> {
    match scheme {
        Scheme::Verlet => Some(&VERLET),
        Scheme::Esdirk3 => Some(&ESDIRK3),
        _ => None,
    }
}

/// What the scheme's tip is off after 1 s of free swing with steps of `dt`, at most, over the rod's length; `None` for
/// schemes that no table was made for, and where nothing is known of the rod.
pub fn error(scheme: Scheme, dt: f64, nodes: usize, bounds: &[(f64, f64)]) -> Option<f64> {
    let steps = needed(table(scheme)?, nodes, bounds);
    let over = steps * dt / UNIT;
    let error = if scheme == Scheme::Verlet { over } else { over * over };
    (steps < NEVER).then_some(CONTRACT * error)
}

/// The steps of a scheme that keep the contract within the bounds, and their work; the most that are ever taken where
/// that takes more. `None` where Verlet is not stable with so many.
fn steps(
    scheme: Scheme,
    nodes: usize,
    bounds: &[(f64, f64)],
    limit: f64,
    control_dt: f64,
) -> Option<(Choice, f64)> {
    let kind = usize::from(scheme != Scheme::Verlet);
    let mut wanted = needed(table(scheme)?, nodes, bounds).min(MOST[kind]);
    if scheme == Scheme::Verlet {
        wanted = wanted.max(UNIT / (MARGIN * limit));
        if wanted > MOST[kind] {
            return None;
        }
    }
    let steps = round((wanted * control_dt / UNIT - 1e-9).max(1.0));
    let error = error(scheme, control_dt / steps as f64, nodes, bounds).unwrap_or(f64::INFINITY);
    Some((Choice { scheme, steps, error }, steps as f64 * work(scheme, nodes)))
}

/// The cheapest of the schemes that keep the contract; where none does, the one with the least error.
pub fn choose(nodes: usize, bounds: &[(f64, f64)], limit: f64, control_dt: f64) -> Choice {
    let with = |scheme| steps(scheme, nodes, bounds, limit, control_dt);
    let implicit = with(Scheme::Esdirk3).expect("it has a table");
    let Some(verlet) = with(Scheme::Verlet) else { return implicit.0 };
    let keeps = |choice: &Choice| choice.error <= CONTRACT * (1.0 + 1e-9);
    let better = match (keeps(&verlet.0), keeps(&implicit.0)) {
        (true, true) => verlet.1 <= implicit.1,
        (false, false) => verlet.0.error < implicit.0.error,
        (kept, _) => kept,
    };
    if better { verlet.0 } else { implicit.0 }
}
