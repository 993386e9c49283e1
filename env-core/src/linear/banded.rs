//! A banded matrix of 2 x 2 blocks that is kept as a whole, in lanes.

use super::elimination::{Ascent, Block, Descent, Front, Hook, block};
use crate::lane::{Real, Zero};
use crate::lanewise;
use crate::vec2::Vec2;

/// A square matrix whose blocks vanish beyond the second off the diagonal.
#[derive(Clone, Debug, Default)]
pub struct Banded<R> {
    hooks: Vec<Hook<R>>,
}

lanewise!(Banded: hooks);

impl<R: Real> Banded<R> {
    /// A zero matrix of `blocks` block rows.
    pub fn new(blocks: usize) -> Self {
        Banded { hooks: vec![Hook::default(); blocks] }
    }

    /// Its hooks, node by node.
    #[inline(always)]
    pub fn hooks(&self) -> &[Hook<R>] {
        &self.hooks
    }

    /// Number of rows.
    #[inline(always)]
    pub fn size(&self) -> usize {
        2 * self.hooks.len()
    }

    /// Sets all entries to zero.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.hooks.fill(Hook::default());
    }

    /// The block at (row, column), counted in blocks; at most two off the diagonal.
    #[inline(always)]
    fn block(&mut self, row: usize, column: usize) -> &mut Block<R> {
        let hook = &mut self.hooks[row.min(column)];
        if row == column {
            &mut hook.diagonal
        } else if column > row {
            &mut hook.right[column - row - 1]
        } else {
            &mut hook.below[row - column - 1]
        }
    }

    /// Adds to the 2 x 2 block at (row, column), counted in blocks; at most two blocks off the diagonal.
    #[inline(always)]
    pub fn add_block(&mut self, row: usize, column: usize, add: Block<R>) {
        let own = self.block(row, column);
        *own = block(|r, c| own[r][c] + add[r][c]);
    }

    /// Adds to all blocks of a node's hook.
    #[inline(always)]
    pub fn add_hook(&mut self, node: usize, hook: &Hook<R>) {
        self.add_block(node, node, hook.diagonal);
        for off in 1..=2 {
            if node + off < self.hooks.len() {
                self.add_block(node, node + off, hook.right[off - 1]);
                self.add_block(node + off, node, hook.below[off - 1]);
            }
        }
    }

    /// Replaces both rows of a block by those of the unit matrix: with 0 on the right-hand side these two
    /// unknowns stay where they are.
    #[inline(always)]
    pub fn hold(&mut self, row: usize) {
        let last = (row + 2).min(self.hooks.len() - 1);
        for column in row.saturating_sub(2)..=last {
            *self.block(row, column) = Block::zeros();
        }
        *self.block(row, row) = [[R::one(), R::zero()], [R::zero(), R::one()]];
    }

    /// Becomes its own transpose.
    #[inline(always)]
    pub fn transpose(&mut self) {
        for hook in &mut self.hooks {
            *hook = hook.transposed();
        }
    }

    /// Entry at (row, column); zero outside the band.
    #[inline(always)]
    pub fn get(&self, row: usize, column: usize) -> R {
        let (i, j) = (row / 2, column / 2);
        let hook = &self.hooks[i.min(j)];
        let block = match (i.abs_diff(j), j > i) {
            (0, _) => &hook.diagonal,
            (off @ 1..=2, true) => &hook.right[off - 1],
            (off @ 1..=2, false) => &hook.below[off - 1],
            _ => return R::zero(),
        };
        block[row % 2][column % 2]
    }

    /// Eliminates all nodes in place, see `Front`.
    #[inline(always)]
    pub fn factor(&mut self) {
        let mut front = Front::default();
        for hook in &mut self.hooks {
            *hook = front.eliminate(hook);
        }
    }

    /// Solves for one right-hand side in place, after `factor`.
    #[inline(always)]
    pub fn solve(&self, b: &mut [Vec2<R>]) {
        let mut descent = Descent::default();
        for (i, hook) in self.hooks.iter().enumerate() {
            b[i] = descent.pass(hook, b[i]);
        }
        let mut ascent = Ascent::default();
        for (i, hook) in self.hooks.iter().enumerate().rev() {
            b[i] = ascent.pass(&hook.right, b[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::Stream;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn solution_satisfies_the_system() {
        let mut stream = Stream::new(3);
        for blocks in [1, 2, 3, 8] {
            let mut matrix = Banded::<f64>::new(blocks);
            for row in 0..blocks {
                for column in row.saturating_sub(2)..(row + 3).min(blocks) {
                    let heavy = if row == column { 8.0 } else { 0.0 };
                    let mut draw = || stream.uniform(-1.0, 1.0);
                    let block = [[draw() + heavy, draw()], [draw(), draw() + heavy]];
                    matrix.add_block(row, column, block);
                }
            }
            let n = 2 * blocks;
            let dense = DMatrix::from_fn(n, n, |r, c| matrix.get(r, c));
            let b = DVector::from_fn(n, |_, _| stream.uniform(-1.0, 1.0));
            let mut x: Vec<_> = (0..blocks).map(|i| Vec2::new(b[2 * i], b[2 * i + 1])).collect();
            matrix.factor();
            matrix.solve(&mut x);
            let x = DVector::from_iterator(n, x.iter().flat_map(|p| [p.x, p.y]));
            let residual = &dense * x - &b;
            assert!(residual.amax() < 1e-13, "{blocks} blocks: residual {}", residual.amax());
        }
    }
}
