//! Data in lanes: every number of it in one fixed order, so that lanes are copied, selected and written down by one
//! list of fields.

use super::Real;
use crate::vec2::Vec2;

/// A number in lanes, or data made of such numbers. Structures get it from [`lanewise!`](crate::lanewise).
pub trait Lanewise<R: Real> {
    /// The same data in numbers of another type.
    type Of<S: Real>: Lanewise<S, Of<R> = Self>;

    /// Calls `f` with every number, always in the same order.
    fn visit<F: FnMut(&R) + ?Sized>(&self, f: &mut F);
    /// The same with numbers that `f` may change.
    fn visit_mut<F: FnMut(&mut R) + ?Sized>(&mut self, f: &mut F);
    /// Calls `f` with every number and its counterpart in `other`, which has the same shape.
    fn pair<S: Real, F: FnMut(&mut R, &S) + ?Sized>(&mut self, other: &Self::Of<S>, f: &mut F);

    /// Copies all of `other`, which has the same shape; no memory is taken.
    #[inline(always)]
    fn copy_from(&mut self, other: &Self::Of<R>) {
        self.pair(other, &mut |to, from| *to = *from);
    }
    /// Takes the numbers of `other` where the mask is set.
    #[inline(always)]
    fn take(&mut self, mask: R::Mask, other: &Self::Of<R>) {
        self.pair(other, &mut |to, from| *to = R::select(mask, *from, *to));
    }
    /// Copies single data of the same shape into one lane.
    #[inline(always)]
    fn set_lane(&mut self, lane: usize, from: &Self::Of<f64>) {
        self.pair(from, &mut |to, from| to.set(lane, *from));
    }
    /// Copies one lane into single data of the same shape.
    #[inline(always)]
    fn read_lane(&self, lane: usize, to: &mut Self::Of<f64>) {
        to.pair(self, &mut |to, from: &R| *to = from.get(lane));
    }
    /// One lane of data that has always the same shape.
    #[inline(always)]
    fn lane(&self, lane: usize) -> Self::Of<f64>
    where
        Self::Of<f64>: Copy + Default,
    {
        let mut one = Default::default();
        self.read_lane(lane, &mut one);
        one
    }
}

impl<R: Real> Lanewise<R> for R {
    type Of<S: Real> = S;

    #[inline(always)]
    fn visit<F: FnMut(&R) + ?Sized>(&self, f: &mut F) {
        f(self);
    }
    #[inline(always)]
    fn visit_mut<F: FnMut(&mut R) + ?Sized>(&mut self, f: &mut F) {
        f(self);
    }
    #[inline(always)]
    fn pair<S: Real, F: FnMut(&mut R, &S) + ?Sized>(&mut self, other: &S, f: &mut F) {
        f(self, other);
    }
}

/// Lists of lanewise data: the items in their order.
macro_rules! list {
    ($list:ty, $of:ty $(, $size:ident)?) => {
        impl<R: Real, T: Lanewise<R> $(, const $size: usize)?> Lanewise<R> for $list {
            type Of<S: Real> = $of;

            #[inline(always)]
            fn visit<F: FnMut(&R) + ?Sized>(&self, f: &mut F) {
                for item in self {
                    item.visit(f);
                }
            }
            #[inline(always)]
            fn visit_mut<F: FnMut(&mut R) + ?Sized>(&mut self, f: &mut F) {
                for item in self {
                    item.visit_mut(f);
                }
            }
            #[inline(always)]
            fn pair<S: Real, F: FnMut(&mut R, &S) + ?Sized>(&mut self, other: &$of, f: &mut F) {
                debug_assert_eq!(self.len(), other.len());
                for (item, other) in self.iter_mut().zip(other) {
                    item.pair(other, f);
                }
            }
        }
    };
}
list!(Vec<T>, Vec<T::Of<S>>);
list!([T; N], [T::Of<S>; N], N);

/// Makes a structure of numbers in lanes `Lanewise`, by the one list of the fields that belong to it, in their order:
/// `lanewise!(Vec2: x, y);`, or with other such data as a parameter `lanewise!(Past<S>: before, known);`. Other fields,
/// such as memory for a computation, are left alone.
#[macro_export]
macro_rules! lanewise {
    ($name:ident: $($field:ident),+) => {
        $crate::lanewise!(@ [], $name<R>, $name<N>, $($field),+);
    };
    ($name:ident<$data:ident>: $($field:ident),+) => {
        $crate::lanewise!(
            @ [$data: $crate::lane::Lanewise<R>],
            $name<R, $data>,
            $name<N, <$data as $crate::lane::Lanewise<R>>::Of<N>>,
            $($field),+
        );
    };
    (@ [$($data:tt)*], $this:ty, $other:ty, $($field:ident),+) => {
        impl<R: $crate::lane::Real, $($data)*> $crate::lane::Lanewise<R> for $this {
            type Of<N: $crate::lane::Real> = $other;

            #[inline(always)]
            fn visit<F: FnMut(&R) + ?Sized>(&self, f: &mut F) {
                $($crate::lane::Lanewise::visit(&self.$field, f);)+
            }
            #[inline(always)]
            fn visit_mut<F: FnMut(&mut R) + ?Sized>(&mut self, f: &mut F) {
                $($crate::lane::Lanewise::visit_mut(&mut self.$field, f);)+
            }
            #[inline(always)]
            fn pair<N: $crate::lane::Real, F: FnMut(&mut R, &N) + ?Sized>(
                &mut self,
                other: &$other,
                f: &mut F,
            ) {
                $($crate::lane::Lanewise::pair(&mut self.$field, &other.$field, f);)+
            }
        }
    };
}

lanewise!(Vec2: x, y);
