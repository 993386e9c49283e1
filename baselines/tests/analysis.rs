//! Buckling widths and the reach of the base motor against reference numbers and theory.

use rodgym_baselines::pendulum::{
    RodDesign, buckling_width, discrete_buckling_width, reach, upright,
};

#[test]
fn buckling_widths_are_the_reference_ones() {
    let rod = |nodes| RodDesign { nodes, ..RodDesign::default() };
    assert!((buckling_width(&rod(7)) - 7.80e-3).abs() < 5e-6);
    for (nodes, width) in [(7, 6.90e-3), (13, 7.33e-3), (31, 7.61e-3), (101, 7.74e-3)] {
        let got = discrete_buckling_width(&rod(nodes));
        assert!((got - width).abs() < 6e-6, "{nodes} nodes: {got}");
    }
    // One rigid edge stands at any width.
    assert_eq!(discrete_buckling_width(&rod(2)), 0.0);
    let fine = discrete_buckling_width(&rod(301));
    assert!((fine / buckling_width(&rod(7)) - 1.0).abs() < 3e-3);
}

#[test]
fn the_thesis_rod_can_be_moved_and_seen_from_its_base() {
    let rod = RodDesign { bending_damping: 0.0, ..RodDesign::default() };
    let found = reach(&rod).unwrap();
    assert_eq!((found.states, found.controllable, found.observable), (12, 12, 12));
    assert!(found.distance > 0.0);
    assert!(found.hankel.windows(2).all(|pair| pair[0] >= pair[1]));
    // The softer the rod, the less of it the motor reaches: the weakest direction fades, then the rank.
    let weakest: Vec<f64> = [1e8, 1e7, 3e6, 1e6]
        .map(|youngs_modulus| reach(&RodDesign { youngs_modulus, ..rod.clone() }).unwrap())
        .map(|r| r.hankel[11] / r.hankel[0])
        .to_vec();
    assert!(weakest.windows(2).all(|pair| pair[1] < 0.5 * pair[0]), "{weakest:?}");
    let soft = reach(&RodDesign { youngs_modulus: 1e6, ..rod.clone() }).unwrap();
    assert!(soft.controllable < 12);
    // Without units: a rod twice as long and heavy, equally flexible for its weight, has the same reach.
    let large = RodDesign { length: 0.6, width: 0.014, youngs_modulus: 2e7, ..rod };
    let again = reach(&large).unwrap();
    assert!((again.hankel[0] / found.hankel[0] - 1.0).abs() < 1e-6);
}

/// The pendulum of the textbooks: half of the rod's mass in its tip, so that it falls as exp(sqrt(g/l) t).
#[test]
fn one_edge_is_a_point_mass_on_a_rod() {
    let rod = RodDesign { nodes: 2, bending_damping: 0.0, ..RodDesign::default() };
    let model = upright(&rod);
    assert!((model.a[(1, 0)] - 9.81 / 0.3).abs() < 1e-12);
    let mass = 0.5 * 1500.0 * 0.007 * 0.007 * 0.3;
    assert!((model.b[(1, 0)] * mass * 0.3 * 0.3 - 1.0).abs() < 1e-12);
    let found = reach(&rod).unwrap();
    assert_eq!((found.states, found.controllable, found.observable), (2, 2, 2));
}
