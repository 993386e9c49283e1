//! Zeros of structures of numbers.

/// A number, or a structure of numbers, that can be zero throughout. Structures get it, and `Default`, from
/// [`zeros!`](crate::zeros). (What `#[derive(Default)]` writes is not always inlined, and what is not inlined has not
/// the instructions of its caller.)
pub trait Zero: Copy {
    /// Zero in every number.
    fn zeros() -> Self;
}

impl<R: super::Real> Zero for R {
    #[inline(always)]
    fn zeros() -> Self {
        R::zero()
    }
}

impl<T: Zero, const N: usize> Zero for [T; N] {
    #[inline(always)]
    fn zeros() -> Self {
        [T::zeros(); N]
    }
}

/// Makes a structure of numbers in lanes `Zero`, and that its `Default`, by the list of its fields: `zeros!(Vec2: x, y);`.
#[macro_export]
macro_rules! zeros {
    ($name:ident: $($field:tt),+) => {
        impl<R: $crate::lane::Real> $crate::lane::Zero for $name<R> {
            #[inline(always)]
            fn zeros() -> Self {
                $name { $($field: $crate::lane::Zero::zeros()),+ }
            }
        }
        impl<R: $crate::lane::Real> Default for $name<R> {
            #[inline(always)]
            fn default() -> Self {
                $crate::lane::Zero::zeros()
            }
        }
    };
}
