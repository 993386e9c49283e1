//! Sines, cosines and whole numbers in every lane at once.

use rodgym_core::lane::{Mask, Real};

/// The nearest whole number (of at most 2^51).
#[inline(always)]
pub fn round<R: Real>(x: R) -> R {
    // Beyond 2^52 a double has no fraction: adding and subtracting such a number rounds.
    let big = R::splat(6_755_399_441_055_744.0);
    (x + big) - big
}

/// Sine and cosine in all lanes at once, to 1e-13 for |x| < 100: far below what the model lacks.
#[inline(always)]
pub fn sin_cos<R: Real>(x: R) -> (R, R) {
    use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};
    /// What the double nearest to pi / 2 lacks.
    const REST: f64 = 6.123_233_995_736_766e-17;
    let quarters = round(x * R::splat(FRAC_2_PI));
    let r = (x - quarters * R::splat(FRAC_PI_2)) - quarters * R::splat(REST);
    let y = r * r;
    // Taylor's series, on a quarter of pi either way.
    let sin = r * series(
        y,
        [
            1.0,
            -1.0 / 6.0,
            1.0 / 120.0,
            -1.0 / 5040.0,
            1.0 / 362_880.0,
            -1.0 / 39_916_800.0,
            1.0 / 6_227_020_800.0,
        ],
    );
    let cos = series(
        y,
        [
            1.0,
            -1.0 / 2.0,
            1.0 / 24.0,
            -1.0 / 720.0,
            1.0 / 40_320.0,
            -1.0 / 3_628_800.0,
            1.0 / 479_001_600.0,
        ],
    ) - y * y * y * y * y * y * y * R::splat(1.0 / 87_178_291_200.0);
    // Which quarter it is: -2, -1, 0, 1 or 2.
    let m = quarters - R::splat(4.0) * round(quarters * R::splat(0.25));
    let odd = R::splat(0.5).lt(m.abs()).and(m.abs().lt(R::splat(1.5)));
    let (s, c) = (R::select(odd, cos, sin), R::select(odd, sin, cos));
    let minus_s = m.lt(R::splat(-0.5)).or(R::splat(1.5).lt(m));
    let minus_c = R::splat(0.5).lt(m).or(m.lt(R::splat(-1.5)));
    (R::select(minus_s, -s, s), R::select(minus_c, -c, c))
}

/// Sum of terms times powers of y.
#[inline(always)]
fn series<R: Real>(y: R, terms: [f64; 7]) -> R {
    let mut sum = R::splat(terms[6]);
    for i in (0..6).rev() {
        sum = sum * y + R::splat(terms[i]);
    }
    sum
}

#[cfg(test)]
mod tests {
    //! Sines and cosines are those of a library.

    use super::sin_cos;
    use rodgym_core::seed::Stream;

    #[test]
    fn sines_and_cosines_are_those_of_libm() {
        let mut stream = Stream::new(1);
        for _ in 0..10_000 {
            let x = stream.uniform(-100.0, 100.0);
            let (sin, cos) = sin_cos(x);
            assert!(
                (sin - libm::sin(x)).abs() < 1e-13 && (cos - libm::cos(x)).abs() < 1e-13,
                "{x}"
            );
        }
    }
}
