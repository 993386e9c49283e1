//! The servo that pitches the fin, second order, critically damped, limited in rate; and the low-pass between it
//! and its command.

use crate::lane::Real;
use crate::lanewise;
use std::f64::consts::TAU;

/// Natural frequency \[rad/s\].
pub const FREQUENCY: f64 = 40.0;
/// Largest rate \[rad/s\].
pub const RATE_LIMIT: f64 = 6.0;
/// Servo and low-pass advance in ticks of at most this length \[s\], so that their lag hardly depends on the
/// physics step.
pub const TICK: f64 = 1e-3;
/// Second-order stages of the low-pass.
pub const STAGES: usize = 5;
/// Damping ratios of the stages, sin(pi (2 k + 1) / 20), the most damped first: together a Butterworth filter of
/// order ten, whose gain at f Hz is 1 / sqrt(1 + (f / cutoff)^20) in short ticks; ticks of 1 ms leave 0.63 of a
/// command at a cut-off of 3 Hz instead of 0.71. So steep because a fin's bending mode may lie just above the
/// fastest gaits (docs/fin.md).
const DAMPING: [f64; STAGES] = [
    0.987_688_340_595_137_7,
    0.891_006_524_188_367_9,
    std::f64::consts::FRAC_1_SQRT_2,
    0.453_990_499_739_546_8,
    0.156_434_465_040_230_87,
];

/// `value'' = w^2 (target - value) - 2 zeta w value'` by backward Euler, as constants of a tick.
#[derive(Clone, Copy, Debug, Default)]
struct Stage {
    /// `tick w^2`.
    gain: f64,
    /// `1 / (1 + 2 zeta w tick + w^2 tick^2)`.
    inverse: f64,
}

impl Stage {
    fn new(frequency: f64, damping: f64, tick: f64) -> Self {
        let step = frequency * tick;
        let inverse = 1.0 / (1.0 + 2.0 * damping * step + step * step);
        Stage { gain: frequency * step, inverse }
    }

    /// The rate after a tick.
    #[inline(always)]
    fn rate<R: Real>(&self, now: &Lag<R>, target: R) -> R {
        (now.rate + R::splat(self.gain) * (target - now.angle)) * R::splat(self.inverse)
    }
}

/// How servo and low-pass advance through one physics step; the same for all lanes.
#[derive(Clone, Copy, Debug)]
pub struct Ticks {
    count: usize,
    length: f64,
    /// Pitch that the servo goes to, over what its command says.
    gain: f64,
    servo: Stage,
    low_pass: Option<[Stage; STAGES]>,
}

impl Ticks {
    /// For physics steps of `dt` seconds, a low-pass at `cutoff` Hz, or none, and a servo of this gain.
    pub fn new(dt: f64, cutoff: Option<f64>, gain: f64) -> Self {
        // The small reduction keeps 3 ms at three ticks whatever its rounding.
        let count = libm::ceil(dt / TICK - 1e-6).max(1.0) as usize;
        let length = dt / count as f64;
        let low_pass = cutoff.map(|f| DAMPING.map(|damping| Stage::new(TAU * f, damping, length)));
        Ticks { count, length, gain, servo: Stage::new(FREQUENCY, 1.0, length), low_pass }
    }
}

/// Angle and rate of something that follows.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lag<R> {
    /// Angle \[rad\].
    pub angle: R,
    /// Rate \[rad/s\].
    pub rate: R,
}

/// Angle and rate of the servo's shaft, and the low-pass before it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Servo<R> {
    /// Angle \[rad\].
    pub angle: R,
    /// Rate \[rad/s\].
    pub rate: R,
    /// Stages of the low-pass; the servo is told the angle of the last. Without a low-pass all are the command.
    pub smoothed: [Lag<R>; STAGES],
}

lanewise!(Lag: angle, rate);
lanewise!(Servo: angle, rate, smoothed);

impl<R: Real> Servo<R> {
    /// Advances by one physics step towards `command` \[rad\].
    #[inline(always)]
    pub fn advance(&mut self, command: R, ticks: &Ticks) {
        let length = R::splat(ticks.length);
        if ticks.low_pass.is_none() {
            self.smoothed = [Lag { angle: command, rate: R::zero() }; STAGES];
        }
        for _ in 0..ticks.count {
            if let Some(stages) = &ticks.low_pass {
                let mut target = command;
                for (stage, now) in stages.iter().zip(&mut self.smoothed) {
                    now.rate = stage.rate(now, target);
                    now.angle += length * now.rate;
                    target = now.angle;
                }
            }
            let shaft = Lag { angle: self.angle, rate: self.rate };
            let target = self.smoothed[STAGES - 1].angle * R::splat(ticks.gain);
            let rate = ticks.servo.rate(&shaft, target);
            self.rate = rate.clip(-RATE_LIMIT, RATE_LIMIT);
            self.angle += length * self.rate;
        }
    }

    /// Puts one lane at an angle and rate, where the low-pass has long been told `command` (all in rad, s).
    pub fn place(&mut self, lane: usize, angle: f64, rate: f64, command: f64) {
        self.angle.set(lane, angle);
        self.rate.set(lane, rate);
        for stage in &mut self.smoothed {
            stage.angle.set(lane, command);
            stage.rate.set(lane, 0.0);
        }
    }
}
