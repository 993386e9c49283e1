//! Long computations that somebody may stop.

use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that a long computation looks at from time to time. Once it is set, the computation ends soon, with a state
/// that means nothing: whoever sets it puts back what was there before.
#[derive(Clone, Copy, Debug)]
pub struct Watch<'a>(&'a AtomicBool);

impl<'a> Watch<'a> {
    /// Ends what looks at it once the flag is set.
    pub fn new(stop: &'a AtomicBool) -> Self {
        Watch(stop)
    }

    /// Nobody stops it.
    pub fn nobody() -> Watch<'static> {
        static NEVER: AtomicBool = AtomicBool::new(false);
        Watch(&NEVER)
    }

    /// Whether to end.
    #[inline(always)]
    pub fn stops(self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
