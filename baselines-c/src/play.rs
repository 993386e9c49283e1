//! A controller at work: nothing here takes memory.

use crate::border::{Status, array, array_mut, guarded, one, place, refuse};
use crate::design::Handle;
use rodgym_baselines::Controller;
use rodgym_core::pendulum::{RATE_BOUND, RATE_UNIT};
use std::ffi::c_char;
use std::ptr;

/// An estimate with its interval; `rodgym_quantity` of the header.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    /// Best value.
    pub value: f64,
    /// Lower end of the interval that holds the truth in nine of ten cases.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Refuses an observation that the law cannot take.
fn readable(law: &dyn Controller, observation: &[f32]) -> Result<(), Status> {
    match law.unreadable(observation) {
        None => Ok(()),
        Some(i) => {
            let x = observation[i];
            let sentence = format_args!("observation[{i}] = {x} is not allowed: it must be finite");
            Err(refuse(Status::Observation, sentence))
        }
    }
}

/// Begins an episode. See the header.
///
/// # Safety
/// `controller` is one of ours; `observation` and `state` point to as many numbers as is said, and do not overlap.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_start(
    controller: *const Handle,
    observation: *const f32,
    observation_size: usize,
    state: *mut f64,
    state_size: usize,
) -> Status {
    // SAFETY: our caller's promises.
    guarded(|| unsafe {
        let law = &*one("controller", controller)?.saved.law;
        let (d, s) = (law.observation_size(), law.state_size());
        let observation = array("observation", observation, observation_size, d)?;
        let state = array_mut("state", state, state_size, s)?;
        readable(law, observation)?;
        law.start(observation, state);
        Ok(())
    })
}

/// One control period. See the header.
///
/// # Safety
/// `controller` is one of ours; the arrays point to as many numbers as is said, and do not overlap.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_step(
    controller: *const Handle,
    observation: *const f32,
    observation_size: usize,
    state: *mut f64,
    state_size: usize,
    action: *mut f32,
    action_size: usize,
) -> Status {
    // SAFETY: our caller's promises.
    guarded(|| unsafe {
        let law = &*one("controller", controller)?.saved.law;
        let (d, s, a) = (law.observation_size(), law.state_size(), law.action_size());
        let observation = array("observation", observation, observation_size, d)?;
        let state = array_mut("state", state, state_size, s)?;
        let action = array_mut("action", action, action_size, a)?;
        readable(law, observation)?;
        law.act(observation, state, action);
        Ok(())
    })
}

/// What a state says of a parameter of the machine. See the header.
///
/// # Safety
/// `controller` is one of ours; `state` points to as many numbers as is said, `quantity` to room for one; `name` and `unit`
/// are null or point to `text_size` bytes each. Nothing overlaps.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_estimate(
    controller: *const Handle,
    state: *const f64,
    state_size: usize,
    index: usize,
    quantity: *mut Quantity,
    name: *mut c_char,
    unit: *mut c_char,
    text_size: usize,
) -> Status {
    // SAFETY: our caller's promises.
    guarded(|| unsafe {
        let law = &*one("controller", controller)?.saved.law;
        let state = array("state", state, state_size, law.state_size())?;
        let quantity = place("quantity", quantity)?;
        let (mut count, mut found) = (0, None);
        law.estimate(state, &mut |told| {
            if count == index {
                found = Some(told);
            }
            count += 1;
        });
        let Some(told) = found else {
            let sentence = format_args!("index = {index} is not allowed: it must be below {count}");
            return Err(refuse(Status::Parameter, sentence));
        };
        *quantity = Quantity { value: told.value, low: told.low, high: told.high };
        for (text, to) in [(told.name, name), (told.unit, unit)] {
            if to.is_null() {
                continue;
            }
            if text.len() >= text_size {
                let sentence = format_args!("\"{text}\" does not fit into {text_size} bytes");
                return Err(refuse(Status::Size, sentence));
            }
            ptr::copy_nonoverlapping(text.as_ptr().cast(), to, text.len());
            *to.add(text.len()) = 0;
        }
        Ok(())
    })
}

/// The observation of a pendulum's controller. See the header.
///
/// # Safety
/// The arrays point to as many numbers as is said, and do not overlap.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_observe(
    angles: *const f64,
    rates: *const f64,
    edges: usize,
    observation: *mut f32,
    observation_size: usize,
) -> Status {
    // SAFETY: our caller's promises.
    guarded(|| unsafe {
        let angles = array("angles", angles, edges, edges)?;
        let rates = array("rates", rates, edges, edges)?;
        let observation =
            array_mut("observation", observation, observation_size, edges.saturating_mul(3))?;
        for (i, (angle, rate)) in angles.iter().zip(rates).enumerate() {
            let (sin, cos) = libm::sincos(*angle);
            // (A NaN stays one: a lost sample.)
            let rate = (rate * (1.0 / RATE_UNIT)).clamp(-RATE_BOUND, RATE_BOUND);
            observation[i] = cos as f32;
            observation[edges + i] = sin as f32;
            observation[2 * edges + i] = rate as f32;
        }
        Ok(())
    })
}
