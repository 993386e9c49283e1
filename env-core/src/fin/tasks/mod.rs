//! Tasks of the fin, one a file. Each term of a reward is bounded, and none pays for what can be taken back:
//! thrust is counted without the momentum lent to the water, power without what flows back into the servo.

mod efficiency;
mod swim;
mod thrust;

pub use efficiency::{DEMAND, Efficiency};
pub use swim::Swim;
pub use thrust::Thrust;

use super::{Fin, Plant};
use crate::lane::Real;

/// Most that thrust or speed earns, or a step backwards costs. No fin comes near it, so that in practice the
/// terms are linear: a concave thrust or power term would pay for bursts.
const EARNING_BOUND: f64 = 4.0;
/// Most that power costs: four times the most that can be earned, so that no burst of power ever pays. (With a bound
/// of 1.5 in `FinEfficiency` a kick in one step of eight earned a tenth more than the best sinusoid at half of
/// its efficiency.)
const COST_BOUND: f64 = 16.0;

/// What thrust or speed earns: 1 at `scale`.
#[inline(always)]
fn earning<R: Real>(x: R, scale: f64) -> R {
    (x * R::splat(1.0 / scale)).clip(-EARNING_BOUND, EARNING_BOUND)
}

/// What power costs: 1 at `scale` \[W\].
#[inline(always)]
fn cost<R: Real>(fin: &Fin, plant: &Plant<R>, scale: R) -> R {
    let weighted = plant.mean.positive_power * R::splat(fin.config().power_weight);
    (weighted / scale).min(R::splat(COST_BOUND))
}
