//! Linear model and regulators of the pendulum against the reference numbers of an independent
//! program (Table 4.1, w = 7 mm), and the switching law.

use nalgebra::DMatrix;
use rodgym_baselines::Controller;
use rodgym_baselines::linalg::{care, dare, eigenvalues, sample_cost};
use rodgym_baselines::pendulum::{HybridLqr, RodDesign, Weights, upright};
use std::f64::consts::PI;

fn thesis_rod() -> RodDesign {
    RodDesign { bending_damping: 0.0, ..RodDesign::default() }
}

fn assert_close(got: &[f64], wanted: &[f64], relative: f64) {
    assert_eq!(got.len(), wanted.len());
    for (g, w) in got.iter().zip(wanted) {
        assert!((g - w).abs() <= relative * w.abs(), "{got:?} is not {wanted:?}");
    }
}

#[test]
fn open_loop_poles_are_the_reference_ones() {
    let poles = eigenvalues(&upright(&thesis_rod()).a);
    let mut real: Vec<f64> = poles.iter().filter(|p| p.im.abs() < 1e-6).map(|p| p.re).collect();
    let mut imaginary: Vec<f64> = poles.iter().filter(|p| p.im > 1e-6).map(|p| p.im).collect();
    real.sort_by(f64::total_cmp);
    imaginary.sort_by(f64::total_cmp);
    assert_close(&real, &[-7.0201, 7.0201], 1e-4);
    assert_close(&imaginary, &[20.715, 73.763, 138.554, 200.092, 243.986], 1e-4);
}

/// The matrices as thesis (4.10)-(4.12) print them, for several sizes.
#[test]
fn the_model_is_the_one_printed_in_the_thesis() {
    for nodes in [5, 7, 12] {
        let rod = RodDesign { nodes, ..thesis_rod() };
        let n = rod.edges();
        let mut bend = DMatrix::zeros(n, n);
        for i in 0..n {
            for (j, x) in [(-2, -1.0), (-1, 4.0), (0, -6.0), (1, 4.0), (2, -1.0)] {
                let k = i as i64 + j;
                if (0..n as i64).contains(&k) {
                    bend[(i, k as usize)] = x;
                }
            }
        }
        for (j, x) in [-2.0, 3.0, -1.0].into_iter().enumerate() {
            bend[(0, j)] = x;
        }
        bend[(1, 0)] = 3.0;
        bend[(n - 2, n - 1)] = 3.0;
        for (j, x) in [-1.0, 5.0, -4.0].into_iter().enumerate() {
            bend[(n - 1, n - 3 + j)] = x;
        }
        let big_n = nodes as f64;
        let gravity = DMatrix::from_fn(n, n, |row, column| {
            let i = row.min(column) as f64 + 1.0;
            match column as i64 - row as i64 {
                0 if row == 0 => big_n - 1.5,
                0 if row == n - 1 => 1.5,
                0 => 2.0 * (big_n - 1.0 - i) + 1.0,
                1 => i - big_n + 1.5,
                -1 => i - big_n + 0.5,
                _ => 0.0,
            }
        });
        let (m, l) = (rod.node_mass(), rod.edge_length());
        let wanted =
            bend * (rod.bending_stiffness() / (m * l * l * l)) + gravity * (rod.gravity / l);
        let model = upright(&rod);
        let got = model.a.view((n, 0), (n, n)).into_owned();
        assert!((&got - &wanted).norm() <= 1e-11 * wanted.norm(), "{got} is not {wanted}");
        let b: Vec<f64> = model.b.iter().map(|x| x * m * l * l).collect();
        for (i, x) in b.iter().enumerate() {
            let wanted = if i == n {
                1.0
            } else if i == n + 1 {
                -1.0
            } else {
                0.0
            };
            assert!((x - wanted).abs() < 1e-11, "{b:?}");
        }
    }
}

#[test]
fn the_continuous_gain_is_the_reference_one() {
    let model = upright(&thesis_rod());
    let (q, r) = Weights::default().matrices(6);
    let s = care(&model.a, &model.b, &q, &r, None).unwrap();
    let wanted = [
        41.9915, -6.4612, 13.5714, 8.5106, 0.8539, 2.2641, 2.2083, 2.0638, 1.6190, 1.3820, 0.8615,
        0.3368,
    ];
    assert_close(s.gain.as_slice(), &wanted, 1e-3);
    let fastest = eigenvalues(&s.closed_loop).iter().map(|p| p.re).fold(0.0, f64::min);
    assert_close(&[fastest], &[-15391.0], 1e-4);
}

#[test]
fn the_sampled_gains_are_the_reference_ones() {
    let gain = |rod| HybridLqr::new(rod, Weights::default()).unwrap().gain().to_vec();
    let undamped = [
        0.05131, 0.05603, 0.01552, 0.01124, 0.01108, 0.00144, 0.00579, 0.00457, 0.00410, 0.00307,
        0.00210, 0.00075,
    ];
    let damped = [
        0.07651, 0.05531, 0.02064, 0.01995, 0.00888, 0.00408, 0.00717, 0.00592, 0.00510, 0.00398,
        0.00263, 0.00097,
    ];
    for (got, wanted) in [(gain(thesis_rod()), undamped), (gain(RodDesign::default()), damped)] {
        for (g, w) in got.iter().zip(&wanted) {
            // The references carry five decimals.
            assert!((g - w).abs() < 1e-3 * w + 6e-6, "{got:?} is not {wanted:?}");
        }
    }
}

/// Refining the period brings the sampled regulator to the continuous one.
#[test]
fn the_sampled_gain_tends_to_the_continuous_one() {
    let model = upright(&thesis_rod());
    let (q, r) = Weights::default().matrices(6);
    let limit = care(&model.a, &model.b, &q, &r, None).unwrap().gain;
    let s = sample_cost(&model.a, &model.b, &q, &r, 1e-8);
    let gain = dare(&s.a, &s.b, &s.q, &s.r, Some(&s.n)).unwrap().gain;
    assert!((&gain - &limit).norm() < 1e-3 * limit.norm(), "{gain} is not {limit}");
}

fn observation(angles: &[f64], rates: &[f64]) -> Vec<f32> {
    let cos = angles.iter().map(|a| a.cos() as f32);
    let sin = angles.iter().map(|a| a.sin() as f32);
    cos.chain(sin).chain(rates.iter().map(|r| (r / 10.0) as f32)).collect()
}

#[test]
fn near_up_it_is_the_linear_law_and_elsewhere_the_swing_up() {
    let lqr = HybridLqr::new(RodDesign::default(), Weights::default()).unwrap();
    // Row 0: 0.01 rad past up on every edge, seen through the branch cut; row 1: hanging.
    let near = [PI + 0.01; 6];
    let rates = [-0.2; 6];
    let mut obs = observation(&near, &rates);
    obs.extend(observation(&[0.3; 6], &[0.0; 6]));
    let mut state = vec![7.0, 7.0];
    let mut actions = vec![0.0; 2];
    lqr.predict(&obs, &mut state, &[false, true], &mut actions).unwrap();
    let k = lqr.gain();
    let torque: f64 = (0..6).map(|i| -k[i] * 0.01 + k[6 + i] * 0.2).sum();
    assert!((actions[0] as f64 - torque / 0.05).abs() < 1e-5, "{actions:?}");
    // cos(0) of a swing that starts, half of the torque limit.
    assert_eq!(actions[1], 0.5);
    assert_eq!(state, [7.01, 0.01]);
    // Half a period on, the swing pushes the other way; the clock is the row's own.
    state[1] = PI / (9.81f64 / 0.3).sqrt();
    lqr.predict(&obs, &mut state, &[false, false], &mut actions).unwrap();
    assert!((actions[1] + 0.5).abs() < 1e-6);
}

#[test]
fn a_batch_is_its_rows_and_bad_shapes_are_refused() {
    let lqr = HybridLqr::new(RodDesign::default(), Weights::default()).unwrap();
    let rows: Vec<Vec<f32>> =
        (0..5).map(|i| observation(&[2.0 + 0.4 * i as f64; 6], &[0.1 * i as f64; 6])).collect();
    let mut state = vec![0.5; 5];
    let mut actions = vec![0.0; 5];
    lqr.predict(&rows.concat(), &mut state, &[false; 5], &mut actions).unwrap();
    for (row, action) in rows.iter().zip(&actions) {
        let (mut s, mut a) = ([0.5], [0.0]);
        lqr.predict(row, &mut s, &[false], &mut a).unwrap();
        assert_eq!(a[0], *action);
        assert!(a[0].abs() <= 1.0);
    }
    let message = lqr.predict(&rows[0][..17], &mut state[..1], &[false], &mut actions[..1]);
    assert!(message.unwrap_err().to_string().contains("observation has shape (17,)"));
    let mut nan = rows[0].clone();
    nan[3] = f32::NAN;
    assert!(lqr.predict(&nan, &mut state[..1], &[false], &mut actions[..1]).is_err());
    assert_eq!(state[0], 0.51);
}

#[test]
fn rods_that_cannot_be_are_refused_by_name() {
    for (rod, name) in [
        (RodDesign { width: -1.0, ..RodDesign::default() }, "width"),
        (RodDesign { nodes: 1, ..RodDesign::default() }, "nodes"),
        (RodDesign { control_dt: f64::NAN, ..RodDesign::default() }, "control_dt"),
    ] {
        let message = HybridLqr::new(rod, Weights::default()).unwrap_err().to_string();
        assert!(message.starts_with(name), "{message}");
    }
}
