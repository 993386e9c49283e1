//! What a trajectory is to make small.

use super::Model;
use crate::error::{Error, Result, parameter, shape};
use rodgym_core::batch::{Expansion, Rehearsal};

/// Squares of what a machine does wrong, after every control step: with x the positions \[m\] and velocities \[m/s\] of the
/// nodes that move, a the action, (x - target)' state (x - target) / 2 + action a^2 / 2.
#[derive(Clone, Debug, PartialEq)]
pub struct Quadratic {
    /// Where x should be.
    pub target: Vec<f64>,
    /// Weights of x, row-major, symmetric and not negative; or their diagonal alone.
    pub state: Vec<f64>,
    /// Weight of the action, above 0.
    pub action: f64,
    /// Weights that are added to `state` after the last step: of the same size.
    pub last: Vec<f64>,
}

/// What a trajectory is to make small.
#[derive(Clone, Debug, PartialEq)]
pub enum Cost {
    /// What is missing from the most that the task pays: the reward with the opposite sign.
    Own,
    /// Something else.
    Quadratic(Quadratic),
}

impl Cost {
    /// Refuses what does not fit this environment.
    ///
    /// # Errors
    /// Wrong lengths, weights that are no weights, a reward that has no curvature.
    pub fn check(&self, rehearsal: &dyn Rehearsal) -> Result<()> {
        let Cost::Quadratic(Quadratic { target, state, action, last }) = self else {
            if rehearsal.expand(0.0)?.residuals.is_empty() {
                return Err(Error::Unsuitable {
                    controller: "optimize",
                    reason: "its reward is no sum of squares: give a quadratic cost".into(),
                });
            }
            return Ok(());
        };
        let x = rehearsal.coordinates().len();
        for (name, list, sizes) in [
            ("target", target, vec![x]),
            ("state", state, vec![x, x * x]),
            ("last", last, vec![x, x * x]),
        ] {
            if !sizes.contains(&list.len()) {
                let wanted = if sizes.len() == 1 {
                    format!("({x},)")
                } else {
                    format!("({x},) or ({x}, {x})")
                };
                return Err(shape(name, format!("({},)", list.len()), wanted));
            }
            if let Some(bad) = list.iter().find(|x| !x.is_finite()) {
                return Err(parameter(name, bad, "finite numbers"));
            }
        }
        for (name, list) in [("state", state), ("last", last)] {
            let diagonal = if list.len() == x { 1 } else { x + 1 };
            if let Some(bad) = list.iter().step_by(diagonal).find(|weight| **weight < 0.0) {
                return Err(parameter(name, bad, "weights of at least 0"));
            }
            let other = |i: usize, j: usize| list.len() > x && list[i * x + j] != list[j * x + i];
            if (0..x).any(|i| (0..i).any(|j| other(i, j))) {
                return Err(parameter(name, "a matrix that is not symmetric", "symmetric"));
            }
        }
        if !(*action > 0.0 && action.is_finite()) {
            return Err(parameter("action", action, "finite and above 0"));
        }
        Ok(())
    }

    /// The loss of a step just taken that was paid `reward`; `last` of all or not.
    pub fn loss(&self, after: &dyn Rehearsal, action: f64, reward: f64, last: bool) -> f64 {
        match self {
            Cost::Own => -reward,
            Cost::Quadratic(quadratic) => {
                let x = after.coordinates();
                let pulls = quadratic.pulls(&x, last);
                let square: f64 = x
                    .iter()
                    .zip(&quadratic.target)
                    .zip(&pulls)
                    .map(|((x, to), pull)| (x - to) * pull)
                    .sum();
                0.5 * (square + quadratic.action * action * action)
            }
        }
    }

    /// Dynamics and loss of a step near an action.
    pub fn model(&self, expansion: &Expansion, action: f64, last: bool, out: &mut Model) {
        let columns = expansion.reward_slopes.len();
        let n = columns - 1;
        out.a.clear();
        out.b.clear();
        for row in expansion.next.chunks_exact(columns) {
            out.a.extend_from_slice(&row[..n]);
            out.b.push(row[n]);
        }
        // Slopes and curvatures by state and action together.
        let mut slopes = vec![0.0; columns];
        let mut curvature = vec![0.0; columns * columns];
        match self {
            Cost::Own => {
                slopes.iter_mut().zip(&expansion.reward_slopes).for_each(|(to, r)| *to = -r);
                for row in expansion.residuals.chunks_exact(columns) {
                    square(row, row, &mut curvature);
                }
            }
            Cost::Quadratic(quadratic) => {
                let rows = || expansion.coordinates_slopes.chunks_exact(columns);
                let pulls = quadratic.pulls(&expansion.coordinates, last);
                for (row, pull) in rows().zip(pulls) {
                    slopes.iter_mut().zip(row).for_each(|(to, slope)| *to += pull * slope);
                }
                let x = quadratic.target.len();
                for (i, row) in rows().enumerate() {
                    let mut weighted = vec![0.0; columns];
                    for (j, other) in rows().enumerate() {
                        let weight = quadratic.weight(i, j, x, last);
                        if weight != 0.0 {
                            weighted.iter_mut().zip(other).for_each(|(to, o)| *to += weight * o);
                        }
                    }
                    square(row, &weighted, &mut curvature);
                }
                slopes[n] += quadratic.action * action;
                curvature[n * columns + n] += quadratic.action;
            }
        }
        out.r = slopes[n];
        out.rr = curvature[n * columns + n];
        slopes.truncate(n);
        out.q = slopes;
        out.s.clear();
        out.s.extend_from_slice(&curvature[n * columns..n * columns + n]);
        out.qq.clear();
        // (The lower half is all that there is.)
        for i in 0..n {
            for j in 0..n {
                out.qq.push(curvature[i.max(j) * columns + i.min(j)]);
            }
        }
    }
}

impl Quadratic {
    fn weight(&self, i: usize, j: usize, x: usize, last: bool) -> f64 {
        let of = |list: &[f64]| match (list.len() == x, i == j) {
            (true, true) => list[i],
            (true, false) => 0.0,
            (false, _) => list[i * x + j],
        };
        of(&self.state) + if last { of(&self.last) } else { 0.0 }
    }

    /// Weights times distances from the target.
    fn pulls(&self, x: &[f64], last: bool) -> Vec<f64> {
        let off: Vec<f64> = x.iter().zip(&self.target).map(|(x, to)| x - to).collect();
        let row = |i: usize| (0..x.len()).map(|j| self.weight(i, j, x.len(), last) * off[j]).sum();
        (0..x.len()).map(row).collect()
    }
}

/// Adds the lower half of a b'.
#[inline(always)]
fn square(a: &[f64], b: &[f64], out: &mut [f64]) {
    let n = a.len();
    for i in 0..n {
        for (to, b) in out[i * n..i * n + i + 1].iter_mut().zip(b) {
            *to += a[i] * b;
        }
    }
}
