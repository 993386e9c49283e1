//! The number type of the physics: one environment (`f64`) or `W` side by side (`Lanes<W>`; on x86-64 with AVX2 or
//! AVX-512 types of the processor's own registers, see `isa::with_lanes`).
//!
//! Every operation here is an IEEE operation on each lane by itself (add, subtract, multiply, divide,
//! square root, compare, select; sine and arctangent by software), so lane 5 of 8 holds the same bits as that
//! environment computed alone. Nothing fuses or reorders; the loops of `Lanes` are plain so that the compiler can turn
//! each into a few vector instructions.

/// The functions of `Real` for which there is no instruction.
macro_rules! lane_by_lane {
    () => {
        #[inline(always)]
        fn sin(self) -> Self {
            Self::from_fn(|lane| libm::sin(self.get(lane)))
        }
        #[inline(always)]
        fn cos(self) -> Self {
            Self::from_fn(|lane| libm::cos(self.get(lane)))
        }
        #[inline(always)]
        fn atan(self) -> Self {
            Self::from_fn(|lane| libm::atan(self.get(lane)))
        }
        #[inline(always)]
        fn atan2(self, x: Self) -> Self {
            Self::from_fn(|lane| libm::atan2(self.get(lane), x.get(lane)))
        }
    };
}

mod dual;
mod lanewise;
#[cfg(target_arch = "x86_64")]
pub(crate) mod x86;
mod zero;

pub use dual::{DIRECTIONS, Dual};
pub use lanewise::Lanewise;
pub use zero::Zero;

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// A number, or several numbers side by side, that the physics computes with.
pub trait Real:
    Copy
    + Default
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
{
    /// One truth value a lane.
    type Mask: Mask;
    /// How many environments stand side by side.
    const LANES: usize;

    /// The same value in every lane.
    fn splat(x: f64) -> Self;
    /// The value in `lane`; panics beyond `LANES`.
    fn get(&self, lane: usize) -> f64;
    /// Replaces the value in `lane`; panics beyond `LANES`.
    fn set(&mut self, lane: usize, x: f64);
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Lane-wise `self < other`; false where either is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `yes` where the mask is set, `no` elsewhere.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Sine, the same on every machine.
    fn sin(self) -> Self;
    /// Cosine, the same on every machine.
    fn cos(self) -> Self;
    /// Arctangent, the same on every machine.
    fn atan(self) -> Self;
    /// Angle of the vector (x, self), in [-pi, pi], the same on every machine.
    fn atan2(self, x: Self) -> Self;

    /// Runs work in numbers of this type with the instructions that the type is made of.
    #[inline]
    fn run<K: Kernel>(kernel: K) -> K::Output {
        kernel.run()
    }

    /// Zero in every lane.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }
    /// One in every lane.
    #[inline(always)]
    fn one() -> Self {
        Self::splat(1.0)
    }
    /// The smaller value; `other` where either is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger value; `other` where either is NaN.
    fn max(self, other: Self) -> Self;
    /// Limits to `[low, high]`; a NaN becomes `low`.
    #[inline(always)]
    fn clip(self, low: f64, high: f64) -> Self {
        self.max(Self::splat(low)).min(Self::splat(high))
    }
    /// Set where the value is neither NaN nor infinite.
    #[inline(always)]
    fn is_finite(self) -> Self::Mask {
        self.abs().lt(Self::splat(f64::INFINITY))
    }
    /// Builds a value from a function of the lane number.
    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
        let mut out = Self::zero();
        for lane in 0..Self::LANES {
            out.set(lane, f(lane));
        }
        out
    }
}

/// Work to be compiled for the instructions of its number type: see `Real::run`. Its `run`, and everything below, must be
/// `#[inline(always)]`, so that it takes on the features of the function that it is inlined into.
pub trait Kernel {
    /// What the work returns.
    type Output;
    /// Does the work.
    fn run(self) -> Self::Output;
}

/// One truth value a lane.
pub trait Mask: Copy + Debug + Send + Sync + 'static {
    /// The same value in every lane.
    fn splat(b: bool) -> Self;
    /// The value in `lane`.
    fn get(self, lane: usize) -> bool;
    /// Replaces the value in `lane`.
    fn set(&mut self, lane: usize, b: bool);
    /// True when set in every lane.
    fn all(self) -> bool;
    /// True when set in any lane.
    fn any(self) -> bool;
    /// Both.
    fn and(self, other: Self) -> Self;
    /// Either.
    fn or(self, other: Self) -> Self;
    /// The opposite.
    fn not(self) -> Self;
}

impl Mask for bool {
    #[inline(always)]
    fn splat(b: bool) -> Self {
        b
    }
    #[inline(always)]
    fn get(self, _lane: usize) -> bool {
        self
    }
    #[inline(always)]
    fn set(&mut self, _lane: usize, b: bool) {
        *self = b;
    }
    #[inline(always)]
    fn all(self) -> bool {
        self
    }
    #[inline(always)]
    fn any(self) -> bool {
        self
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self & other
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        self | other
    }
    #[inline(always)]
    fn not(self) -> Self {
        !self
    }
}

impl Real for f64 {
    type Mask = bool;
    const LANES: usize = 1;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn get(&self, _lane: usize) -> f64 {
        *self
    }
    #[inline(always)]
    fn set(&mut self, _lane: usize, x: f64) {
        *self = x;
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    lane_by_lane!();
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if other < self { self } else { other }
    }
}

/// `W` numbers side by side, aligned to a cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct Lanes<const W: usize>(pub [f64; W]);

/// `W` truth values as all-ones or all-zeros words: that form turns into vector masks.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct LaneMask<const W: usize>([u64; W]);

impl<const W: usize> Default for Lanes<W> {
    #[inline(always)]
    fn default() -> Self {
        Lanes([0.0; W])
    }
}

macro_rules! lane_operator {
    ($op:ident, $name:ident, $assign:ident, $assign_name:ident) => {
        impl<const W: usize> $op for Lanes<W> {
            type Output = Self;
            #[inline(always)]
            fn $name(mut self, other: Self) -> Self {
                for i in 0..W {
                    self.0[i] = self.0[i].$name(other.0[i]);
                }
                self
            }
        }
        impl<const W: usize> $assign for Lanes<W> {
            #[inline(always)]
            fn $assign_name(&mut self, other: Self) {
                *self = (*self).$name(other);
            }
        }
    };
}
lane_operator!(Add, add, AddAssign, add_assign);
lane_operator!(Sub, sub, SubAssign, sub_assign);
lane_operator!(Mul, mul, MulAssign, mul_assign);

impl<const W: usize> Div for Lanes<W> {
    type Output = Self;
    #[inline(always)]
    fn div(mut self, other: Self) -> Self {
        for i in 0..W {
            self.0[i] /= other.0[i];
        }
        self
    }
}

impl<const W: usize> Neg for Lanes<W> {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        for i in 0..W {
            self.0[i] = -self.0[i];
        }
        self
    }
}

impl<const W: usize> Mask for LaneMask<W> {
    #[inline(always)]
    fn splat(b: bool) -> Self {
        LaneMask([(b as u64).wrapping_neg(); W])
    }
    #[inline(always)]
    fn get(self, lane: usize) -> bool {
        self.0[lane] != 0
    }
    #[inline(always)]
    fn set(&mut self, lane: usize, b: bool) {
        self.0[lane] = (b as u64).wrapping_neg();
    }
    #[inline(always)]
    fn all(self) -> bool {
        self.0.iter().fold(!0, |a, &b| a & b) != 0
    }
    #[inline(always)]
    fn any(self) -> bool {
        self.0.iter().fold(0, |a, &b| a | b) != 0
    }
    #[inline(always)]
    fn and(mut self, other: Self) -> Self {
        for i in 0..W {
            self.0[i] &= other.0[i];
        }
        self
    }
    #[inline(always)]
    fn or(mut self, other: Self) -> Self {
        for i in 0..W {
            self.0[i] |= other.0[i];
        }
        self
    }
    #[inline(always)]
    fn not(mut self) -> Self {
        for i in 0..W {
            self.0[i] = !self.0[i];
        }
        self
    }
}

impl<const W: usize> Real for Lanes<W> {
    type Mask = LaneMask<W>;
    const LANES: usize = W;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        Lanes([x; W])
    }
    #[inline(always)]
    fn get(&self, lane: usize) -> f64 {
        self.0[lane]
    }
    #[inline(always)]
    fn set(&mut self, lane: usize, x: f64) {
        self.0[lane] = x;
    }
    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for i in 0..W {
            self.0[i] = self.0[i].sqrt();
        }
        self
    }
    #[inline(always)]
    fn abs(mut self) -> Self {
        for i in 0..W {
            self.0[i] = self.0[i].abs();
        }
        self
    }
    #[inline(always)]
    fn lt(self, other: Self) -> LaneMask<W> {
        let mut mask = LaneMask([0; W]);
        for i in 0..W {
            mask.0[i] = ((self.0[i] < other.0[i]) as u64).wrapping_neg();
        }
        mask
    }
    #[inline(always)]
    fn select(mask: LaneMask<W>, yes: Self, no: Self) -> Self {
        let mut out = no;
        for i in 0..W {
            let bits = (yes.0[i].to_bits() & mask.0[i]) | (no.0[i].to_bits() & !mask.0[i]);
            out.0[i] = f64::from_bits(bits);
        }
        out
    }
    lane_by_lane!();
    // Written as the comparison that one vector instruction does.
    #[inline(always)]
    fn min(mut self, other: Self) -> Self {
        for i in 0..W {
            self.0[i] = if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] };
        }
        self
    }
    #[inline(always)]
    fn max(mut self, other: Self) -> Self {
        for i in 0..W {
            self.0[i] = if other.0[i] < self.0[i] { self.0[i] } else { other.0[i] };
        }
        self
    }
}
