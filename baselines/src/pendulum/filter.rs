//! An extended Kalman filter on the reduced chain, from base angle and rate alone: several rods side by side.
//!
//! A filter may learn its rod: then the logarithms of stiffness and mobility are two more states.

use super::belief::{Belief, HALF, half};
use super::rods::{Feel, ORDER, Rods, STATE, Slope, State, round};
use super::{Arrival, Chain, Noise, RodDesign};
use rodgym_core::lane::{Mask, Real};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Longest step of the filter's Runge-Kutta method, in units of 1/(highest frequency).
const RUNGE_KUTTA_STEP: f64 = 1.5;
/// Longest step in any case \[s\].
const LONGEST_STEP: f64 = 2e-3;
/// Time over which the transition's series is summed, in units of 1/(highest frequency).
const SERIES: f64 = 0.5;
/// Rate that no rod of ours reaches \[rad/s\].
const FASTEST: f64 = 1e3;

/// A filter's surprise at a measured number.
#[derive(Clone, Copy, Debug)]
pub struct Surprise<R> {
    /// Square of the innovation over its variance.
    pub square: R,
    /// The variance.
    pub variance: R,
}

/// How a filter that learns its rod begins and forgets; all zero: it never learns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Learning {
    /// Variance of the logarithms of stiffness and mobility at the start.
    pub start: [f64; 2],
    /// Variance added to them at each step.
    pub process: [f64; 2],
}

/// How a filter divides its control period.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pace {
    /// Parts of the period with one torque each, in the order of time: length \[s\] and Runge-Kutta steps.
    parts: [(f64, usize); 2],
    /// How often the time of the transition's series is doubled.
    halvings: u32,
}

impl Pace {
    /// For rods whose motor is late. (Bending makes the fast modes; they are about the same in every pose.)
    pub fn of(rods: &[RodDesign], arrival: &Arrival) -> Self {
        let fastest = rods.iter().map(fastest).fold(0.0, f64::max);
        let dt = rods[0].control_dt;
        let longest = LONGEST_STEP.min(RUNGE_KUTTA_STEP / fastest);
        let part = |time: f64| (time, libm::ceil(time / longest - 1e-9) as usize);
        let late = arrival.late() * dt;
        Pace {
            parts: [part(late), part(dt - late)],
            halvings: libm::ceil(libm::log2(dt * fastest / SERIES)).max(1.0) as u32,
        }
    }
}

/// The filters of several rods.
#[derive(Clone, Debug)]
pub struct Filter<R> {
    rods: Rods<R>,
    noise: Noise,
    learning: Learning,
    learns: bool,
    dt: f64,
    pace: Pace,
}

impl<R: Real> Filter<R> {
    /// Filters for rods, one a lane, called every control period.
    ///
    /// # Panics
    /// No rods, or rods whose numbers of nodes differ.
    pub fn new(rods: &[RodDesign], noise: Noise, pace: Pace, learning: Learning) -> Self {
        Filter {
            rods: Rods::new(rods),
            noise,
            learns: learning != Learning::default(),
            learning,
            dt: rods[0].control_dt,
            pace,
        }
    }

    /// The models.
    pub fn rods(&self) -> &Rods<R> {
        &self.rods
    }

    /// Straight rods at the measured base angle and rate.
    #[inline(always)]
    pub fn start(&self, angle: R, rate: R) -> Belief<R> {
        let mut belief = Belief {
            mean: [R::zero(); STATE],
            feel: [R::zero(); 2],
            covariance: [R::zero(); HALF],
            cross: [R::zero(); 2 * STATE],
            spread: [R::splat(self.learning.start[0]), R::zero(), R::splat(self.learning.start[1])],
        };
        belief.mean[..ORDER].copy_from_slice(&self.rods.straight(angle));
        belief.mean[ORDER..].copy_from_slice(&self.rods.straight(rate));
        for i in 0..STATE {
            belief.covariance[half(i, i)] = R::splat(self.noise.start);
        }
        belief
    }

    /// Where the estimate is one of a rod, and the filter sure of something.
    #[inline(always)]
    pub fn sound(&self, belief: &Belief<R>) -> R::Mask {
        let mut sound = self.credible(&belief.mean);
        for i in 0..STATE {
            // (Variances of a filter that has gone wrong are the first to be none.)
            sound = sound.and(belief.covariance[half(i, i)].is_finite());
        }
        sound
    }

    /// Where a state is one of a rod: finite, and no coordinate faster than any real one.
    #[inline(always)]
    fn credible(&self, mean: &State<R>) -> R::Mask {
        let mut credible = R::Mask::splat(true);
        for (i, x) in mean.iter().enumerate() {
            let bound = if i < ORDER { f64::INFINITY } else { FASTEST };
            credible = credible.and(x.abs().lt(R::splat(bound)));
        }
        credible
    }

    /// How the believed rods differ from their designs.
    #[inline(always)]
    pub fn feel(&self, belief: &Belief<R>) -> Feel<R> {
        if !self.learns {
            return Feel::one();
        }
        let exp = |x: R| R::from_fn(|lane| libm::exp(x.get(lane).clamp(-2.0, 2.0)));
        Feel { stiffness: exp(belief.feel[0]), mobility: exp(belief.feel[1]) }
    }

    /// The states when an action that is taken now begins to act: what is on its way acts before, times the
    /// torque \[N m\] of action 1. Where that is no state of a rod (a belief in a wrong rod may be flung off on the way),
    /// the state that is believed now.
    #[inline(always)]
    pub fn forecast(
        &self,
        belief: &Belief<R>,
        arrival: &Arrival,
        actions: &[f64],
        limit: f64,
    ) -> State<R> {
        let mut mean = belief.mean;
        let feel = self.feel(belief);
        // (One loop, so that the steps are compiled once.)
        for part in 0..2 * arrival.whole() + 1 {
            let torque = R::splat(arrival.coming(part, actions) * limit);
            let (time, steps) = self.pace.parts[part % 2];
            for _ in 0..steps {
                self.rods.step(&mut mean, torque, &feel, time / steps as f64);
            }
        }
        let credible = self.credible(&mean);
        for (x, now) in mean.iter_mut().zip(&belief.mean) {
            *x = R::select(credible, *x, *now);
        }
        mean
    }

    /// One control period under the torques \[N m\] that arrive in it.
    #[inline(always)]
    pub fn predict(&self, torques: [R; 2], belief: &mut Belief<R>) {
        let feel = self.feel(belief);
        // One linearization serves all of the period: where the measurement has just been. Later ones, nearer to the
        // middle, know the model's path better and the rod's less: of soft rods they lose many.
        let slope = self.rods.slope(&belief.mean, torques[1], &feel);
        for part in 0..2 {
            let (time, steps) = self.pace.parts[part];
            for _ in 0..steps {
                self.rods.step(&mut belief.mean, torques[part], &feel, time / steps as f64);
            }
        }
        self.spread(&slope, belief);
    }

    /// The covariances after a control period.
    #[inline(always)]
    fn spread(&self, slope: &Slope<R>, belief: &mut Belief<R>) {
        let (middle, phi) = self.transition(slope);
        let p = &mut belief.covariance;
        // Phi P, then the lower half of (Phi P) Phi'.
        let mut product = [[R::zero(); STATE]; STATE];
        for i in 0..STATE {
            for j in 0..STATE {
                let mut sum = R::zero();
                for k in 0..STATE {
                    sum += phi[i][k] * p[half(k, j)];
                }
                product[i][j] = sum;
            }
        }
        for i in 0..STATE {
            for j in 0..=i {
                let mut sum = R::zero();
                for k in 0..STATE {
                    sum += product[i][k] * phi[j][k];
                }
                p[half(i, j)] = sum;
            }
            p[half(i, i)] +=
                R::splat(if i < ORDER { self.noise.process } else { self.noise.process_rate });
        }
        if !self.learns {
            return;
        }
        // What a change of the feel does to the state in a period, by Simpson's rule.
        let mut reach = [[R::zero(); 2]; STATE];
        for (which, push) in [&slope.stiffness, &slope.mobility].into_iter().enumerate() {
            for i in 0..STATE {
                let mut sum = if i < ORDER { R::zero() } else { push[i - ORDER] };
                for j in 0..ORDER {
                    sum += (R::splat(4.0) * middle[i][ORDER + j] + phi[i][ORDER + j]) * push[j];
                }
                reach[i][which] = sum * R::splat(self.dt / 6.0);
            }
        }
        let mut carried = [[R::zero(); 2]; STATE];
        for i in 0..STATE {
            for which in 0..2 {
                for k in 0..STATE {
                    carried[i][which] += phi[i][k] * belief.cross[2 * k + which];
                }
            }
        }
        let [a, b, c] = belief.spread;
        for i in 0..STATE {
            let own = [reach[i][0] * a + reach[i][1] * b, reach[i][0] * b + reach[i][1] * c];
            for j in 0..=i {
                let mut sum = R::zero();
                for which in 0..2 {
                    sum += (carried[i][which] + own[which]) * reach[j][which];
                    sum += reach[i][which] * carried[j][which];
                }
                p[half(i, j)] += sum;
            }
            for which in 0..2 {
                belief.cross[2 * i + which] = carried[i][which] + own[which];
            }
        }
        belief.spread[0] += R::splat(self.learning.process[0]);
        belief.spread[2] += R::splat(self.learning.process[1]);
    }

    /// exp(A t) for half of the period and for all of it, by a Taylor series of a fraction, squared back.
    #[inline(always)]
    pub(super) fn transition(&self, slope: &Slope<R>) -> ([State<R>; STATE], [State<R>; STATE]) {
        let mut fraction = self.dt;
        for _ in 0..self.pace.halvings {
            fraction *= 0.5;
        }
        let mut phi = identity();
        for order in (1..=6).rev() {
            // I + A phi t / order, where A phi has the rates of phi above and what pushes them below.
            let scale = R::splat(fraction / order as f64);
            let mut next = identity();
            for j in 0..STATE {
                let mut column = [R::zero(); STATE];
                for i in 0..STATE {
                    column[i] = phi[i][j];
                }
                for i in 0..ORDER {
                    next[i][j] += scale * column[ORDER + i];
                    let mut sum = R::zero();
                    for k in 0..ORDER {
                        sum += slope.angle[i][k] * column[k] + slope.rate[i][k] * column[ORDER + k];
                    }
                    next[ORDER + i][j] += scale * sum;
                }
            }
            phi = next;
        }
        let mut middle = phi;
        for _ in 0..self.pace.halvings {
            middle = phi;
            phi = square(&phi);
        }
        (middle, phi)
    }

    /// Takes in a measured base angle (modulo whole turns) and rate, and says how surprising they were.
    #[inline(always)]
    pub fn update(&self, angle: R, rate: R, belief: &mut Belief<R>) -> [Surprise<R>; 2] {
        let mut row = [R::zero(); ORDER];
        for j in 0..ORDER {
            row[j] = R::splat(self.rods.base()[j]);
        }
        let noise = [self.noise.angle, self.noise.rate];
        let mut surprise = [Surprise { square: R::zero(), variance: R::one() }; 2];
        // Independent sensors may be taken in one after the other, which needs no matrix inverse.
        for which in 0..2 {
            let offset = which * ORDER;
            let mut expected = R::zero();
            for j in 0..ORDER {
                expected += row[j] * belief.mean[offset + j];
            }
            let innovation = if which == 0 { wrap(angle - expected) } else { rate - expected };
            let mut pr = [R::zero(); STATE];
            for i in 0..STATE {
                for j in 0..ORDER {
                    pr[i] += belief.covariance[half(i, offset + j)] * row[j];
                }
            }
            let mut variance = R::splat(noise[which] * noise[which]);
            for j in 0..ORDER {
                variance += row[j] * pr[offset + j];
            }
            let inverse = R::one() / variance;
            let gain = innovation * inverse;
            if self.learns {
                let mut felt = [R::zero(); 2];
                for f in 0..2 {
                    for j in 0..ORDER {
                        felt[f] += row[j] * belief.cross[2 * (offset + j) + f];
                    }
                    belief.feel[f] += felt[f] * gain;
                }
                for i in 0..STATE {
                    for f in 0..2 {
                        belief.cross[2 * i + f] += -(pr[i] * inverse * felt[f]);
                    }
                }
                belief.spread[0] += -(felt[0] * felt[0] * inverse);
                belief.spread[1] += -(felt[0] * felt[1] * inverse);
                belief.spread[2] += -(felt[1] * felt[1] * inverse);
            }
            for i in 0..STATE {
                belief.mean[i] += pr[i] * gain;
                let scaled = pr[i] * inverse;
                for j in 0..=i {
                    belief.covariance[half(i, j)] += -(scaled * pr[j]);
                }
            }
            surprise[which] = Surprise { square: innovation * gain, variance };
        }
        surprise
    }
}

/// Highest frequency of a rod's model about up \[rad/s\].
pub(super) fn fastest(rod: &RodDesign) -> f64 {
    let chain = Chain::new(rod, ORDER);
    let mut up = chain.straight(PI);
    up.resize(2 * chain.coordinates(), 0.0);
    crate::linalg::spectral_radius(&chain.linearize(&up, 0.0).0)
}

/// The angle brought into [-pi, pi].
#[inline(always)]
fn wrap<R: Real>(angle: R) -> R {
    angle - R::splat(2.0 * PI) * round(angle * R::splat(0.5 / PI))
}

#[inline(always)]
fn identity<R: Real>() -> [State<R>; STATE] {
    let mut matrix = [[R::zero(); STATE]; STATE];
    for i in 0..STATE {
        matrix[i][i] = R::one();
    }
    matrix
}

#[inline(always)]
fn square<R: Real>(m: &[State<R>; STATE]) -> [State<R>; STATE] {
    let mut out = [[R::zero(); STATE]; STATE];
    for i in 0..STATE {
        for j in 0..STATE {
            let mut sum = R::zero();
            for k in 0..STATE {
                sum += m[i][k] * m[k][j];
            }
            out[i][j] = sum;
        }
    }
    out
}
