//! The results of a step or reset of many environments: one list of their fields, from which everything that
//! holds, lends, checks or cuts them into rows is made.

use crate::error::{Error, Result};
use crate::spec::Spec;
use std::marker::PhantomData;
use std::slice::from_raw_parts_mut;

/// Numbers of one environment in a field: one, those of an observation, reward terms and metrics, or parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "named above")]
pub struct Widths {
    pub one: usize,
    pub observation: usize,
    pub terms: usize,
    pub parameters: usize,
}

impl Widths {
    /// Those of a kind of environment.
    pub fn of(spec: &Spec) -> Self {
        Widths {
            one: 1,
            observation: spec.observation.size(),
            terms: spec.reward_terms.len() + spec.metrics.len(),
            parameters: spec.parameters.len(),
        }
    }
}

/// The one list of the fields: calls the macro `$with` with `name: element, width;` for each, in order.
#[macro_export]
macro_rules! step_fields {
    ($with:ident) => {
        $with! {
            /// (n, d) observations.
            observation: f32, observation;
            /// (n) rewards.
            reward: f64, one;
            /// (n) episode ended by the task.
            terminated: bool, one;
            /// (n) episode cut by the time limit or by a solver failure.
            truncated: bool, one;
            /// (n, d) last observations, written only where an episode ended in `SameStep` mode.
            final_observation: f32, observation;
            /// (n, k) reward terms, then metrics; written where a step was taken.
            terms: f64, terms;
            /// (n, p) parameters of the episode; written where an episode began.
            parameters: f64, parameters;
            /// (n) set where a step was taken.
            stepped: bool, one;
            /// (n) set where an episode began.
            began: bool, one;
            /// (n) set where the solver gave up.
            solver_failure: bool, one;
        }
    };
}

macro_rules! results {
    ($($(#[$doc:meta])* $field:ident: $element:ty, $width:ident;)*) => {
        /// Row-major results of a step or reset for `n` environments; the caller owns the memory.
        ///
        /// Sizes: d = observation, k = reward terms + metrics, p = parameters.
        pub struct StepData<'a> {
            $($(#[$doc])* pub $field: &'a mut [$element],)*
        }

        /// The same results, owning their memory.
        #[derive(Clone, Debug, Default)]
        pub struct StepBuffer {
            $($(#[$doc])* pub $field: Vec<$element>,)*
        }

        impl StepBuffer {
            /// Memory for `n` environments of this kind.
            pub fn new(spec: &Spec, n: usize) -> Self {
                let widths = Widths::of(spec);
                StepBuffer { $($field: vec![<$element>::default(); n * widths.$width],)* }
            }

            /// Borrows all of it for a step.
            pub fn data(&mut self) -> StepData<'_> {
                StepData { $($field: &mut self.$field,)* }
            }
        }

        impl StepData<'_> {
            /// Refuses memory that is not for `n` environments.
            ///
            /// # Errors
            /// Names the first field of another length.
            pub fn check(&self, widths: Widths, n: usize) -> Result<()> {
                $(check_length(stringify!($field), self.$field.len(), n * widths.$width)?;)*
                Ok(())
            }
        }

        /// A `StepData` that can be handed out in parts.
        pub(crate) struct Rows<'a> {
            $($field: *mut $element,)*
            widths: Widths,
            borrowed: PhantomData<&'a mut f64>,
        }

        impl<'a> Rows<'a> {
            /// All rows; lengths are taken as checked.
            pub(crate) fn new(widths: Widths, out: &'a mut StepData<'_>) -> Self {
                Rows { $($field: out.$field.as_mut_ptr(),)* widths, borrowed: PhantomData }
            }

            /// Rows `first..first + count`.
            ///
            /// # Safety
            /// The rows exist, and no two parts that live at the same time share a row.
            pub(crate) unsafe fn of(&self, first: usize, count: usize) -> StepData<'a> {
                // SAFETY: as the caller promises.
                unsafe {
                    StepData { $($field: part(self.$field, first, count, self.widths.$width),)* }
                }
            }
        }
    };
}
step_fields!(results);

// SAFETY: the pointers are used through `of` alone, whose caller keeps parts apart.
unsafe impl Sync for Rows<'_> {}

unsafe fn part<'a, T>(all: *mut T, first: usize, count: usize, width: usize) -> &'a mut [T] {
    // SAFETY: as the caller of `Rows::of` promises.
    unsafe { from_raw_parts_mut(all.add(first * width), count * width) }
}

/// Refuses an array of another length.
pub(crate) fn check_length(name: &str, got: usize, expected: usize) -> Result<()> {
    if got == expected {
        return Ok(());
    }
    Err(Error::Shape {
        name: name.into(),
        got: format!("({got},)"),
        expected: format!("({expected},)"),
    })
}
