//! A fin driven periodically, and what one period of it yields: the measurements of chapter 3.

use super::geometry::Geometry;
use super::sim::BareFin;
use crate::error::Result;
use crate::simulation::Simulation;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Shape of a periodic pitch command, between -1 and 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Waveform {
    /// `sin`.
    Sine,
    /// `tanh(2 sin) / tanh 2`: the pitch lingers at its ends and crosses quickly.
    Square,
    /// `asin(0.98 sin) / asin 0.98`: constant rate between slightly rounded corners.
    Triangle,
}

impl Waveform {
    /// Every shape with the name that users type.
    pub const NAMES: [(&'static str, Waveform); 3] =
        [("sine", Waveform::Sine), ("square", Waveform::Square), ("triangle", Waveform::Triangle)];

    /// Value at a phase in radians.
    pub fn at(self, phase: f64) -> f64 {
        let sine = libm::sin(phase);
        match self {
            Waveform::Sine => sine,
            Waveform::Square => libm::tanh(2.0 * sine) / libm::tanh(2.0),
            Waveform::Triangle => libm::asin(0.98 * sine) / libm::asin(0.98),
        }
    }
}

/// A periodic pitch that sets in smoothly over its first period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Shape.
    pub waveform: Waveform,
    /// Amplitude \[rad\].
    pub amplitude: f64,
    /// Frequency \[Hz\].
    pub frequency: f64,
}

impl Drive {
    /// A sine of this amplitude \[degrees\] and frequency \[Hz\].
    pub fn sine(degrees: f64, frequency: f64) -> Self {
        Drive { waveform: Waveform::Sine, amplitude: degrees.to_radians(), frequency }
    }

    /// Pitch at time `t` \[rad\]; the ramp is `x^3 (10 - 15 x + 6 x^2)` of the first period.
    pub fn pitch(&self, t: f64) -> f64 {
        let x = (t * self.frequency).min(1.0);
        let ramp = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
        ramp * self.amplitude * self.waveform.at(TAU * self.frequency * t)
    }
}

/// Means over one period.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cycle {
    /// Mean thrust \[N\].
    pub thrust: f64,
    /// Resistive part of the mean thrust \[N\].
    pub resistive_thrust: f64,
    /// Mean thrust felt by the mount \[N\].
    pub mount_thrust: f64,
    /// Mean power of the drive \[W\].
    pub power: f64,
    /// Froude efficiency `U thrust / power`.
    pub efficiency: f64,
    /// Largest torque of the drive \[N m\].
    pub peak_torque: f64,
    /// First Fourier coefficient of the tail's y over that of a rigid tail.
    pub tail_ratio: f64,
    /// How far the tail lags behind a rigid one \[degrees\].
    pub tail_lag: f64,
    /// Drive phase in \[0, 180) where the thrust's component at twice the drive frequency peaks \[degrees\].
    pub peak_phase: f64,
    /// Amplitude of that component \[N\].
    pub second_harmonic: f64,
    /// Peak-to-peak travel of the tail \[m\].
    pub wake_width: f64,
    /// Strouhal number `f W / U` (thesis 3.2); infinite in still water.
    pub strouhal: f64,
    /// Thrust coefficient `T / (rho U^2 L h / 2)` (thesis 3.2).
    pub thrust_coefficient: f64,
    /// Thrust at each step of the period \[N\].
    pub thrust_trace: Vec<f64>,
    /// y of the tail at each step of the period \[m\].
    pub tail_trace: Vec<f64>,
}

/// Drives a fin for `periods` periods of `steps_per_period` steps and measures the last one. The fin's
/// physics step must be the period over the number of steps.
///
/// # Errors
/// A step that cannot be solved.
pub fn measure(
    fin: &mut BareFin,
    drive: &Drive,
    periods: u32,
    steps_per_period: u32,
) -> Result<Cycle> {
    let dt = 1.0 / (drive.frequency * f64::from(steps_per_period));
    for step in 1..=(periods - 1) * steps_per_period {
        fin.step(drive.pitch(f64::from(step) * dt), 1)?;
    }
    let tail = fin.positions().len() - 1;
    let geometry: Geometry = fin.design().geometry.clone();
    let mut cycle = Cycle::default();
    let weight = 1.0 / f64::from(steps_per_period);
    let (mut tail1, mut rigid1, mut thrust2) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    let accumulate = |sum: &mut [f64; 2], value: f64, phase: f64| {
        sum[0] += 2.0 * weight * value * libm::cos(phase);
        sum[1] += 2.0 * weight * value * libm::sin(phase);
    };
    for step in 1..=steps_per_period {
        let t = f64::from((periods - 1) * steps_per_period + step) * dt;
        let pitch = drive.pitch(t);
        fin.step(pitch, 1)?;
        let phase = TAU * f64::from(step) * weight;
        let (loads, y) = (*fin.loads(), fin.positions()[tail][1]);
        cycle.thrust += weight * loads.thrust;
        cycle.resistive_thrust += weight * loads.resistive_thrust;
        cycle.mount_thrust += weight * loads.mount_thrust;
        cycle.power += weight * loads.power;
        cycle.peak_torque = cycle.peak_torque.max(loads.torque.abs());
        accumulate(&mut tail1, y, phase);
        accumulate(&mut rigid1, geometry.tail_length() * libm::sin(pitch), phase);
        accumulate(&mut thrust2, loads.thrust, 2.0 * phase);
        cycle.thrust_trace.push(loads.thrust);
        cycle.tail_trace.push(y);
    }
    let angle = |c: [f64; 2]| libm::atan2(c[1], c[0]);
    cycle.tail_ratio = libm::hypot(tail1[0], tail1[1]) / libm::hypot(rigid1[0], rigid1[1]);
    // c - i s is the coefficient: its angle is minus atan2(s, c), so a lag is a larger atan2.
    cycle.tail_lag = wrap(angle(tail1) - angle(rigid1)).to_degrees();
    cycle.second_harmonic = libm::hypot(thrust2[0], thrust2[1]);
    cycle.peak_phase = (0.5 * angle(thrust2).to_degrees()).rem_euclid(180.0);
    let bound =
        |pick: fn(f64, f64) -> f64, start: f64| cycle.tail_trace.iter().copied().fold(start, pick);
    cycle.wake_width = bound(f64::max, f64::NEG_INFINITY) - bound(f64::min, f64::INFINITY);
    let flow = fin.material().flow_speed;
    cycle.efficiency = flow * cycle.thrust / cycle.power;
    cycle.strouhal = drive.frequency * cycle.wake_width / flow;
    cycle.thrust_coefficient = thrust_coefficient(cycle.thrust, flow, &geometry);
    Ok(cycle)
}

/// `T / (rho U^2 L h / 2)` (thesis 3.2).
pub fn thrust_coefficient(thrust: f64, flow_speed: f64, geometry: &Geometry) -> f64 {
    let pressure = 0.5 * super::parameters::WATER_DENSITY * flow_speed * flow_speed;
    thrust / (pressure * geometry.length() * geometry.height)
}

/// An angle in \[-pi, pi).
fn wrap(angle: f64) -> f64 {
    (angle + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU
}
