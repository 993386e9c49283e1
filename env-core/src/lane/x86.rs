//! Eight numbers side by side in the vector registers of x86-64 processors.
//!
//! `Lanes` leaves it to the compiler to find out that eight equal operations are one instruction, which
//! succeeds in short functions only; these types say so. The operations are the same, so are the bits.
//!
//! Every operation is safe to call only on a processor that has its instructions. So the types stay inside this
//! crate: `isa::with_lanes` names them, and names each only where it was found.

#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "what was just said holds for every operation"
)]

use super::{Kernel, Mask, Real};
use core::arch::x86_64::*;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// How many numbers stand side by side.
const WIDTH: usize = 8;

/// All bits set where `a < b`, as the AVX2 comparison has it.
#[inline(always)]
unsafe fn less512(a: __m512d, b: __m512d) -> __m512d {
    unsafe { _mm512_castsi512_pd(_mm512_movm_epi64(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b))) }
}

#[inline(always)]
unsafe fn less256(a: __m256d, b: __m256d) -> __m256d {
    unsafe { _mm256_cmp_pd::<_CMP_LT_OQ>(a, b) }
}

/// Defines a number type `$lanes` and its mask `$mask`, made of `$count` registers, from the instructions for one.
macro_rules! lanes {
    ($lanes:ident, $mask:ident, $features:literal: $count:literal x $register:ident, $splat:ident, $add:ident, $sub:ident, $mul:ident,
     $div:ident, $sqrt:ident, $min:ident, $max:ident, $less:ident, $and:ident, $andnot:ident, $or:ident, $xor:ident) => {
        /// Eight numbers.
        #[derive(Clone, Copy, Debug)]
        #[repr(C, align(64))]
        pub struct $lanes([$register; $count]);

        /// Eight truth values: all bits set, or none.
        #[derive(Clone, Copy, Debug)]
        #[repr(C, align(64))]
        pub struct $mask([$register; $count]);

        impl $lanes {
            #[inline(always)]
            fn one(self, f: impl Fn($register) -> $register) -> Self {
                let mut out = self;
                for i in 0..$count {
                    out.0[i] = f(self.0[i]);
                }
                out
            }
            #[inline(always)]
            fn two(self, other: Self, f: impl Fn($register, $register) -> $register) -> Self {
                let mut out = self;
                for i in 0..$count {
                    out.0[i] = f(self.0[i], other.0[i]);
                }
                out
            }
            #[inline(always)]
            fn view(&self) -> &[f64; WIDTH] {
                // SAFETY: the same bytes, no less aligned.
                unsafe { &*(&raw const self.0).cast() }
            }
            #[inline(always)]
            fn numbers(&mut self) -> &mut [f64; WIDTH] {
                // SAFETY: the same bytes, no less aligned.
                unsafe { &mut *(&raw mut self.0).cast() }
            }
        }

        impl $mask {
            #[inline(always)]
            fn two(self, other: Self, f: impl Fn($register, $register) -> $register) -> Self {
                $mask($lanes(self.0).two($lanes(other.0), f).0)
            }
            #[inline(always)]
            fn words(&self) -> [u64; WIDTH] {
                // SAFETY: the same bytes, and every pattern is a word.
                unsafe { std::mem::transmute(self.0) }
            }
        }

        impl Default for $lanes {
            #[inline(always)]
            fn default() -> Self {
                Self::splat(0.0)
            }
        }
        impl Add for $lanes {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                self.two(other, |a, b| unsafe { $add(a, b) })
            }
        }
        impl Sub for $lanes {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                self.two(other, |a, b| unsafe { $sub(a, b) })
            }
        }
        impl Mul for $lanes {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                self.two(other, |a, b| unsafe { $mul(a, b) })
            }
        }
        impl Div for $lanes {
            type Output = Self;
            #[inline(always)]
            fn div(self, other: Self) -> Self {
                self.two(other, |a, b| unsafe { $div(a, b) })
            }
        }
        impl Neg for $lanes {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                self.one(|a| unsafe { $xor(a, $splat(-0.0)) })
            }
        }
        impl AddAssign for $lanes {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }
        impl SubAssign for $lanes {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }
        impl MulAssign for $lanes {
            #[inline(always)]
            fn mul_assign(&mut self, other: Self) {
                *self = *self * other;
            }
        }

        impl Real for $lanes {
            type Mask = $mask;
            const LANES: usize = WIDTH;

            #[inline(always)]
            fn splat(x: f64) -> Self {
                $lanes([unsafe { $splat(x) }; $count])
            }
            #[inline(always)]
            fn get(&self, lane: usize) -> f64 {
                self.view()[lane]
            }
            #[inline(always)]
            fn set(&mut self, lane: usize, x: f64) {
                self.numbers()[lane] = x;
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.one(|a| unsafe { $sqrt(a) })
            }
            #[inline(always)]
            fn abs(self) -> Self {
                self.one(|a| unsafe { $andnot($splat(-0.0), a) })
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $mask {
                $mask(self.two(other, |a, b| unsafe { $less(a, b) }).0)
            }
            #[inline(always)]
            fn select(mask: $mask, yes: Self, no: Self) -> Self {
                let mut out = no;
                for i in 0..$count {
                    let m = mask.0[i];
                    out.0[i] = unsafe { $or($and(m, yes.0[i]), $andnot(m, no.0[i])) };
                }
                out
            }
            #[inline]
            fn run<K: Kernel>(kernel: K) -> K::Output {
                #[target_feature(enable = $features)]
                fn with_features<K: Kernel>(kernel: K) -> K::Output {
                    kernel.run()
                }
                unsafe { with_features(kernel) }
            }
            lane_by_lane!();
            // The instructions return the second operand where either is NaN.
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                self.two(other, |a, b| unsafe { $min(a, b) })
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                self.two(other, |a, b| unsafe { $max(a, b) })
            }
        }

        impl Mask for $mask {
            #[inline(always)]
            fn splat(b: bool) -> Self {
                let word = f64::from_bits((b as u64).wrapping_neg());
                $mask([unsafe { $splat(word) }; $count])
            }
            #[inline(always)]
            fn get(self, lane: usize) -> bool {
                self.words()[lane] != 0
            }
            #[inline(always)]
            fn set(&mut self, lane: usize, b: bool) {
                let mut numbers = $lanes(self.0);
                numbers.numbers()[lane] = f64::from_bits((b as u64).wrapping_neg());
                self.0 = numbers.0;
            }
            #[inline(always)]
            fn all(self) -> bool {
                self.words().iter().fold(!0, |a, &b| a & b) != 0
            }
            #[inline(always)]
            fn any(self) -> bool {
                self.words().iter().fold(0, |a, &b| a | b) != 0
            }
            #[inline(always)]
            fn and(self, other: Self) -> Self {
                self.two(other, |a, b| unsafe { $and(a, b) })
            }
            #[inline(always)]
            fn or(self, other: Self) -> Self {
                self.two(other, |a, b| unsafe { $or(a, b) })
            }
            #[inline(always)]
            fn not(self) -> Self {
                self.two(Self::splat(true), |a, all| unsafe { $xor(a, all) })
            }
        }
    };
}

lanes!(Avx2, Avx2Mask, "avx2": 2 x __m256d, _mm256_set1_pd, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd,
    _mm256_div_pd, _mm256_sqrt_pd, _mm256_min_pd, _mm256_max_pd, less256,
    _mm256_and_pd, _mm256_andnot_pd, _mm256_or_pd, _mm256_xor_pd);
lanes!(Avx512, Avx512Mask, "avx512f,avx512vl,avx512dq,avx512bw": 1 x __m512d, _mm512_set1_pd, _mm512_add_pd, _mm512_sub_pd, _mm512_mul_pd,
    _mm512_div_pd, _mm512_sqrt_pd, _mm512_min_pd, _mm512_max_pd, less512,
    _mm512_and_pd, _mm512_andnot_pd, _mm512_or_pd, _mm512_xor_pd);
