//! Rewards and ends of the pendulum's tasks.

use super::config::Task;
use super::plant::Plant;
use crate::lane::Real;
use crate::vec2::Vec2;

/// Tip height (in lengths) below which a balanced rod has fallen.
pub const FALLEN: f64 = 0.5;
/// Rate at which the swing-up's rate term is full \[rad/s\].
const FULL_RATE: f64 = 20.0;
const RATE_WEIGHT: f64 = 0.05;
const EFFORT_WEIGHT: f64 = 0.02;

/// Names of the metrics that every task reports.
pub const METRICS: &[&str] = &["tip_height", "upright_error", "torque"];

/// Names of a task's reward terms.
pub fn terms(task: Task) -> Vec<&'static str> {
    match task {
        Task::SwingUp => vec!["height", "rate", "effort"],
        Task::Balance => vec!["upright", "effort"],
    }
}

/// What one sweep over the edges tells of a pendulum.
struct Sums<R> {
    /// Of the squared rates of the edges \[rad^2/s^2\].
    rates: R,
    /// Of the squared distances between tangent and up.
    off: R,
}

#[inline(always)]
fn sums<R: Real>(plant: &Plant<R>) -> Sums<R> {
    let up = Vec2::new(R::zero(), R::one());
    let mut sums = Sums { rates: R::zero(), off: R::zero() };
    for k in 0..plant.motion.x.len() - 1 {
        let (t, rate) = plant.edge(k);
        let off = t - up;
        sums.rates += rate * rate;
        sums.off += off.dot(off);
    }
    sums
}

/// Writes reward terms and metrics; returns the reward and where the task ends the episode.
///
/// Swing-up: `height` (1 + y/L)/2 in [0, 1], `rate` in [-0.05, 0], `effort` in [-0.02, 0]. Balance: `upright` 1 or
/// 0, `effort` in [-0.02, 0].
#[inline(always)]
pub fn score<R: Real>(task: Task, plant: &Plant<R>, terms: &mut [R]) -> (R, R::Mask) {
    let edges = plant.motion.x.len() - 1;
    let height = plant.tip_height();
    let sums = sums(plant);
    let effort = -(R::splat(EFFORT_WEIGHT) * plant.action * plant.action);
    let (reward, ended, used) = match task {
        Task::SwingUp => {
            let share = sums.rates / R::splat(edges as f64 * FULL_RATE * FULL_RATE);
            terms[0] = ((R::one() + height) * R::splat(0.5)).clip(0.0, 1.0);
            terms[1] = -(R::splat(RATE_WEIGHT) * share.min(R::one()));
            terms[2] = effort;
            (terms[0] + terms[1] + terms[2], R::zero().lt(R::zero()), 3)
        }
        Task::Balance => {
            let fallen = height.lt(R::splat(FALLEN));
            terms[0] = R::select(fallen, R::zero(), R::one());
            terms[1] = effort;
            (terms[0] + terms[1], fallen, 2)
        }
    };
    terms[used] = height;
    // Root mean square of the distances: near up the rms angle from it [rad]; 2 when hanging.
    terms[used + 1] = (sums.off / R::splat(edges as f64)).sqrt();
    terms[used + 2] = plant.torque;
    (reward, ended)
}
