//! Much thrust for little power, from a fin whose stiffness must be felt.

use super::{cost, earning};
use crate::batch::Task;
use crate::fin::{Fin, Plant, Setup};
use crate::lane::{Mask, Real};

/// Thrust that earns 1 \[N\].
const THRUST_SCALE: f64 = 0.25;
/// Power that costs 1 \[W\].
const POWER_SCALE: f64 = 0.075;
/// Range of Young's modulus, about the soft fin's 2.5e5 Pa, unless a value or `randomize` is given \[Pa\]. For a fin
/// that is known beforehand the best sinusoid is nearly the best that can be done; one that must be felt is worth
/// controlling (docs/fin.md).
const STIFFNESS: (f64, f64) = (3e4, 3e6);

/// `thrust` in [-4, 4], `power` in [-16, 0].
#[derive(Clone, Copy, Debug)]
pub struct Thrust;

impl Task for Thrust {
    type Machine = Fin;
    const NAME: &'static str = "thrust";
    const MAX_EPISODE_STEPS: u32 = 200;
    const TERMS: &'static [&'static str] = &["thrust", "power"];

    fn setup(&self) -> Setup {
        Setup { stiffness: Some(STIFFNESS), ..Setup::default() }
    }

    #[inline(always)]
    fn score<R: Real>(&self, fin: &Fin, plant: &Plant<R>, terms: &mut [R]) -> R::Mask {
        terms[0] = earning(plant.mean.shed_thrust, THRUST_SCALE);
        terms[1] = -cost(fin, plant, R::splat(POWER_SCALE));
        R::Mask::splat(false)
    }
}
