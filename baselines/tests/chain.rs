//! The reduced chain is the thesis' inextensible model: same linearization, energy balance in any
//! motion, and the low modes of a fine rod with six coordinates.

use rodgym_baselines::linalg::eigenvalues;
use rodgym_baselines::pendulum::{Chain, RodDesign, upright};
use rodgym_core::seed::Stream;
use std::f64::consts::PI;

fn rod(nodes: usize) -> RodDesign {
    RodDesign { nodes, bending_damping: 0.0, ..RodDesign::default() }
}

fn state(chain: &Chain, angle: f64, rate: f64) -> Vec<f64> {
    let mut state = chain.straight(angle);
    state.extend(chain.straight(rate));
    state
}

/// Frequencies (positive) and growth rates (as negative numbers) about up, in order.
fn spectrum(a: &nalgebra::DMatrix<f64>) -> Vec<f64> {
    let mut values: Vec<f64> = eigenvalues(a)
        .iter()
        .filter(|z| z.im > 1e-3 || z.re > 1e-3)
        .map(|z| if z.im > 1e-3 { z.im } else { -z.re })
        .collect();
    values.sort_by(f64::total_cmp);
    values
}

#[test]
fn with_as_many_coordinates_as_edges_it_is_the_thesis_model() {
    let chain = Chain::new(&rod(7), 6);
    let (a, b) = chain.linearize(&state(&chain, PI, 0.0), 0.0);
    // The same matrices in the coordinates q = S' theta.
    let s = chain.shape();
    let model = upright(&rod(7));
    let mut t = nalgebra::DMatrix::zeros(12, 12);
    t.view_mut((0, 0), (6, 6)).copy_from(&s);
    t.view_mut((6, 6), (6, 6)).copy_from(&s);
    let wanted = t.transpose() * model.a * &t;
    assert!((&a - &wanted).norm() < 1e-6 * wanted.norm(), "{a} is not {wanted}");
    let wanted = t.transpose() * model.b;
    assert!((&b - wanted.column(0)).norm() < 1e-9 * wanted.norm());
}

/// In any motion, energy grows by the power of the torque and shrinks by that of the damping.
#[test]
fn power_in_is_energy_gained() {
    for (nodes, order) in [(7, 6), (13, 6), (31, 5)] {
        let mut stream = Stream::new(nodes as u64);
        let lossless = Chain::new(&rod(nodes), order);
        let k = lossless.coordinates();
        for _ in 0..20 {
            let mut x = state(&lossless, stream.uniform(-4.0, 4.0), stream.uniform(-8.0, 8.0));
            // Bent by up to a radian from end to end.
            x.iter_mut().enumerate().for_each(|(i, x)| {
                if i % k > 0 {
                    *x += stream.uniform(-0.2, 0.2) * if i < k { 1.0 } else { 20.0 };
                }
            });
            let torque = stream.uniform(-0.05, 0.05);
            let power = torque * lossless.base(&x[k..]);
            let h = 1e-6;
            let (mut before, mut after) = (x.clone(), x.clone());
            lossless.step(&mut before, torque, -h);
            lossless.step(&mut after, torque, h);
            let gained =
                (lossless.energy(&after).total() - lossless.energy(&before).total()) / (2.0 * h);
            assert!((gained - power).abs() < 1e-5 * (1.0 + power.abs()), "{gained} {power}");
            let damped = Chain::new(
                &RodDesign { bending_damping: 1e-3, damping: 1e-3, ..rod(nodes) },
                order,
            );
            let mut less = x.clone();
            damped.step(&mut less, torque, h);
            assert!(damped.energy(&less).total() < lossless.energy(&after).total());
        }
    }
}

#[test]
fn six_coordinates_have_the_low_modes_of_a_fine_rod() {
    for nodes in [13, 31, 101] {
        let fine = spectrum(&upright(&rod(nodes)).a);
        let chain = Chain::new(&rod(nodes), 6);
        let reduced = spectrum(&chain.linearize(&state(&chain, PI, 0.0), 0.0).0);
        assert_eq!(reduced.len(), 6);
        // Growth rate and first two bending modes, where Galerkin's method comes from above.
        for (mode, tolerance) in [(0, 1e-4), (1, 2e-3), (2, 2e-2)] {
            let error = (reduced[mode] / fine[mode] - 1.0).abs();
            assert!(error < tolerance, "{nodes} nodes, mode {mode}: {reduced:?}, fine {fine:?}");
        }
        // Six links of the thesis, by contrast, are far too soft.
        let coarse = spectrum(&upright(&rod(7)).a);
        assert!(coarse[2] / fine[2] < 0.9);
    }
}

/// A free swing conserves energy, and angle coordinates come back from angles.
#[test]
fn a_free_swing_conserves_energy() {
    let chain = Chain::new(&rod(13), 6);
    let mut x = state(&chain, PI / 2.0, 0.0);
    let start = chain.energy(&x).total();
    for _ in 0..4000 {
        chain.step(&mut x, 0.0, 2.5e-4);
    }
    let end = chain.energy(&x);
    assert!((end.total() - start).abs() < 1e-6 * end.kinetic.max(1e-3), "{end:?} from {start}");
    let q = chain.coordinates_of(&chain.angles(&x[..6]));
    assert!(q.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-12));
}
