//! One unknown beside those of a banded matrix, with a full row and a full column: a torque that follows the state, a
//! hull that moves with the nodes it bears.

use crate::lane::Real;
use crate::vec2::Vec2;

/// The row and the column beside a matrix A: `A x + column z = right`, `row . x + corner z = below`.
#[derive(Clone, Debug, Default)]
pub struct Border<R> {
    /// The column; for `close` as A solves for it.
    pub column: Vec<Vec2<R>>,
    /// The row.
    pub row: Vec<Vec2<R>>,
}

impl<R: Real> Border<R> {
    /// Zeros beside a matrix of `blocks` block rows.
    pub fn new(blocks: usize) -> Self {
        Border { column: vec![Vec2::zero(); blocks], row: vec![Vec2::zero(); blocks] }
    }

    /// Takes `x`, as A alone solves for the right-hand side, to the solution of the whole; returns z.
    #[inline(always)]
    pub fn close(&self, corner: R, below: R, x: &mut [Vec2<R>]) -> R {
        let (mut right, mut pivot) = (below, corner);
        for (i, row) in self.row.iter().enumerate() {
            right -= row.x * x[i].x;
            right -= row.y * x[i].y;
            pivot -= row.x * self.column[i].x;
            pivot -= row.y * self.column[i].y;
        }
        let z = right / pivot;
        for (x, column) in x.iter_mut().zip(&self.column) {
            *x -= column.scale(z);
        }
        z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::Banded;
    use crate::seed::Stream;

    #[test]
    fn bordered_solution_satisfies_both_equations() {
        let mut stream = Stream::new(5);
        let mut matrix = Banded::<f64>::new(4);
        for i in 0..4usize {
            for j in 0..4 {
                if i.abs_diff(j) <= 2 {
                    let mut draw = || stream.uniform(-1.0, 1.0);
                    let heavy = if i == j { 8.0 } else { 0.0 };
                    let block = [[draw() + heavy, draw()], [draw(), draw() + heavy]];
                    matrix.add_block(i, j, block);
                }
            }
        }
        let mut vectors = || -> Vec<_> {
            (0..4)
                .map(|_| Vec2::new(stream.uniform(-1.0, 1.0), stream.uniform(-1.0, 1.0)))
                .collect()
        };
        let (right, column, row) = (vectors(), vectors(), vectors());
        let (corner, below) = (2.0, 0.3);
        let (whole, mut x) = (matrix.clone(), right.clone());
        let mut border = Border { column: column.clone(), row: row.clone() };
        matrix.factor();
        matrix.solve(&mut x);
        matrix.solve(&mut border.column);
        let z = border.close(corner, below, &mut x);
        let flat = |v: &[Vec2<f64>]| -> Vec<f64> { v.iter().flat_map(|p| [p.x, p.y]).collect() };
        let (x, right, column, row) = (flat(&x), flat(&right), flat(&column), flat(&row));
        for i in 0..8 {
            let sum: f64 = (0..8).map(|j| whole.get(i, j) * x[j]).sum();
            assert!((sum + column[i] * z - right[i]).abs() < 1e-13, "row {i}");
        }
        let sum: f64 = row.iter().zip(&x).map(|(r, x)| r * x).sum();
        assert!((sum + corner * z - below).abs() < 1e-13);
    }
}
