//! A banded matrix of 2 x 2 blocks and its factorisation, in lanes.

use crate::lane::Real;

/// Blocks to either side of the diagonal block that may be filled: a node feels two neighbours
/// on each side.
const REACH: usize = 2;
/// Half-bandwidth in rows.
const HALF: usize = 2 * REACH + 1;
/// Stored entries of a row.
const ROW: usize = 2 * HALF + 1;

/// A square matrix whose entries vanish beyond the half-bandwidth of 5 (two blocks of 2 x 2).
#[derive(Clone, Debug, Default)]
pub struct Banded<R> {
    rows: Vec<[R; ROW]>,
    inverse_pivots: Vec<R>,
}

impl<R: Real> Banded<R> {
    /// A zero matrix of `blocks` block rows.
    pub fn new(blocks: usize) -> Self {
        Banded {
            rows: vec![[R::zero(); ROW]; 2 * blocks],
            inverse_pivots: vec![R::zero(); 2 * blocks],
        }
    }

    /// Number of rows.
    #[inline(always)]
    pub fn size(&self) -> usize {
        self.rows.len()
    }

    /// Sets all entries to zero.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.rows.fill([R::zero(); ROW]);
    }

    /// Adds to the 2 x 2 block at (row, column), counted in blocks; at most two blocks off the diagonal.
    #[inline(always)]
    pub fn add_block(&mut self, row: usize, column: usize, block: [[R; 2]; 2]) {
        let at = 2 * column + HALF - 2 * row;
        let (upper, lower) = (2 * row, 2 * row + 1);
        self.rows[upper][at] += block[0][0];
        self.rows[upper][at + 1] += block[0][1];
        self.rows[lower][at - 1] += block[1][0];
        self.rows[lower][at] += block[1][1];
    }

    /// Replaces both rows of a block by those of the unit matrix: with 0 on the right-hand side these two
    /// unknowns stay where they are.
    #[inline(always)]
    pub fn hold(&mut self, block: usize) {
        for row in [2 * block, 2 * block + 1] {
            self.rows[row] = [R::zero(); ROW];
            self.rows[row][HALF] = R::one();
        }
    }

    /// Entry at (row, column); zero outside the band.
    #[inline(always)]
    pub fn get(&self, row: usize, column: usize) -> R {
        let at = (column + HALF).wrapping_sub(row);
        if at < ROW { self.rows[row][at] } else { R::zero() }
    }

    /// Replaces the matrix by its factors L and U, without pivoting: an implicit step adds the masses to
    /// the diagonal, which keeps the pivots away from zero. Where it does not, the solution is
    /// not finite or wrong, Newton's method does not converge, and the step is retried in halves.
    #[inline(always)]
    pub fn factor(&mut self) {
        let n = self.rows.len();
        for i in 0..n {
            let pivot_row = self.rows[i];
            let inverse = R::one() / pivot_row[HALF];
            self.inverse_pivots[i] = inverse;
            let below = HALF.min(n - 1 - i);
            for d in 1..=below {
                let row = &mut self.rows[i + d];
                let factor = row[HALF - d] * inverse;
                row[HALF - d] = factor;
                for c in 1..=HALF {
                    row[HALF - d + c] -= factor * pivot_row[HALF + c];
                }
            }
        }
    }

    /// Solves for one right-hand side in place, after `factor`. Each sum takes its newest term last, so that
    /// the wait for it is one multiplication and one subtraction long.
    #[inline(always)]
    pub fn solve(&self, b: &mut [R]) {
        let n = self.rows.len();
        for i in 1..n {
            let mut sum = b[i];
            for d in (1..=HALF.min(i)).rev() {
                sum -= self.rows[i][HALF - d] * b[i - d];
            }
            b[i] = sum;
        }
        for i in (0..n).rev() {
            let mut sum = b[i];
            for d in (1..=HALF.min(n - 1 - i)).rev() {
                sum -= self.rows[i][HALF + d] * b[i + d];
            }
            b[i] = sum * self.inverse_pivots[i];
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
            let mut x: Vec<f64> = b.iter().copied().collect();
            matrix.factor();
            matrix.solve(&mut x);
            let residual = &dense * DVector::from_vec(x) - &b;
            assert!(residual.amax() < 1e-13, "{blocks} blocks: residual {}", residual.amax());
        }
    }
}
