//! A bank of filters, each of which believes in another rod: eight of them side by side in lanes.

use super::belief::Belief;
use super::filter::{Filter, Learning, Pace, Surprise};
use super::rods::{STATE, State};
use super::{Arrival, Noise, RodDesign};
use rodgym_core::isa::{ForLanes, Isa, with_lanes};
use rodgym_core::lane::{Kernel, Mask, Real};

/// Filters in a bank.
pub const LANES: usize = 8;

/// Eight filters, whatever the number type of their lanes.
pub trait Bank: Send + Sync {
    /// Numbers of its memory.
    fn memory(&self) -> usize;
    /// All filters start with a straight rod at the measured base angle and rate.
    fn start(&self, angle: f64, rate: f64, memory: &mut [f64]);
    /// One control period.
    fn step(&self, step: &Step, memory: &mut [f64]) -> News;
    /// What a filter believes.
    fn estimate(&self, lane: usize, memory: &[f64]) -> Estimate;
    /// A filter's state when an action that is taken now begins to act, and how many numbers it has.
    /// Actions on their way act before, times the torque \[N m\] of action 1.
    fn forecast(
        &self,
        lane: usize,
        arrival: &Arrival,
        actions: &[f64],
        limit: f64,
        memory: &[f64],
    ) -> (State<f64>, usize);
}

/// What happened in a control period.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Torques that acted: in the period's first part, and in the rest \[N m\].
    pub torques: [f64; 2],
    /// Base angle \[rad\] and rate \[rad/s\] measured after it; nothing where the sample was lost.
    pub measured: Option<(f64, f64)>,
    /// Whether a period went by; not where an episode begins.
    pub moved: bool,
}

/// What the filters say of a step.
#[derive(Clone, Copy, Debug)]
pub struct News {
    /// Squared innovations over their variances: angle, rate.
    pub squares: [[f64; LANES]; 2],
    /// The variances.
    pub variances: [[f64; LANES]; 2],
    /// Filters that had to begin anew.
    pub lost: [bool; LANES],
}

impl News {
    /// Minus the logarithm of what a filter thought likely, up to a constant. A square counts `most` at most: once a
    /// filter is off, how far says nothing.
    pub fn surprise(&self, lane: usize, most: f64) -> f64 {
        if self.lost[lane] {
            return most;
        }
        let of = |which: usize| {
            self.squares[which][lane].min(most) + libm::log(self.variances[which][lane])
        };
        0.5 * (of(0) + of(1))
    }
}

/// What one filter believes.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Logarithms of stiffness over mass and of mobility, over the design's.
    pub feel: [f64; 2],
    /// Their covariance: stiffness, both, mobility.
    pub spread: [f64; 3],
}

/// Makes a bank of filters for rods.
///
/// # Errors
/// An instruction set that the environment variable `RODGYM_ISA` names and this machine has not.
pub fn bank(
    rods: &[RodDesign; LANES],
    noise: Noise,
    pace: Pace,
    learning: Learning,
) -> crate::error::Result<Box<dyn Bank>> {
    Ok(with_lanes(Isa::current()?, Make { rods, noise, pace, learning }))
}

struct Make<'a> {
    rods: &'a [RodDesign],
    noise: Noise,
    pace: Pace,
    learning: Learning,
}

impl ForLanes for Make<'_> {
    type Output = Box<dyn Bank>;
    fn make<R: Real>(self) -> Self::Output {
        assert_eq!(R::LANES, LANES, "the core's lanes");
        let filter = Filter::<R>::new(self.rods, self.noise, self.pace, self.learning);
        Box::new(Filters { filter })
    }
}

struct Filters<R> {
    filter: Filter<R>,
}

impl<R: Real> Bank for Filters<R> {
    fn memory(&self) -> usize {
        R::LANES * Belief::<R>::SIZE
    }

    fn start(&self, angle: f64, rate: f64, memory: &mut [f64]) {
        R::run(Start { filter: &self.filter, angle, rate, memory });
    }

    fn step(&self, step: &Step, memory: &mut [f64]) -> News {
        R::run(Advance { filter: &self.filter, step, memory })
    }

    fn estimate(&self, lane: usize, memory: &[f64]) -> Estimate {
        R::run(Read::<R> { lane, memory, number: std::marker::PhantomData })
    }

    fn forecast(
        &self,
        lane: usize,
        arrival: &Arrival,
        actions: &[f64],
        limit: f64,
        memory: &[f64],
    ) -> (State<f64>, usize) {
        let filter = &self.filter;
        R::run(Forecast { filter, lane, arrival, actions, limit, memory })
    }
}

struct Start<'a, R> {
    filter: &'a Filter<R>,
    angle: f64,
    rate: f64,
    memory: &'a mut [f64],
}

impl<R: Real> Kernel for Start<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.filter.start(R::splat(self.angle), R::splat(self.rate)).write(self.memory);
    }
}

struct Advance<'a, R> {
    filter: &'a Filter<R>,
    step: &'a Step,
    memory: &'a mut [f64],
}

impl<R: Real> Kernel for Advance<'_, R> {
    type Output = News;
    #[inline(always)]
    fn run(self) -> News {
        let Advance { filter, step, memory } = self;
        let mut belief = Belief::<R>::read(memory);
        if step.moved {
            let [first, rest] = step.torques;
            filter.predict([R::splat(first), R::splat(rest)], &mut belief);
        }
        let mut surprise = [Surprise { square: R::zero(), variance: R::one() }; 2];
        let (angle, rate) = step.measured.unwrap_or((0.0, 0.0));
        if step.measured.is_some() {
            surprise = filter.update(R::splat(angle), R::splat(rate), &mut belief);
        }
        let sound = filter.sound(&belief);
        if !sound.all() {
            belief.replace(sound.not(), &filter.start(R::splat(angle), R::splat(rate)));
        }
        belief.write(memory);
        let mut news =
            News { squares: [[0.0; LANES]; 2], variances: [[0.0; LANES]; 2], lost: [false; LANES] };
        for lane in 0..LANES {
            for which in 0..2 {
                news.squares[which][lane] = surprise[which].square.get(lane);
                news.variances[which][lane] = surprise[which].variance.get(lane);
            }
            news.lost[lane] = !sound.get(lane);
        }
        news
    }
}

struct Read<'a, R> {
    lane: usize,
    memory: &'a [f64],
    number: std::marker::PhantomData<R>,
}

impl<R: Real> Kernel for Read<'_, R> {
    type Output = Estimate;
    #[inline(always)]
    fn run(self) -> Estimate {
        let (feel, spread) = Belief::<R>::read(self.memory).learned(self.lane);
        Estimate { feel, spread }
    }
}

struct Forecast<'a, R> {
    filter: &'a Filter<R>,
    lane: usize,
    arrival: &'a Arrival,
    actions: &'a [f64],
    limit: f64,
    memory: &'a [f64],
}

impl<R: Real> Kernel for Forecast<'_, R> {
    type Output = (State<f64>, usize);
    #[inline(always)]
    fn run(self) -> (State<f64>, usize) {
        let Forecast { filter, lane, arrival, actions, limit, memory } = self;
        let mean = filter.forecast(&Belief::<R>::read(memory), arrival, actions, limit);
        let mut x = [0.0; STATE];
        let n = filter.rods().lane(&mean, lane, &mut x);
        (x, n)
    }
}

#[cfg(test)]
mod tests {
    //! A bank holds the same bits whatever the instruction set.

    use super::*;

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let rods: [RodDesign; LANES] = std::array::from_fn(|lane| RodDesign {
            width: 0.006 + 0.0005 * lane as f64,
            ..RodDesign::default()
        });
        let arrival = Arrival::new(1.5);
        let learning = Learning { start: [0.01, 0.04], process: [1e-7, 1e-7] };
        let play = |isa: Isa| {
            let pace = Pace::of(&rods, &arrival);
            let make = Make { rods: &rods, noise: Noise::LEARNER, pace, learning };
            let bank = with_lanes(isa, make);
            let mut memory = vec![0.0; bank.memory()];
            bank.start(0.1, 0.0, &mut memory);
            let mut bits = Vec::new();
            for step in 0..30 {
                let swing = libm::sin(0.3 * f64::from(step));
                let step = Step {
                    torques: [0.05 * swing, -0.05 * swing],
                    measured: (step % 4 != 3).then_some((0.1 + 0.2 * swing, 3.0 * swing)),
                    moved: step > 0,
                };
                let news = bank.step(&step, &mut memory);
                bits.extend((0..LANES).map(|lane| news.surprise(lane, 50.0).to_bits()));
            }
            let (x, _) = bank.forecast(3, &arrival, &[0.5, -0.2, 0.1], 0.05, &memory);
            bits.extend(memory.iter().chain(&x).map(|x| x.to_bits()));
            bits
        };
        let wanted = play(Isa::Baseline);
        for isa in Isa::available() {
            assert_eq!(play(isa), wanted, "{}", isa.name());
        }
    }
}
