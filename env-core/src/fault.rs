//! A panic as a value: what happened, and where.
//!
//! A panic is a fault of ours, whoever called. Whoever stands at a border (the bindings, the server, a pool of
//! threads) calls what is behind it through `caught`, and tells of the fault in its own way.

use std::any::Any;
use std::cell::Cell;
use std::fmt;
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::sync::Once;

/// A panic that was caught.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// What was said.
    pub what: String,
    /// File, line and column.
    pub place: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (at {})", self.what, self.place)
    }
}

thread_local! {
    /// Where this thread panicked last.
    static PLACE: Cell<Option<String>> = const { Cell::new(None) };
}

/// Does the work; a panic in it comes back as a `Fault`. What the work was changing may be half changed then.
///
/// # Errors
/// The work panicked.
pub fn caught<T>(work: impl FnOnce() -> T) -> Result<T, Fault> {
    note_places();
    catch_unwind(AssertUnwindSafe(work)).map_err(fault_of)
}

/// Only the hook is told where a panic happens; the one before it still says it in its way.
fn note_places() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            PLACE.set(info.location().map(ToString::to_string));
            before(info);
        }));
    });
}

fn fault_of(payload: Box<dyn Any + Send>) -> Fault {
    // One that was caught in another thread and carried here knows better.
    let payload = match payload.downcast::<Fault>() {
        Ok(fault) => return *fault,
        Err(payload) => payload,
    };
    let what = match (payload.downcast_ref::<&str>(), payload.downcast_ref::<String>()) {
        (Some(text), _) => (*text).to_owned(),
        (_, Some(text)) => text.clone(),
        _ => "a panic without words".into(),
    };
    Fault { what, place: PLACE.take().unwrap_or_else(|| "an unknown place".into()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::resume_unwind;

    #[test]
    fn a_panic_comes_back_with_its_words_and_its_place() {
        let (line, fault) = (line!(), caught(|| -> u8 { panic!("number {}", 7) }).unwrap_err());
        assert_eq!(fault.what, "number 7");
        assert!(fault.place.starts_with(&format!("{}:{line}:", file!())), "{fault}");
        let fault = caught(|| [1, 2, 3].get(5).expect("five")).unwrap_err();
        assert_eq!(fault.what, "five");
        assert_eq!(caught(|| 3), Ok(3));
    }

    #[test]
    fn a_fault_that_another_thread_caught_keeps_its_place() {
        let there = std::thread::spawn(|| caught(|| panic!("there")).unwrap_err());
        let fault: Fault = there.join().expect("caught");
        let carried = fault.clone();
        assert_eq!(caught(|| resume_unwind(Box::new(carried))).unwrap_err(), fault);
    }
}
