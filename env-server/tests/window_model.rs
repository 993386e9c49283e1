//! The sequence window against a model that keeps everything: whatever a client sends, in whatever
//! order, each call is carried out once and its reply never changes.

mod common;

use proptest::prelude::*;
use rodgym_server::limits::Limits;
use rodgym_server::window::{Verdict, Window};
use serde_json::json;

/// The model: all calls ever carried out, with unlimited memory.
fn expected(done: &[(u32, u64)], size: usize, seq: u64, digest: u32) -> &'static str {
    let last = done.len() as u64;
    if seq == last + 1 {
        "run"
    } else if seq > last {
        "gap"
    } else if seq == 0 || last - seq >= size as u64 {
        "stale"
    } else if done[seq as usize - 1].0 == digest {
        "cached"
    } else {
        "conflict"
    }
}

proptest! {
    #[test]
    fn the_window_agrees_with_a_model_that_forgets_nothing(
        size in 1usize..20,
        calls in prop::collection::vec((-20i64..3, 0u32..2, any::<bool>()), 0..200),
    ) {
        let mut window = Window::new(size);
        let mut done: Vec<(u32, u64)> = Vec::new();
        for (back, digest, refused) in calls {
            let seq = (done.len() as i64 + back).max(0) as u64;
            let hash = [digest as u8; 32];
            let verdict = match window.judge(seq, hash) {
                Verdict::Run => "run",
                Verdict::Gap => "gap",
                Verdict::Stale => "stale",
                Verdict::Conflict => "conflict",
                Verdict::Cached(reply) => {
                    prop_assert_eq!(*reply, done[seq as usize - 1].1);
                    "cached"
                }
            };
            prop_assert_eq!(verdict, expected(&done, size, seq, digest));
            // A refused call leaves its number free.
            if verdict == "run" && !refused {
                let reply = seq * 1000 + u64::from(digest);
                window.record(hash, reply);
                done.push((digest, reply));
            }
            prop_assert_eq!(window.last(), done.len() as u64);
        }
    }

    #[test]
    fn lost_and_repeated_messages_never_change_the_trajectory(
        window in 1usize..5,
        faults in prop::collection::vec(0u8..4, 40),
    ) {
        let limits = Limits { window, ..Limits::default() };
        let mut desk = common::Desk::new(limits);
        let sid = desk.make(1, "NextStep");
        desk.ask("reset", Some(&sid), Some(1), json!({}));
        let mut sum = 0.0f32;
        for (i, fault) in faults.iter().enumerate() {
            let (seq, action) = (i as u64 + 2, (i % 7) as f32 * 0.125);
            let reset = i % 4 == 3;
            if !reset {
                sum += action;
            }
            // The request is lost, its reply is lost, the request comes twice, or a gap is tried.
            match fault {
                0 => {
                    let reply = desk.step(&sid, seq + 1, &[action]);
                    prop_assert_eq!(reply.code(), "seq_gap");
                }
                1 => { desk.step(&sid, seq, &[action]); }
                2 => {
                    desk.step(&sid, seq, &[action]);
                    desk.step(&sid, seq, &[action]);
                }
                _ => {}
            }
            let reply = desk.step(&sid, seq, &[action]);
            prop_assert_eq!(reply.code(), "ok");
            let steps = if reset { 0.0 } else { (i % 4 + 1) as f32 };
            prop_assert_eq!(reply.array::<f32>("obs"), vec![steps, sum]);
        }
    }
}
