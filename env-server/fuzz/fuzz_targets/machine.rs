//! Any sequence of messages to the state machine, with the work of some of them finished later and in
//! another order: one well-formed reply each, a bystander's session goes on as if nothing had happened,
//! and what was promised to a user is given back with its sessions.
//!
//! Input: messages, each a count of frames (one byte, of which the upper bits say how much work is
//! finished before) and frames with their length before them (two bytes). 32 asterisks stand for the
//! session number that the server gave us, so that the fuzzer can reach its operations.

#![no_main]

#[path = "../../tests/common/mod.rs"]
mod common;

use common::{Desk, Reply};
use libfuzzer_sys::fuzz_target;
use rodgym_server::limits::Limits;
use rodgym_server::server::Begun;
use rodgym_server::work::Work;
use std::time::Duration;

/// Where an input puts the session number, as 32 of these.
const PLACE: &[u8] = &[b'*'; 32];

/// A conversation of one user.
struct Talk {
    desk: Desk,
    away: Vec<Work>,
    waiting: Vec<(u128, Vec<Vec<u8>>)>,
    asked: usize,
    answered: usize,
}

impl Talk {
    fn begin(&mut self, now: Duration, frames: Vec<Vec<u8>>) {
        let delimited = frames.first().is_some_and(|frame| frame.is_empty());
        match self.desk.server.begin(now, &"mallory".into(), frames) {
            Begun::Reply(reply) => {
                Reply::read(&reply[usize::from(delimited)..]);
                self.answered += 1;
            }
            Begun::Work(work) => self.away.push(work),
            Begun::Later(sid, frames) => self.waiting.push((sid, frames)),
        }
    }

    fn finish(&mut self, now: Duration) {
        let work = self.away.swap_remove(0);
        let sid = work.sid();
        let reply = self.desk.server.finish(work.run());
        let delimited = reply[0].is_empty();
        Reply::read(&reply[usize::from(delimited)..]);
        self.answered += 1;
        for (of, frames) in std::mem::take(&mut self.waiting) {
            match of == sid {
                true => self.begin(now, frames),
                false => self.waiting.push((of, frames)),
            }
        }
    }
}

fuzz_target!(|bytes: &[u8]| {
    let mut desk = Desk::new(Limits { sessions_per_user: 4, envs: 8, ..Limits::default() });
    let bystander = desk.make(1, "NextStep");
    let before = desk.shared.ledger.taken();
    desk.user = "mallory".into();
    let sid = desk.make(2, "SameStep");
    let mut talk = Talk { desk, away: vec![], waiting: vec![], asked: 0, answered: 0 };
    let mut rest = bytes;
    let mut take = |n: usize| {
        let (head, tail) = rest.split_at(n.min(rest.len()));
        rest = tail;
        head.to_vec()
    };
    for round in 0..32 {
        let now = Duration::from_secs(round);
        let Some(first) = take(1).first().copied() else { break };
        for _ in 0..usize::from(first / 64).min(talk.away.len()) {
            talk.finish(now);
        }
        let frames: Vec<Vec<u8>> = (0..first % 64 % 10)
            .map(|_| {
                let length = take(2);
                let length = length.iter().fold(0, |n, byte| n << 8 | usize::from(*byte));
                let mut frame = take(length % 5000);
                if let Some(at) = frame.windows(32).position(|window| window == PLACE) {
                    frame[at..at + 32].copy_from_slice(sid.as_bytes());
                }
                frame
            })
            .collect();
        talk.asked += 1;
        talk.begin(now, frames);
    }
    while !talk.away.is_empty() {
        talk.finish(Duration::from_secs(32));
    }
    assert_eq!((talk.answered, talk.waiting.len()), (talk.asked, 0));
    let mut desk = talk.desk;
    desk.user = "ada".into();
    let reply = desk.step(&bystander, 1, &[0.5]);
    assert_eq!(reply.array::<f32>("obs"), [1.0, 0.5]);
    desk.server.revoke(|user| user == "ada");
    assert_eq!(desk.shared.ledger.taken(), before);
});
