//! Gaussian elimination of a banded matrix of 2 x 2 blocks, one node after the other, in lanes.
//!
//! A node feels two neighbours on each side, so a row has five blocks. They are taken as *hooks*: of each node the
//! diagonal block, the two blocks right of it and the two below. Eliminating a node needs of the past only what was
//! subtracted from the next two diagonals. So an implicit step can eliminate a node as soon as its hook is
//! known, while the numbers are still in registers, and keep only what the way back needs.

use crate::lane::Real;
use crate::lanewise;
use crate::vec2::Vec2;
use crate::zeros;

/// A 2 x 2 block, by rows.
pub type Block<R> = [[R; 2]; 2];

/// What a matrix has of one node: its diagonal block, and the blocks that couple it to the two nodes after it.
#[derive(Clone, Copy, Debug)]
pub struct Hook<R> {
    /// Block (i, i); after elimination the inverse of the pivot.
    pub diagonal: Block<R>,
    /// Blocks (i, i+1) and (i, i+2); after elimination multiplied by the pivot's inverse.
    pub right: [Block<R>; 2],
    /// Blocks (i+1, i) and (i+2, i).
    pub below: [Block<R>; 2],
}

zeros!(Hook: diagonal, right, below);

lanewise!(Hook: diagonal, right, below);

impl<R: Real> Hook<R> {
    /// That of the transposed matrix.
    #[inline(always)]
    pub fn transposed(&self) -> Self {
        let turn = |a: &Block<R>| block(|r, c| a[c][r]);
        Hook {
            diagonal: turn(&self.diagonal),
            right: [turn(&self.below[0]), turn(&self.below[1])],
            below: [turn(&self.right[0]), turn(&self.right[1])],
        }
    }

    /// That of one lane, the same in every lane of `T`.
    #[inline(always)]
    pub fn of_lane<T: Real>(&self, lane: usize) -> Hook<T> {
        let wide = |a: &Block<R>| block(|r, c| T::splat(a[r][c].get(lane)));
        Hook {
            diagonal: wide(&self.diagonal),
            right: [wide(&self.right[0]), wide(&self.right[1])],
            below: [wide(&self.below[0]), wide(&self.below[1])],
        }
    }
}

/// Multiplies vectors in lanes by one matrix of hooks: adds the product with `x` to `to`.
#[inline(always)]
pub fn multiply<R: Real>(hooks: &[Hook<f64>], x: &[Vec2<R>], to: &mut [Vec2<R>]) {
    for i in 0..hooks.len() {
        let hook = hooks[i].of_lane::<R>(0);
        let mut sum = to[i] + apply(&hook.diagonal, x[i]);
        for off in 1..=2 {
            if i + off < hooks.len() {
                sum += apply(&hook.right[off - 1], x[i + off]);
                to[i + off] += apply(&hook.below[off - 1], x[i]);
            }
        }
        to[i] = sum;
    }
}

/// One node's part of that product.
#[inline(always)]
pub fn multiply_row<R: Real>(hooks: &[Hook<f64>], node: usize, x: &[Vec2<R>]) -> Vec2<R> {
    let hook = hooks[node].of_lane::<R>(0);
    let mut sum = apply(&hook.diagonal, x[node]);
    for off in 1..=2 {
        if node + off < hooks.len() {
            sum += apply(&hook.right[off - 1], x[node + off]);
        }
        if node >= off {
            let before = hooks[node - off].of_lane::<R>(0);
            sum += apply(&before.below[off - 1], x[node - off]);
        }
    }
    sum
}

/// Solves with one matrix of eliminated hooks for right-hand sides in lanes, in place.
#[inline(always)]
pub fn solve<R: Real>(eliminated: &[Hook<f64>], b: &mut [Vec2<R>]) {
    let (mut descent, mut ascent) = (Descent::default(), Ascent::default());
    for (hook, b) in eliminated.iter().zip(b.iter_mut()) {
        *b = descent.pass(&hook.of_lane(0), *b);
    }
    for i in (0..b.len()).rev() {
        b[i] = ascent.pass(&eliminated[i].of_lane(0).right, b[i]);
    }
}

/// The block with entries `f(row, column)`.
#[inline(always)]
pub fn block<R>(f: impl Fn(usize, usize) -> R) -> Block<R> {
    [[f(0, 0), f(0, 1)], [f(1, 0), f(1, 1)]]
}

#[inline(always)]
fn product<R: Real>(a: &Block<R>, b: &Block<R>) -> Block<R> {
    block(|r, c| a[r][0] * b[0][c] + a[r][1] * b[1][c])
}

#[inline(always)]
fn apply<R: Real>(a: &Block<R>, x: Vec2<R>) -> Vec2<R> {
    Vec2::new(a[0][0] * x.x + a[0][1] * x.y, a[1][0] * x.x + a[1][1] * x.y)
}

/// What the nodes that are eliminated subtract from the blocks of the next two.
#[derive(Clone, Copy, Debug)]
pub struct Front<R> {
    diagonal: [Block<R>; 2],
    right: Block<R>,
    below: Block<R>,
}

zeros!(Front: diagonal, right, below);

impl<R: Real> Front<R> {
    /// Eliminates the next node, without pivoting: an implicit step adds the masses to the diagonal, which keeps the
    /// pivots away from zero. Where it does not, the solution is not finite or wrong, Newton's method does not
    /// converge, and the step is retried in halves.
    #[inline(always)]
    pub fn eliminate(&mut self, hook: &Hook<R>) -> Hook<R> {
        let difference = |a: &Block<R>, b: &Block<R>| block(|r, c| a[r][c] - b[r][c]);
        let [[a, b], [c, d]] = difference(&hook.diagonal, &self.diagonal[0]);
        let scale = R::one() / (a * d - b * c);
        let inverse = [[d * scale, -(b * scale)], [-(c * scale), a * scale]];
        let below = [difference(&hook.below[0], &self.below), hook.below[1]];
        let right = [
            product(&inverse, &difference(&hook.right[0], &self.right)),
            product(&inverse, &hook.right[1]),
        ];
        let near = product(&below[0], &right[0]);
        *self = Front {
            diagonal: [
                block(|r, c| self.diagonal[1][r][c] + near[r][c]),
                product(&below[1], &right[1]),
            ],
            right: product(&below[0], &right[1]),
            below: product(&below[1], &right[0]),
        };
        Hook { diagonal: inverse, right, below }
    }
}

/// A right-hand side on its way down the nodes.
#[derive(Clone, Copy, Debug)]
pub struct Descent<R>([Vec2<R>; 2]);

zeros!(Descent: 0);

impl<R: Real> Descent<R> {
    /// Takes the next node's two numbers past its eliminated hook.
    #[inline(always)]
    pub fn pass(&mut self, hook: &Hook<R>, b: Vec2<R>) -> Vec2<R> {
        let y = apply(&hook.diagonal, b - self.0[0]);
        self.0 = [self.0[1] + apply(&hook.below[0], y), apply(&hook.below[1], y)];
        y
    }
}

/// The solution on its way up the nodes.
#[derive(Clone, Copy, Debug)]
pub struct Ascent<R>([Vec2<R>; 2]);

zeros!(Ascent: 0);

impl<R: Real> Ascent<R> {
    /// The solution at the node before, from what `Descent` left there and its eliminated blocks to the right. The
    /// newest term comes last, so that the wait for it is short.
    #[inline(always)]
    pub fn pass(&mut self, right: &[Block<R>; 2], y: Vec2<R>) -> Vec2<R> {
        let x = y - apply(&right[1], self.0[1]) - apply(&right[0], self.0[0]);
        self.0 = [x, self.0[0]];
        x
    }
}
