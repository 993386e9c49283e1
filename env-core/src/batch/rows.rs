//! The rows that each block writes of a step's results.

use crate::env::{Spec, StepData};
use std::marker::PhantomData;
use std::slice::from_raw_parts_mut;

/// A `StepData` that can be handed out in parts.
pub struct Rows<'a> {
    observation: *mut f32,
    reward: *mut f64,
    terminated: *mut bool,
    truncated: *mut bool,
    final_observation: *mut f32,
    terms: *mut f64,
    parameters: *mut f64,
    stepped: *mut bool,
    began: *mut bool,
    solver_failure: *mut bool,
    /// Columns of observation, terms and parameters.
    sizes: [usize; 3],
    borrowed: PhantomData<&'a mut f64>,
}

// SAFETY: the pointers are used through `of` alone, whose caller keeps parts apart.
unsafe impl Sync for Rows<'_> {}

impl<'a> Rows<'a> {
    /// All rows; lengths are taken as checked.
    pub fn new(spec: &Spec, out: &'a mut StepData<'_>) -> Self {
        Rows {
            observation: out.observation.as_mut_ptr(),
            reward: out.reward.as_mut_ptr(),
            terminated: out.terminated.as_mut_ptr(),
            truncated: out.truncated.as_mut_ptr(),
            final_observation: out.final_observation.as_mut_ptr(),
            terms: out.terms.as_mut_ptr(),
            parameters: out.parameters.as_mut_ptr(),
            stepped: out.stepped.as_mut_ptr(),
            began: out.began.as_mut_ptr(),
            solver_failure: out.solver_failure.as_mut_ptr(),
            sizes: [
                spec.observation.size(),
                spec.reward_terms.len() + spec.metrics.len(),
                spec.parameters.len(),
            ],
            borrowed: PhantomData,
        }
    }

    /// Rows `first..first + count`.
    ///
    /// # Safety
    /// The rows exist, and no two parts that live at the same time share a row.
    pub unsafe fn of(&self, first: usize, count: usize) -> StepData<'a> {
        unsafe fn part<'a, T>(all: *mut T, first: usize, count: usize, size: usize) -> &'a mut [T] {
            // SAFETY: as the caller of `of` promises.
            unsafe { from_raw_parts_mut(all.add(first * size), count * size) }
        }
        let [d, k, p] = self.sizes;
        // SAFETY: as the caller promises.
        unsafe {
            StepData {
                observation: part(self.observation, first, count, d),
                reward: part(self.reward, first, count, 1),
                terminated: part(self.terminated, first, count, 1),
                truncated: part(self.truncated, first, count, 1),
                final_observation: part(self.final_observation, first, count, d),
                terms: part(self.terms, first, count, k),
                parameters: part(self.parameters, first, count, p),
                stepped: part(self.stepped, first, count, 1),
                began: part(self.began, first, count, 1),
                solver_failure: part(self.solver_failure, first, count, 1),
            }
        }
    }
}
