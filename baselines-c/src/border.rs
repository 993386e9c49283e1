//! What stands between C and Rust: codes, the sentence of the last refusal, pointers that become slices.

use rodgym_baselines::Error;
use rodgym_core::fault;
use std::cell::RefCell;
use std::ffi::{CStr, c_char};
use std::fmt::{self, Write};

/// What became of a call; `rodgym_status` of the header.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Done.
    Ok = 0,
    /// A pointer is null or not aligned to its numbers.
    Pointer = 1,
    /// An array has another length than the controller needs.
    Size = 2,
    /// A name or a value that is not allowed.
    Parameter = 3,
    /// Bytes that are no saved controller of this version, or a file that cannot be read.
    File = 4,
    /// The design has no solution.
    Design = 5,
    /// An observation holds infinity, or a NaN that is no lost sample to this controller.
    Observation = 6,
    /// A fault of the library itself.
    Fault = 7,
}

/// Bytes of the longest sentence, its closing zero included.
const LONGEST: usize = 512;

thread_local! {
    /// Why this thread's last call was refused. (Of fixed length, so that a refusal takes no memory.)
    static SENTENCE: RefCell<Sentence> = const { RefCell::new(Sentence { bytes: [0; LONGEST], used: 0 }) };
}

/// Text that ends where there is no more room.
struct Sentence {
    bytes: [u8; LONGEST],
    used: usize,
}

impl Write for Sentence {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for character in text.chars().filter(|character| *character != '\0') {
            // (The last byte stays zero.)
            if self.used + character.len_utf8() >= LONGEST {
                break;
            }
            self.used += character.encode_utf8(&mut self.bytes[self.used..]).len();
        }
        Ok(())
    }
}

/// Keeps the sentence of a refusal, and gives its code back.
pub(crate) fn refuse(status: Status, sentence: fmt::Arguments<'_>) -> Status {
    SENTENCE.with_borrow_mut(|kept| {
        kept.bytes = [0; LONGEST];
        kept.used = 0;
        // A sentence that is too long ends early; there is no other way to fail.
        let _ = kept.write_fmt(sentence);
    });
    status
}

/// An error of the controllers, with its code.
pub(crate) fn refused(error: &Error) -> Status {
    let status = match error {
        Error::Saved { .. } => Status::File,
        Error::NoSolution { .. } | Error::Inaccurate { .. } => Status::Design,
        Error::Shape { .. } => Status::Size,
        Error::Parameter { .. } | Error::Unsuitable { .. } | Error::Core(_) => Status::Parameter,
    };
    refuse(status, format_args!("{error}"))
}

/// Does the work of a call; a panic in it is a code and a sentence.
pub(crate) fn guarded(work: impl FnOnce() -> Result<(), Status>) -> Status {
    match fault::caught(work) {
        Ok(Ok(())) => Status::Ok,
        Ok(Err(status)) => status,
        Err(fault) => {
            let version = env!("CARGO_PKG_VERSION");
            refuse(Status::Fault, format_args!("a fault of rodgym {version} itself: {fault}"))
        }
    }
}

/// Refuses a pointer that no array can be at.
fn usable<T>(name: &str, pointer: *const T) -> Result<(), Status> {
    if pointer.is_null() {
        return Err(refuse(Status::Pointer, format_args!("{name} is a null pointer")));
    }
    if !pointer.is_aligned() {
        let to = align_of::<T>();
        let sentence = format_args!("{name} is at {pointer:p}, which is no multiple of {to}");
        return Err(refuse(Status::Pointer, sentence));
    }
    Ok(())
}

/// A reference to what the caller's pointer points to.
///
/// # Safety
/// A pointer that is neither null nor unaligned points to a `T` that nobody writes while `'a` lasts.
pub(crate) unsafe fn one<'a, T>(name: &str, pointer: *const T) -> Result<&'a T, Status> {
    usable(name, pointer)?;
    // SAFETY: not null, aligned; the rest is our caller's promise.
    Ok(unsafe { &*pointer })
}

/// A place to write to.
///
/// # Safety
/// A pointer that is neither null nor unaligned points to room for a `T` that nobody else uses while `'a` lasts.
pub(crate) unsafe fn place<'a, T>(name: &str, pointer: *mut T) -> Result<&'a mut T, Status> {
    usable(name, pointer)?;
    // SAFETY: not null, aligned; the rest is our caller's promise.
    Ok(unsafe { &mut *pointer })
}

/// Refuses a length that is not the one that is needed.
fn fits(name: &str, size: usize, needed: usize) -> Result<(), Status> {
    if size == needed {
        return Ok(());
    }
    let sentence = format_args!("{name} has {size} numbers, but {needed} are needed");
    Err(refuse(Status::Size, sentence))
}

/// An array to read, of the length that is needed.
///
/// # Safety
/// A pointer that is neither null nor unaligned points to `size` numbers that nobody writes while `'a` lasts.
pub(crate) unsafe fn array<'a, T>(
    name: &str,
    pointer: *const T,
    size: usize,
    needed: usize,
) -> Result<&'a [T], Status> {
    fits(name, size, needed)?;
    if needed == 0 {
        return Ok(&[]);
    }
    usable(name, pointer)?;
    // SAFETY: not null, aligned; the rest is our caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(pointer, size) })
}

/// An array to write, of the length that is needed.
///
/// # Safety
/// A pointer that is neither null nor unaligned points to `size` numbers that nobody else uses while `'a` lasts.
pub(crate) unsafe fn array_mut<'a, T>(
    name: &str,
    pointer: *mut T,
    size: usize,
    needed: usize,
) -> Result<&'a mut [T], Status> {
    fits(name, size, needed)?;
    if needed == 0 {
        return Ok(&mut []);
    }
    usable(name, pointer)?;
    // SAFETY: not null, aligned; the rest is our caller's promise.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, size) })
}

/// A text of C's.
///
/// # Safety
/// A pointer that is not null points to bytes that end with a zero, and that nobody writes while `'a` lasts.
pub(crate) unsafe fn text<'a>(name: &str, pointer: *const c_char) -> Result<&'a str, Status> {
    usable(name, pointer)?;
    // SAFETY: not null; the rest is our caller's promise.
    let bytes = unsafe { CStr::from_ptr(pointer) };
    bytes.to_str().map_err(|_| refuse(Status::Parameter, format_args!("{name} is not UTF-8")))
}

/// Why the last refused call of this thread was refused; an empty text before the first.
#[unsafe(no_mangle)]
pub extern "C" fn rodgym_error() -> *const c_char {
    // The buffer lives as long as its thread does.
    SENTENCE.with(|kept| kept.as_ptr()).cast::<Sentence>().cast_const().cast()
}

/// Layout of the functions and types: the header's `RODGYM_CONTROLLERS_ABI`.
#[unsafe(no_mangle)]
pub extern "C" fn rodgym_abi() -> u32 {
    1
}

/// Version of rodgym.
#[unsafe(no_mangle)]
pub extern "C" fn rodgym_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

#[cfg(test)]
mod tests {
    //! What goes wrong within stays within.

    use super::*;

    fn sentence() -> String {
        // SAFETY: the text is this thread's, and ends with a zero.
        unsafe { CStr::from_ptr(rodgym_error()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn a_panic_is_a_code_and_a_sentence() {
        let status = guarded(|| panic!("a table of {} rows", 3));
        assert_eq!(status, Status::Fault);
        assert!(sentence().contains("a table of 3 rows (at "), "{}", sentence());
    }

    #[test]
    fn a_long_sentence_ends_between_two_letters() {
        refuse(Status::File, format_args!("{}", "\u{e4}".repeat(LONGEST)));
        assert_eq!(sentence(), "\u{e4}".repeat((LONGEST - 1) / 2));
        refuse(Status::File, format_args!("short"));
        assert_eq!(sentence(), "short");
    }
}
