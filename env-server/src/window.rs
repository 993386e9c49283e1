//! The sequence window: every changing call of a session is carried out at most once.
//!
//! A client numbers its changing calls 1, 2, 3... The next number runs; one of the last W is answered
//! from memory; anything else is refused. So a client that lost a reply simply sends the call again.

use std::collections::VecDeque;

/// Keyed hash of a call's content: who does not know the server's key finds no second content with it.
pub type Digest = [u8; 32];

/// What to do with a call.
#[derive(Debug, PartialEq)]
pub enum Verdict<'a, R> {
    /// Carry it out, then `record` it.
    Run,
    /// It was carried out already: this was the reply.
    Cached(&'a R),
    /// It was carried out so long ago that the reply is forgotten.
    Stale,
    /// Calls before it have not arrived.
    Gap,
    /// The number was used for another call.
    Conflict,
}

/// The last calls of one session with their replies.
#[derive(Debug)]
pub struct Window<R> {
    last: u64,
    size: usize,
    done: VecDeque<(Digest, R)>,
}

impl<R> Window<R> {
    /// Remembers the last `size` calls, at least 1.
    pub fn new(size: usize) -> Self {
        Window { last: 0, size: size.max(1), done: VecDeque::new() }
    }

    /// Number of the last call that was carried out; 0 before the first.
    pub fn last(&self) -> u64 {
        self.last
    }

    /// Judges the call numbered `seq` whose content has this digest.
    pub fn judge(&self, seq: u64, digest: Digest) -> Verdict<'_, R> {
        if seq > self.last {
            return if seq - self.last == 1 { Verdict::Run } else { Verdict::Gap };
        }
        let age = self.last - seq;
        let place = usize::try_from(age).ok().and_then(|age| self.done.len().checked_sub(age + 1));
        match place.map(|i| &self.done[i]) {
            // Number 0 is never carried out: it lies one before the oldest.
            None => Verdict::Stale,
            Some((known, reply)) if *known == digest => Verdict::Cached(reply),
            Some(_) => Verdict::Conflict,
        }
    }

    /// Remembers that the next call has been carried out. Refused calls are not recorded, so their
    /// number can be used again.
    pub fn record(&mut self, digest: Digest, reply: R) {
        if self.done.len() == self.size {
            self.done.pop_front();
        }
        self.done.push_back((digest, reply));
        self.last += 1;
    }
}
