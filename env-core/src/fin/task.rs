//! Rewards of the fin's tasks. Each term is bounded, and none pays for what can be taken back: thrust is
//! counted without the momentum lent to the water, power without what flows back into the servo.

use super::config::{Config, Task};
use super::parameters::WATER_DENSITY;
use super::rig::Rig;
use crate::lane::Real;

/// Thrust that earns 1 in `FinThrust` \[N\]; the thrust term lies in [-4, 4].
pub const THRUST_SCALE: f64 = 0.25;
/// Power that costs 1 in `FinThrust` \[W\]; the power term lies in [-16, 0].
pub const POWER_SCALE: f64 = 0.075;
/// Relative error of the thrust at which the tracking term of `FinEfficiency` is a half; it lies in [0, 1].
pub const TRACKING_WIDTH: f64 = 0.25;
/// Power for a newton of demanded thrust that costs a half in `FinEfficiency` \[W/N\]; the power term lies
/// in [-16, 0].
pub const POWER_PER_THRUST: f64 = 0.2;
/// Speed that earns 1 in `FinSwim` \[m/s\]; the speed term lies in [-4, 4].
pub const SPEED_SCALE: f64 = 0.1;
/// Power that costs 1 in `FinSwim` \[W\]; the power term lies in [-16, 0].
pub const SWIM_POWER_SCALE: f64 = 0.05;
/// Most that thrust or speed earns, or a step backwards costs. No fin comes near it, so that in practice the
/// terms are linear: a concave thrust or power term would pay for bursts.
const EARNING_BOUND: f64 = 4.0;
/// Most that power costs: four times the most that can be earned, so that no burst of power ever pays. (With a bound
/// of 1.5 in `FinEfficiency` a kick in one step of eight earned a tenth more than the best sinusoid at half of
/// its efficiency.)
const COST_BOUND: f64 = 16.0;
/// Standard gravity, for the cost of transport \[m/s^2\].
const GRAVITY: f64 = 9.81;
/// Work of the servo since the episode began below which no efficiency is told \[J\]: that of a fin which hardly
/// moves is drag over nothing.
const LEAST_WORK: f64 = 1e-3;
/// Slowest speed \[m/s\] and flow that ratios are taken of.
const SLOW: f64 = 1e-3;

/// Names of a task's reward terms.
pub fn terms(task: Task) -> Vec<&'static str> {
    match task {
        Task::Thrust => vec!["thrust", "power"],
        Task::Efficiency => vec!["tracking", "power"],
        Task::Swim => vec!["speed", "power"],
    }
}

/// Names of the numbers that a task reports at every step.
pub fn metrics(task: Task) -> Vec<&'static str> {
    let mut names = vec![
        "thrust",
        "mount_thrust",
        "shed_thrust",
        "torque",
        "power",
        "pitch",
        "efficiency",
        "strouhal",
        "thrust_coefficient",
    ];
    match task {
        Task::Thrust => {}
        Task::Efficiency => names.extend(["demand", "smooth_thrust"]),
        Task::Swim => names.extend(["hull_speed", "cost_of_transport"]),
    }
    names
}

/// Writes reward terms and metrics; returns the reward.
#[inline(always)]
pub fn score<R: Real>(config: &Config, rig: &Rig<R>, terms: &mut [R]) -> R {
    let mean = &rig.mean;
    let earn = |x: R, scale: f64| (x * R::splat(1.0 / scale)).clip(-EARNING_BOUND, EARNING_BOUND);
    let weighted = mean.positive_power * R::splat(config.power_weight);
    let cost = |scale: R| (weighted / scale).min(R::splat(COST_BOUND));
    match config.task {
        Task::Thrust => {
            terms[0] = earn(mean.shed_thrust, THRUST_SCALE);
            terms[1] = -cost(R::splat(POWER_SCALE));
        }
        Task::Efficiency => {
            let relative =
                (rig.smooth_thrust - rig.demand) / (R::splat(TRACKING_WIDTH) * rig.demand);
            let relative = relative.clip(-1e100, 1e100);
            terms[0] = R::one() / (R::one() + relative * relative);
            terms[1] = -cost(R::splat(2.0 * POWER_PER_THRUST) * rig.demand);
        }
        Task::Swim => {
            terms[0] = earn(rig.speed, SPEED_SCALE);
            terms[1] = -cost(R::splat(SWIM_POWER_SCALE));
        }
    }
    // What the fin moves at relative to the water.
    let flow = if config.task == Task::Swim { rig.speed } else { rig.fin.water.flow_speed };
    let slow = flow.abs().max(R::splat(SLOW));
    let geometry = &config.design.geometry;
    let area = geometry.length() * geometry.height;
    let pressure = R::splat(0.5 * WATER_DENSITY * area) * slow * slow;
    let worked = R::splat(LEAST_WORK).lt(rig.work);
    let efficiency = R::select(worked, flow * rig.impulse / rig.work, R::zero());
    let numbers = [
        mean.thrust,
        mean.mount_thrust,
        mean.shed_thrust,
        mean.torque,
        mean.power,
        rig.servo.angle,
        efficiency,
        rig.stroke.frequency * rig.stroke.width / slow,
        mean.thrust / pressure,
    ];
    terms[2..11].copy_from_slice(&numbers);
    match config.task {
        Task::Thrust => {}
        Task::Efficiency => {
            terms[11] = rig.demand;
            terms[12] = rig.smooth_thrust;
        }
        Task::Swim => {
            let mut mass = rig.fin.hull_mass;
            for &node in &rig.fin.rod.mass {
                mass += node;
            }
            terms[11] = rig.speed;
            terms[12] = mean.positive_power / (mass * R::splat(GRAVITY) * slow);
        }
    }
    terms[0] + terms[1]
}
