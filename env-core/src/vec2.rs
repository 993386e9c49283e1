//! Vectors in the plane of motion, in lanes.

use crate::lane::Real;
use crate::zeros;
use std::ops::{Add, AddAssign, Neg, Sub, SubAssign};

/// A vector (x, y) of the plane.
#[derive(Clone, Copy, Debug)]
pub struct Vec2<R> {
    /// Component along E1.
    pub x: R,
    /// Component along E2.
    pub y: R,
}

zeros!(Vec2: x, y);

impl<R: Real> Vec2<R> {
    /// The vector (x, y).
    #[inline(always)]
    pub fn new(x: R, y: R) -> Self {
        Vec2 { x, y }
    }
    /// The zero vector.
    #[inline(always)]
    pub fn zero() -> Self {
        Vec2 { x: R::zero(), y: R::zero() }
    }
    /// Inner product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> R {
        self.x * other.x + self.y * other.y
    }
    /// `self x other`, the component out of the plane.
    #[inline(always)]
    pub fn cross(self, other: Self) -> R {
        self.x * other.y - self.y * other.x
    }
    /// Turned by a right angle counter-clockwise.
    #[inline(always)]
    pub fn perp(self) -> Self {
        Vec2 { x: -self.y, y: self.x }
    }
    /// Multiplied by a number.
    #[inline(always)]
    pub fn scale(self, k: R) -> Self {
        Vec2 { x: self.x * k, y: self.y * k }
    }
    /// `yes` where the mask is set, `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: R::Mask, yes: Self, no: Self) -> Self {
        Vec2 { x: R::select(mask, yes.x, no.x), y: R::select(mask, yes.y, no.y) }
    }
}

impl<R: Real> Add for Vec2<R> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Vec2 { x: self.x + o.x, y: self.y + o.y }
    }
}
impl<R: Real> Sub for Vec2<R> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Vec2 { x: self.x - o.x, y: self.y - o.y }
    }
}
impl<R: Real> Neg for Vec2<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Vec2 { x: -self.x, y: -self.y }
    }
}
impl<R: Real> AddAssign for Vec2<R> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
impl<R: Real> SubAssign for Vec2<R> {
    #[inline(always)]
    fn sub_assign(&mut self, o: Self) {
        *self = *self - o;
    }
}
