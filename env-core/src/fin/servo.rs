//! The servo that pitches the fin: second order, critically damped, limited in rate.

use crate::lane::Real;

/// Natural frequency \[rad/s\].
pub const FREQUENCY: f64 = 40.0;
/// Largest rate \[rad/s\].
pub const RATE_LIMIT: f64 = 6.0;
/// The servo itself advances in ticks of at most this length \[s\], whatever the physics step, so that its
/// lag does not depend on the accuracy asked of the fin.
pub const TICK: f64 = 1e-3;

/// Angle and rate of the servo's shaft.
#[derive(Clone, Copy, Debug, Default)]
pub struct Servo<R> {
    /// Angle \[rad\].
    pub angle: R,
    /// Rate \[rad/s\].
    pub rate: R,
}

impl<R: Real> Servo<R> {
    /// Ticks in a physics step of `dt` seconds.
    pub fn ticks(dt: f64) -> usize {
        // The small reduction keeps 3 ms at three ticks whatever its rounding.
        libm::ceil(dt / TICK - 1e-6).max(1.0) as usize
    }

    /// Advances by `dt` seconds in `ticks` parts towards `command` \[rad\], by backward Euler on
    /// `angle'' = ws^2 (command - angle) - 2 ws angle'`.
    #[inline(always)]
    pub fn advance(&mut self, command: R, dt: f64, ticks: usize) {
        let tick = dt / ticks as f64;
        let gain = R::splat(tick * FREQUENCY * FREQUENCY);
        let denominator = 1.0 + 2.0 * FREQUENCY * tick + FREQUENCY * FREQUENCY * tick * tick;
        let inverse = R::splat(1.0 / denominator);
        for _ in 0..ticks {
            let rate = (self.rate + gain * (command - self.angle)) * inverse;
            self.rate = rate.clip(-RATE_LIMIT, RATE_LIMIT);
            self.angle += R::splat(tick) * self.rate;
        }
    }

    /// Calls `f` with every number, always in the same order.
    pub fn visit(&mut self, f: &mut dyn FnMut(&mut R)) {
        f(&mut self.angle);
        f(&mut self.rate);
    }
}
