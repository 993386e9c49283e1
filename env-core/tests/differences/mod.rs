//! Derivatives by small differences, for the tests of exact ones.

use rodgym_core::simulation::Named;

/// The slope at 0 by central differences, of which the errors of second, fourth and sixth order are removed.
pub fn slope(h: f64, at: &dyn Fn(f64) -> Vec<f64>) -> Vec<f64> {
    let central = |h: f64| -> Vec<f64> {
        at(h).iter().zip(at(-h)).map(|(up, down)| (up - down) / (2.0 * h)).collect()
    };
    let mut table: Vec<_> = (0..4).map(|k| central(h / f64::from(1 << k))).collect();
    for order in 1..4 {
        let factor = f64::from(1 << (2 * order));
        for k in 0..4 - order {
            table[k] = table[k + 1]
                .iter()
                .zip(&table[k])
                .map(|(fine, coarse)| fine + (fine - coarse) / (factor - 1.0))
                .collect();
        }
    }
    table.swap_remove(0)
}

/// A column of a matrix.
pub fn column(matrix: &Named, j: usize) -> Vec<f64> {
    matrix.values.iter().skip(j).step_by(matrix.shape[1]).copied().collect()
}

/// The largest difference over the largest entry.
pub fn distance(exact: &[f64], other: &[f64]) -> f64 {
    let largest = |list: &mut dyn Iterator<Item = f64>| list.fold(0.0, f64::max);
    let scale = largest(&mut exact.iter().map(|x| x.abs()));
    largest(&mut exact.iter().zip(other).map(|(a, b)| (a - b).abs())) / scale.max(1e-300)
}
