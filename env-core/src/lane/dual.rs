//! Numbers that carry derivatives: a value, and its slopes in eight directions side by side.
//!
//! The value goes through the operations of `f64`, so it has the bits that it has without slopes. Where a function has a
//! kink (`clip`, `min`, `abs`), the slope is that of the branch that the value takes; where it has none at all (the root
//! of zero, the angle of a zero vector), it is zero. Truth values and `set` know no slopes.

use super::Real;
use std::array::from_fn;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// Directions of one number.
pub const DIRECTIONS: usize = 8;

/// A number and its slopes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dual {
    /// Its value.
    pub value: f64,
    /// Its slope in each direction.
    pub slopes: [f64; DIRECTIONS],
}

impl Dual {
    /// A number that depends on nothing.
    pub fn constant(value: f64) -> Self {
        Dual { value, slopes: [0.0; DIRECTIONS] }
    }

    /// A number of slope 1 in one direction: what is differentiated by.
    pub fn variable(value: f64, direction: usize) -> Self {
        Dual { value, slopes: from_fn(|k| f64::from(u8::from(k == direction))) }
    }

    /// The value of a function of which the slope is known.
    #[inline(always)]
    fn chain(self, value: f64, slope: f64) -> Self {
        Dual { value, slopes: self.slopes.map(|s| s * slope) }
    }
}

impl Add for Dual {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Dual { value: self.value + o.value, slopes: from_fn(|k| self.slopes[k] + o.slopes[k]) }
    }
}
impl Sub for Dual {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Dual { value: self.value - o.value, slopes: from_fn(|k| self.slopes[k] - o.slopes[k]) }
    }
}
#[expect(clippy::suspicious_arithmetic_impl, reason = "the rule of the product")]
impl Mul for Dual {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        let slope = |k: usize| self.slopes[k] * o.value + self.value * o.slopes[k];
        Dual { value: self.value * o.value, slopes: from_fn(slope) }
    }
}
#[expect(clippy::suspicious_arithmetic_impl, reason = "the rule of the quotient")]
impl Div for Dual {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        Dual { value, slopes: from_fn(|k| (self.slopes[k] - value * o.slopes[k]) / o.value) }
    }
}
impl Neg for Dual {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}
impl AddAssign for Dual {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
impl SubAssign for Dual {
    #[inline(always)]
    fn sub_assign(&mut self, o: Self) {
        *self = *self - o;
    }
}
impl MulAssign for Dual {
    #[inline(always)]
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}

impl Real for Dual {
    type Mask = bool;
    const LANES: usize = 1;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        Dual::constant(x)
    }
    #[inline(always)]
    fn get(&self, _lane: usize) -> f64 {
        self.value
    }
    #[inline(always)]
    fn set(&mut self, _lane: usize, x: f64) {
        *self = Dual::constant(x);
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, if root > 0.0 { 0.5 / root } else { 0.0 })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.chain(self.value.abs(), if self.value < 0.0 { -1.0 } else { 1.0 })
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self.value < other.value
    }
    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    #[inline(always)]
    fn sin(self) -> Self {
        self.chain(libm::sin(self.value), libm::cos(self.value))
    }
    #[inline(always)]
    fn cos(self) -> Self {
        self.chain(libm::cos(self.value), -libm::sin(self.value))
    }
    #[inline(always)]
    fn atan(self) -> Self {
        self.chain(libm::atan(self.value), 1.0 / (1.0 + self.value * self.value))
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        let length2 = self.value * self.value + x.value * x.value;
        let inverse = if length2 > 0.0 { 1.0 / length2 } else { 0.0 };
        let slope = |k: usize| (x.value * self.slopes[k] - self.value * x.slopes[k]) * inverse;
        Dual { value: libm::atan2(self.value, x.value), slopes: from_fn(slope) }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self.value < other.value { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if other.value < self.value { self } else { other }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A function of one number, made of all that `Real` has.
    fn mixed<R: Real>(x: R) -> R {
        let y = (x * x + R::one()).sqrt() / (x - R::splat(3.0));
        let z = y.sin() * x.cos() + (-y).atan() - x.atan2(y).abs();
        z.clip(-10.0, 10.0) + x.min(R::splat(-5.0)).max(y)
    }

    #[test]
    fn slopes_are_those_of_small_differences_and_values_keep_their_bits() {
        for x in [-2.0, -0.3, 0.4, 1.7, 5.0] {
            let dual = mixed(Dual::variable(x, 3));
            assert_eq!(dual.value.to_bits(), mixed(x).to_bits());
            let h = 1e-3;
            let central = |h: f64| (mixed(x + h) - mixed(x - h)) / (2.0 * h);
            let slope = (4.0 * central(h / 2.0) - central(h)) / 3.0;
            assert!((dual.slopes[3] - slope).abs() < 1e-9, "{x}: {} {slope}", dual.slopes[3]);
            assert_eq!(dual.slopes[2], 0.0);
        }
    }

    #[test]
    fn where_there_is_no_slope_it_is_zero() {
        let zero = Dual::variable(0.0, 0);
        assert_eq!(zero.sqrt().slopes, [0.0; DIRECTIONS]);
        assert_eq!(zero.atan2(zero).slopes, [0.0; DIRECTIONS]);
        assert_eq!(Dual::variable(2.0, 0).clip(-1.0, 1.0), Dual::constant(1.0));
    }
}
