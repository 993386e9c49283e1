//! The promise under test: `#[caught]` puts the body of every function of an item through `faults::caught`, and
//! leaves the rest of it alone.

use rodgym_caught::caught;

/// What the bindings have under this name.
mod faults {
    use std::panic::catch_unwind;

    pub fn caught<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
        catch_unwind(std::panic::AssertUnwindSafe(work)).unwrap_or(Err("a panic".into()))
    }
}

struct Shelf<'a>(&'a [u32]);

#[caught]
impl<'a> Shelf<'a> {
    const SIZE: usize = { 1 + 1 };

    fn new(books: &'a [u32]) -> Result<Self, String> {
        if books.len() > Self::SIZE {
            return Err("too many".into());
        }
        Ok(Shelf(books))
    }

    /// A documented one, whose answer lives as long as the shelf.
    fn book(&self, mut place: usize) -> Result<&'a u32, String> {
        place += 0;
        Ok(&self.0[place])
    }

    fn each<F>(&self, mut look: F) -> Result<(), String>
    where
        F: FnMut(u32) -> Result<(), String>,
    {
        for book in self.0 {
            look(*book)?;
        }
        Ok(())
    }
}

/// Documented, too.
#[caught]
fn half(number: u32) -> Result<u32, String> {
    let by = |n: u32| {
        assert!(number.is_multiple_of(n), "odd");
        number / n
    };
    Ok(by(2))
}

#[test]
fn panics_come_back_as_errors_from_every_function() {
    let shelf = Shelf::new(&[7, 8]).unwrap();
    assert_eq!(Shelf::new(&[1, 2, 3]).err(), Some("too many".into()));
    assert_eq!(shelf.book(1), Ok(&8));
    assert_eq!(shelf.book(2), Err("a panic".into()));
    assert_eq!(shelf.each(|_| Ok(())), Ok(()));
    assert_eq!(shelf.each(|_| Err("no".into())), Err("no".into()));
    assert_eq!(shelf.each(|_| panic!("on purpose")), Err("a panic".into()));
    assert_eq!((half(4), half(3)), (Ok(2), Err("a panic".into())));
}
