//! Any sequence of messages to the state machine: one well-formed reply each, and a bystander's session
//! goes on as if nothing had happened.
//!
//! Input: messages, each a count of frames (one byte) and frames with their length before them (two
//! bytes). 32 asterisks stand for the session number that the server gave us, so that the fuzzer can
//! reach its operations.

#![no_main]

#[path = "../../tests/common/mod.rs"]
mod common;

use common::{Desk, Reply};
use libfuzzer_sys::fuzz_target;
use rodgym_server::limits::Limits;
use std::time::Duration;

/// Where an input puts the session number, as 32 of these.
const PLACE: &[u8] = &[b'*'; 32];

fuzz_target!(|bytes: &[u8]| {
    let mut desk = Desk::new(Limits { sessions_per_user: 4, envs: 8, ..Limits::default() });
    let bystander = desk.make(1, "NextStep");
    desk.user = "mallory".into();
    let sid = desk.make(2, "SameStep");
    let mut rest = bytes;
    let mut take = |n: usize| {
        let (head, tail) = rest.split_at(n.min(rest.len()));
        rest = tail;
        head.to_vec()
    };
    for round in 0..32 {
        let Some(count) = take(1).first().map(|n| n % 10) else { break };
        let frames: Vec<Vec<u8>> = (0..count)
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
        let reply = desk.server.handle(Duration::from_secs(round), "mallory", &frames);
        let delimited = frames.first().is_some_and(|frame| frame.is_empty());
        Reply::read(&reply[usize::from(delimited)..]);
    }
    desk.user = "ada".into();
    let reply = desk.step(&bystander, 1, &[0.5]);
    assert_eq!(reply.array::<f32>("obs"), [1.0, 0.5]);
});
