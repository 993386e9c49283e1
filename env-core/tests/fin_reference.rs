//! The fin against an independent program (`tests/data/fin`): the same model, written apart in numpy, with
//! its own assembly and, where said, a different integrator.

use nalgebra::{DMatrix, SymmetricEigen};
use rodgym_core::fin::Design;
use rodgym_core::fin::Scheme;
use rodgym_core::fin::cycle::{Cycle, Drive, Waveform, measure};
use rodgym_core::fin::servo::{Servo, Ticks};
use rodgym_core::fin::{BareFin, Geometry, Parameters};
use rodgym_core::fluid::Hydrodynamics;
use rodgym_core::simulation::Simulation;
use std::collections::HashMap;

type Row = HashMap<String, String>;

/// Rows of a reference table, by column name.
fn table(name: &str) -> Vec<Row> {
    let path = format!("{}/../tests/data/fin/{name}.csv", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let head: Vec<&str> = lines.next().expect("a head line").split(',').collect();
    let row = |line: &str| {
        // One model's name holds a comma.
        let line = line.replace("nodes, edge", "nodes edge");
        let cells = head.iter().zip(line.split(','));
        cells.map(|(k, v)| (k.to_string(), v.to_string())).collect()
    };
    lines.map(row).collect()
}

fn number(row: &Row, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|e| panic!("{column} = {:?}: {e}", row[column]))
}

/// Asserts a relative difference, measured against at least `scale`.
fn close(what: &str, ours: f64, theirs: f64, scale: f64, tolerance: f64) {
    let error = (ours - theirs).abs() / theirs.abs().max(scale);
    assert!(error <= tolerance, "{what}: {ours} against {theirs}, off by {error:.2e}");
}

fn run(
    hydrodynamics: Hydrodynamics,
    scheme: Scheme,
    parameters: Parameters,
    drive: Drive,
    periods: u32,
    steps: u32,
) -> Cycle {
    let design = Design {
        geometry: Geometry::thesis(),
        hydrodynamics,
        scheme,
        physics_dt: 1.0 / (drive.frequency * f64::from(steps)),
        free_swimming: false,
    };
    let mut fin = BareFin::new(design, parameters).expect("thesis values are allowed");
    measure(&mut fin, &drive, periods, steps).expect("the reference grid has no failures")
}

fn thesis(youngs_modulus: f64) -> Parameters {
    Parameters { youngs_modulus, ..Parameters::thesis() }
}

/// With the same first-order stepper at the same step only the Newton tolerances differ: every printed digit.
#[test]
fn sensitivities_agree_to_the_printed_digits() {
    for row in table("sensitivity_A10_f1p5") {
        let mut parameters = thesis(number(&row, "E_Pa"));
        if let Some((name, value)) = row["case"].split_once('=') {
            let value: f64 = value.parse().expect("a number");
            match name {
                "zeta" => parameters.damping = value,
                "Cd" => parameters.drag_coefficient = value,
                "Cf" => parameters.friction_coefficient = value,
                "Cm" => parameters.added_mass_coefficient = value,
                "rho_s" => parameters.density = value,
                "U" => parameters.flow_speed = value,
                other => panic!("unknown case {other}"),
            }
        }
        let scheme = Scheme::BackwardEuler;
        let drive = Drive::sine(10.0, 1.5);
        let cycle = run(Hydrodynamics::Lighthill, scheme, parameters, drive, 5, 400);
        for (ours, column, scale) in [
            (cycle.thrust, "T_mean_N", 1e-3),
            (cycle.resistive_thrust, "T_resistive_N", 1e-3),
            (cycle.power, "P_in_W", 1e-3),
            (cycle.tail_ratio, "tail_ratio", 1.0),
            (cycle.tail_lag, "tail_lag_deg", 1.0),
            (cycle.peak_phase, "peak_phase_deg", 1.0),
            (cycle.second_harmonic, "T_2f_amp_N", 1e-3),
        ] {
            let what = format!("{} E={} {column}", row["case"], row["E_Pa"]);
            close(&what, ours, number(&row, column), scale, 1e-6);
        }
    }
}

const GRIDS: [(&str, Hydrodynamics); 3] = [
    ("flex_grid_ilm", Hydrodynamics::Lighthill),
    ("flex_grid_morison", Hydrodynamics::Morison),
    ("flex_grid_resistive", Hydrodynamics::Resistive),
];

/// Rows of the grids in which the reference's extrapolation has not converged: the soft fin near its resonance, with
/// added mass but nothing shed at the tail, so that a transient is left in the fifth period.
fn rings(model: Hydrodynamics, row: &Row) -> bool {
    let soft = number(row, "E_Pa") < 3e5;
    model == Hydrodynamics::Morison && soft && number(row, "f_Hz") >= 1.5
}

/// The flexible grids of all models of the water: the second-order stepper against the Richardson extrapolation
/// of their first-order results. Thrust is measured against 1 mN at least: at 0.5 Hz and 4 degrees it nearly vanishes.
/// The eight rows that `rings` names have a better reference, below.
#[test]
fn flexible_grids_agree_with_the_extrapolated_reference() {
    for (name, model) in GRIDS {
        for row in table(name).iter().filter(|row| !rings(model, row)) {
            let (e, frequency) = (number(row, "E_Pa"), number(row, "f_Hz"));
            let drive = Drive::sine(number(row, "A_deg"), frequency);
            let cycle = run(model, Scheme::Bdf2, thesis(e), drive, 5, 400);
            let what = format!("{name} E={e} A={} f={frequency}", row["A_deg"]);
            close(&what, cycle.thrust, number(row, "T_x_N"), 1e-3, 5e-3);
            close(&what, cycle.power, number(row, "P_x_W"), 1e-4, 5e-3);
            close(&what, cycle.efficiency, number(row, "eff_x"), 0.1, 5e-3);
        }
    }
}

/// The eight rows left out above: the second-order stepper against the same equations integrated to
/// convergence by an explicit method of order eight (`tests/long/fin_converged.py`).
#[test]
fn soft_fins_without_tail_flux_agree_with_a_converged_integration() {
    let rows = table("morison_soft");
    assert_eq!(rows.len(), 8);
    for row in rows {
        let drive = Drive::sine(number(&row, "A_deg"), number(&row, "f_Hz"));
        let cycle = run(Hydrodynamics::Morison, Scheme::Bdf2, thesis(2.5e5), drive, 5, 1600);
        let what = format!("A={} f={}", row["A_deg"], row["f_Hz"]);
        close(&what, cycle.thrust, number(&row, "T_mean_N"), 0.0, 5e-3);
        close(&what, cycle.power, number(&row, "P_in_W"), 0.0, 1e-3);
    }
}

/// The reference by its own protocol, backward Euler: raw columns at 800 steps a period (tail, lag, phases too) to
/// the printed digits, and in every row its extrapolation from 400 and 800 steps, `2 z(800) - z(400)`.
#[test]
fn flexible_grids_agree_by_the_references_own_protocol() {
    for (name, model) in GRIDS {
        for row in &table(name) {
            let drive = Drive::sine(number(row, "A_deg"), number(row, "f_Hz"));
            let parameters = thesis(number(row, "E_Pa"));
            let euler = |steps| run(model, Scheme::BackwardEuler, parameters, drive, 5, steps);
            let (coarse, cycle) = (euler(400), euler(800));
            let extrapolated = |z: fn(&Cycle) -> f64| 2.0 * z(&cycle) - z(&coarse);
            let (thrust, power) = (extrapolated(|c| c.thrust), extrapolated(|c| c.power));
            for (ours, column, scale) in [
                (cycle.thrust, "T_mean_N", 1e-3),
                (cycle.resistive_thrust, "T_resistive_N", 1e-3),
                (cycle.power, "P_in_W", 1e-3),
                (cycle.efficiency, "efficiency", 1e-1),
                (cycle.tail_ratio, "tail_ratio", 1.0),
                (cycle.tail_lag, "tail_lag_deg", 1.0),
                (cycle.peak_phase, "peak_phase_deg", 1.0),
                (cycle.second_harmonic, "T_2f_amp_N", 1e-3),
                (thrust, "T_x_N", 1e-3),
                (power, "P_x_W", 1e-3),
                (0.05 * thrust / power, "eff_x", 1e-1),
            ] {
                let what = format!("{name} {row:?} {column}");
                close(&what, ours, number(row, column), scale, 1e-5);
            }
        }
    }
}

/// A rigid foil has a closed form; a fin a thousand times stiffer than the thesis' comes within 0.1 %.
#[test]
fn stiff_fin_agrees_with_the_closed_form_of_the_rigid_foil() {
    for row in table("rigid_grid") {
        let drive = Drive::sine(number(&row, "A_deg"), number(&row, "f_Hz"));
        let cycle = run(Hydrodynamics::Lighthill, Scheme::Bdf2, thesis(8e9), drive, 3, 800);
        let what = format!("A={} f={}", row["A_deg"], row["f_Hz"]);
        close(&what, cycle.thrust, number(&row, "T_mean_N"), 1e-3, 1e-3);
        close(&what, cycle.power, number(&row, "P_in_W"), 1e-3, 1e-3);
        close(&what, cycle.second_harmonic, number(&row, "T_2f_amp_N"), 1e-3, 1e-3);
        close(&what, cycle.peak_phase, number(&row, "peak_phase_deg"), 100.0, 1e-3);
        close(&what, cycle.strouhal, number(&row, "St"), 0.1, 1e-3);
        close(&what, cycle.thrust_coefficient, number(&row, "C_T"), 0.05, 1e-3);
    }
}

/// Lighthill's mean thrust of a stiff fin at small angles, without friction and drag: `m A^2 (L^2 w^2 - U^2)/4` with
/// the added mass m = C_m rho pi h^2/4 and L from pivot to tail (1960; 1971 for the sign of the wake's part).
#[test]
fn small_strokes_of_a_stiff_fin_give_lighthills_mean_thrust() {
    let pi = std::f64::consts::PI;
    let added_mass = 0.5 * 1000.0 * pi * 0.115 * 0.115 / 4.0;
    let inviscid = Parameters { friction_coefficient: 0.0, drag_coefficient: 0.0, ..thesis(8e9) };
    for (degrees, frequency) in [(1.0, 0.5), (1.0, 2.0), (2.0, 1.0)] {
        let drive = Drive::sine(degrees, frequency);
        let cycle = run(Hydrodynamics::Lighthill, Scheme::Bdf2, inviscid, drive, 3, 800);
        let (angle, rate) = (degrees * pi / 180.0, 2.0 * pi * frequency);
        let reach2 = 0.1 * 0.1 * rate * rate;
        let theory = 0.25 * added_mass * angle * angle * (reach2 - 0.05 * 0.05);
        close(&format!("{degrees} deg, {frequency} Hz"), cycle.thrust, theory, 1e-6, 2e-3);
    }
}

/// Orders of convergence of both steppers, and their errors, as the reference found against Radau.
#[test]
fn steppers_converge_at_first_and_second_order() {
    let radau = table("energy_budget_A10_f1p5");
    for budget in &radau {
        let e = number(budget, "E_Pa");
        let exact = number(budget, "T_N");
        for (scheme, order) in [(Scheme::BackwardEuler, 1.0), (Scheme::Bdf2, 2.0)] {
            let error = |steps| {
                let drive = Drive::sine(10.0, 1.5);
                let cycle = run(Hydrodynamics::Lighthill, scheme, thesis(e), drive, 5, steps);
                cycle.thrust / exact - 1.0
            };
            let (coarse, fine) = (error(100), error(200));
            let found = (coarse / fine).log2();
            assert!((found - order).abs() < 0.15, "{scheme:?} at E={e}: order {found}");
        }
    }
    for row in table("be_convergence_A10_f1p5") {
        let scheme = if row["order"] == "1" { Scheme::BackwardEuler } else { Scheme::Bdf2 };
        let steps = number(&row, "steps_per_period") as u32;
        let drive = Drive::sine(10.0, 1.5);
        let parameters = thesis(number(&row, "E_Pa"));
        let cycle = run(Hydrodynamics::Lighthill, scheme, parameters, drive, 5, steps);
        let what = format!("{scheme:?} E={} steps={steps}", row["E_Pa"]);
        close(&what, cycle.thrust, number(&row, "T_mean_N"), 1e-3, 1e-6);
    }
}

/// Other waveforms, other speeds of the water, wider and faster drives.
#[test]
fn waveforms_speeds_and_scans_agree() {
    let mut cases: Vec<(Row, Waveform, u32, u32)> = Vec::new();
    for row in table("waveforms") {
        let (_, waveform) =
            Waveform::NAMES.into_iter().find(|(n, _)| *n == row["waveform"]).expect("known shape");
        cases.push((row, waveform, 4, 400));
    }
    cases.extend(table("rl_scan_ilm").into_iter().map(|row| (row, Waveform::Sine, 5, 400)));
    cases.extend(table("speed_curve").into_iter().map(|row| (row, Waveform::Sine, 4, 300)));
    for (row, waveform, periods, steps) in cases {
        let drive = Drive { waveform, ..Drive::sine(number(&row, "A_deg"), number(&row, "f_Hz")) };
        let mut parameters = thesis(number(&row, "E_Pa"));
        if row.contains_key("U_m_s") {
            parameters.flow_speed = number(&row, "U_m_s");
        }
        let scheme = Scheme::BackwardEuler;
        let cycle = run(Hydrodynamics::Lighthill, scheme, parameters, drive, periods, steps);
        let what = format!("{row:?}");
        close(&what, cycle.thrust, number(&row, "T_mean_N"), 1e-3, 1e-5);
        close(&what, cycle.power, number(&row, "P_in_W"), 1e-3, 1e-5);
        for (column, ours) in
            [("peak_torque_Nm", cycle.peak_torque), ("tail_ratio", cycle.tail_ratio)]
        {
            if row.contains_key(column) {
                close(&what, ours, number(&row, column), 1e-3, 1e-5);
            }
        }
    }
}

/// A sampled sinusoid through the servo, over the smallest whole number of periods that is a whole number of
/// control steps too. The reference does not say its window: mean thrust and power to 1 %, where the window is
/// a multiple of that; the resonance of the stiff fin at 0.1 s takes long to settle, there power to 5 %.
#[test]
fn sampled_commands_through_the_servo_agree() {
    let dt = 1e-3;
    for row in table("servo_control_period") {
        let (hold, frequency) = (number(&row, "Tc_s"), number(&row, "f_Hz"));
        let amplitude = number(&row, "A_cmd_deg").to_radians();
        let design = Design {
            geometry: Geometry::thesis(),
            hydrodynamics: Hydrodynamics::Lighthill,
            scheme: Scheme::BackwardEuler,
            physics_dt: dt,
            free_swimming: false,
        };
        let mut fin = BareFin::new(design, thesis(number(&row, "E_Pa"))).expect("allowed");
        // The reference has no low-pass before its servo.
        let (mut servo, ticks) = (Servo::default(), Ticks::new(dt, None, 1.0));
        let (first, last) = if frequency == 2.0 { (3.0, 5.0) } else { (2.0, 5.0) };
        let window = (first / frequency / dt).round()..(last / frequency / dt).round();
        let (mut thrust, mut power, mut torque) = (0.0, 0.0, 0.0f64);
        for step in 0..window.end as u32 {
            let held = (f64::from(step) * dt / hold + 1e-9).floor() * hold;
            let x = (held * frequency).min(1.0);
            let ramp = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
            let sine = (std::f64::consts::TAU * frequency * held).sin();
            servo.advance(ramp * amplitude * sine, &ticks);
            fin.step(servo.angle, 1).expect("solved");
            if window.contains(&f64::from(step)) {
                let weight = 1.0 / (window.end - window.start);
                thrust += weight * fin.loads().thrust;
                power += weight * fin.loads().power;
                torque = torque.max(fin.loads().torque.abs());
            }
        }
        let what = format!("{row:?}");
        let resonates = hold == 0.1 && frequency == 1.5;
        close(&what, thrust, number(&row, "T_mean_N"), 1e-3, 1e-2);
        close(&what, power, number(&row, "P_in_W"), 1e-3, if resonates { 5e-2 } else { 1e-2 });
        close(&what, torque, number(&row, "peak_torque_Nm"), 1e-3, 1e-2);
    }
}

#[test]
fn geometry_is_that_of_table_3_1() {
    let geometry = Geometry::thesis();
    let rod = geometry.rod(&thesis(8.1112e6));
    let edges: Vec<_> = geometry.edge_areas().collect();
    let perimeters: Vec<_> = geometry.perimeters().collect();
    let moments: Vec<_> = geometry.second_moments().collect();
    for (i, row) in table("geometry").iter().enumerate() {
        close("width", geometry.widths[i], number(row, "width_m"), 1e-3, 1e-12);
        close("area", geometry.areas[i], number(row, "area_node_m2"), 1e-4, 1e-12);
        close("I", moments[i], number(row, "I_node_m4"), 1e-10, 1e-8);
        close("EI", rod.bend[i] * geometry.edge_length, number(row, "EI_Nm2"), 1e-3, 1e-8);
        close("mass", rod.mass[i], number(row, "mass_node_kg"), 1e-3, 1e-9);
        if i < edges.len() {
            close("edge area", edges[i], number(row, "area_edge_m2"), 1e-4, 1e-12);
            close("perimeter", perimeters[i], number(row, "perim_edge_m"), 1e-2, 1e-12);
        }
    }
}

/// Natural frequencies \[Hz\] of the sideways motion of the nodes from `first` on, the others held.
fn frequencies(
    parts: usize,
    youngs_modulus: f64,
    wet: bool,
    free: std::ops::Range<usize>,
) -> Vec<f64> {
    let geometry = Geometry::thesis().refined(parts).expect("1 or more");
    let parameters =
        Parameters { youngs_modulus, damping: 0.0, flow_speed: 0.0, ..Parameters::default() };
    let mass = geometry.rod(&parameters).mass;
    let (n, edge, pivot) = (geometry.nodes(), geometry.edge_length, geometry.pivot);
    let design = Design {
        geometry,
        hydrodynamics: Hydrodynamics::Lighthill,
        scheme: Scheme::Bdf2,
        physics_dt: 1e-3,
        free_swimming: false,
    };
    let fin = BareFin::new(design, parameters).expect("allowed");
    let straight: Vec<[f64; 2]> = (0..n).map(|i| [edge * (i as f64 - pivot as f64), 0.0]).collect();
    let still = vec![[0.0; 2]; n];
    let size = free.len();
    let (mut k, mut m) = (DMatrix::zeros(size, size), DMatrix::zeros(size, size));
    for (column, j) in free.clone().enumerate() {
        let moved = |step: f64| {
            let mut x = straight.clone();
            x[j][1] = step;
            fin.forces(&x, &still).expect("finite").elastic
        };
        let (above, below) = (moved(1e-6), moved(-1e-6));
        let mut unit = still.clone();
        unit[j][1] = 1.0;
        let momentum = fin.forces(&straight, &unit).expect("finite").fluid_momentum;
        for (row, i) in free.clone().enumerate() {
            k[(row, column)] = -(above[i][1] - below[i][1]) / 2e-6;
            m[(row, column)] = if i == j { mass[i] } else { 0.0 };
            if wet {
                m[(row, column)] += momentum[i][1];
            }
        }
    }
    let lower = m.cholesky().expect("masses are positive").l();
    let inverse = lower.try_inverse().expect("regular");
    let values = SymmetricEigen::new(&inverse * k * inverse.transpose()).eigenvalues;
    let mut found: Vec<f64> = values.iter().map(|v| v.sqrt() / std::f64::consts::TAU).collect();
    found.sort_by(f64::total_cmp);
    found
}

/// Rod, masses and added mass at once: natural frequencies, dry and in water, to 0.1 %.
#[test]
fn natural_frequencies_agree() {
    let mut compared = 0;
    for row in table("natural_freqs") {
        let wet = row["medium"] == "water";
        let e = number(&row, "E_Pa");
        let found = match row["model"].as_str() {
            "PDER front (nodes 1-2)" => frequencies(1, e, wet, 0..2),
            name if name.contains("PDER tail nodes") => {
                let edge = name.split("edge ").nth(1).expect("an edge length");
                let parts =
                    (20.0 / edge.trim_end_matches(" mm").parse::<f64>().expect("mm")) as usize;
                frequencies(parts, e, wet, 3 * parts + 1..7 * parts + 1)
            }
            _ => continue,
        };
        for (mode, column) in ["f1_Hz", "f2_Hz", "f3_Hz", "f4_Hz"].into_iter().enumerate() {
            let theirs = number(&row, column);
            if theirs.is_finite() {
                close(&format!("{row:?} {column}"), found[mode], theirs, 1e-3, 1e-3);
                compared += 1;
            }
        }
    }
    assert!(compared >= 36, "only {compared} frequencies were compared");
}

/// Where the servo's power goes: with the second-order stepper at a small step the budget closes to 0.5 %, and
/// every item is the reference's.
#[test]
fn energy_budget_closes() {
    for row in table("energy_budget_A10_f1p5") {
        let drive = Drive::sine(10.0, 1.5);
        let steps = 1600;
        let design = Design {
            geometry: Geometry::thesis(),
            hydrodynamics: Hydrodynamics::Lighthill,
            scheme: Scheme::Bdf2,
            physics_dt: 1.0 / (1.5 * f64::from(steps)),
            free_swimming: false,
        };
        let parameters = thesis(number(&row, "E_Pa"));
        let flow = parameters.flow_speed;
        let mut fin = BareFin::new(design, parameters).expect("allowed");
        let mass = Geometry::thesis().water(&parameters).added_mass;
        let (mut power, mut thrust, mut wake, mut resistive, mut zeta) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for step in 1..=5 * steps {
            fin.step(drive.pitch(f64::from(step) * fin.design().physics_dt), 1).expect("solved");
            if step <= 4 * steps {
                continue;
            }
            let (x, v) = (fin.positions(), fin.velocities());
            let forces = fin.forces(&x, &v).expect("finite");
            let weight = 1.0 / f64::from(steps);
            power += weight * fin.loads().power;
            thrust += weight * fin.loads().thrust;
            let e = [x[7][0] - x[6][0], x[7][1] - x[6][1]];
            let (l, r) = (e[0].hypot(e[1]), [v[7][0] - flow, v[7][1]]);
            let (u, w) = ((r[0] * e[0] + r[1] * e[1]) / l, (r[1] * e[0] - r[0] * e[1]) / l);
            wake -= weight * 0.5 * mass * u * w * w;
            for (f, v) in forces.resistive.iter().zip(&v) {
                resistive -= weight * (f[0] * (v[0] - flow) + f[1] * v[1]);
                zeta += weight * parameters.damping * (v[0] * v[0] + v[1] * v[1]);
            }
        }
        for (ours, column) in [
            (power, "P_in_W"),
            (flow * thrust, "T_times_U_W"),
            (wake, "wake_W"),
            (resistive, "resistive_W"),
            (zeta, "zeta_W"),
            (thrust, "T_N"),
        ] {
            close(column, ours, number(&row, column), 1e-4, 5e-3);
        }
        let spent = flow * thrust + wake + resistive + zeta;
        close("budget", spent, power, 1e-3, 5e-3);
    }
}
