//! Sessions that are worked on elsewhere: in whatever order the work is finished, every request gets one
//! reply, and each session's replies are those that it would have given at once.

mod common;

use common::{Desk, Reply};
use proptest::prelude::*;
use rodgym_server::limits::Limits;
use rodgym_server::server::{Begun, Server};
use rodgym_server::wire::Frame;
use rodgym_server::work::Work;
use serde_json::json;
use std::collections::{HashMap, VecDeque};
use std::time::Duration;

/// A request and its number.
type Numbered = (usize, Vec<Vec<u8>>);

/// What `run` does with threads, without any: work stays until it is told to be done.
#[derive(Default)]
struct Away {
    work: Vec<(usize, Work)>,
    waiting: HashMap<u128, VecDeque<Numbered>>,
    replies: HashMap<usize, Vec<Frame>>,
}

impl Away {
    fn begin(&mut self, server: &mut Server, number: usize, frames: Vec<Vec<u8>>) {
        match server.begin(Duration::ZERO, &"ada".into(), frames) {
            Begun::Reply(reply) => self.answer(number, reply),
            Begun::Work(work) => self.work.push((number, work)),
            Begun::Later(sid, frames) => {
                self.waiting.entry(sid).or_default().push_back((number, frames));
            }
        }
    }

    fn answer(&mut self, number: usize, reply: Vec<Frame>) {
        assert!(self.replies.insert(number, reply).is_none(), "request {number} answered twice");
    }

    fn finish(&mut self, server: &mut Server, which: usize) {
        let (number, work) = self.work.swap_remove(which % self.work.len());
        let sid = work.sid();
        let reply = server.finish(work.run());
        self.answer(number, reply);
        for (number, frames) in self.waiting.remove(&sid).unwrap_or_default() {
            self.begin(server, number, frames);
        }
    }
}

proptest! {
    #[test]
    fn any_order_of_finishing_gives_the_replies_of_computing_at_once(
        calls in prop::collection::vec((0usize..3, 0u32..6, any::<u8>()), 1..60),
    ) {
        let limits = Limits { window: 4, ..Limits::default() };
        let (mut there, mut here) = (Desk::new(limits.clone()), Desk::new(limits));
        let sids: Vec<String> = (0..3).map(|_| there.make(2, "SameStep")).collect();
        let same: Vec<String> = (0..3).map(|_| here.make(2, "SameStep")).collect();
        prop_assert_eq!(&sids, &same);
        let (mut away, mut next, mut expected) = (Away::default(), [1u64; 3], Vec::new());
        for (number, (session, kind, finish)) in calls.into_iter().enumerate() {
            let sid = Some(sids[session].as_str());
            let frames = match kind {
                0 => there.request("observe", sid, None, json!({}), &[]),
                1 => there.request("touch", sid, None, json!({}), &[]),
                2 if finish % 16 == 0 => there.request("close", sid, None, json!({}), &[]),
                _ => {
                    let action = rodgym_server::wire::array("action", &[2, 1], &[0.5f32, number as f32]);
                    next[session] += 1;
                    there.request("step", sid, Some(next[session] - 1), json!({}), &[action])
                }
            };
            expected.push(here.server.handle(Duration::ZERO, "ada", &frames));
            away.begin(&mut there.server, number, frames);
            if finish % 3 == 0 && !away.work.is_empty() {
                away.finish(&mut there.server, usize::from(finish));
            }
        }
        while !away.work.is_empty() {
            away.finish(&mut there.server, 0);
        }
        prop_assert!(away.waiting.is_empty());
        for (number, expected) in expected.iter().enumerate() {
            let (got, expected) = (Reply::read(&away.replies[&number]), Reply::read(expected));
            // Beside the others' work, `seq` of a refusal may be told or not.
            prop_assert_eq!(got.code(), expected.code());
            prop_assert_eq!(got.header.p, expected.header.p);
            prop_assert_eq!(got.frames, expected.frames);
        }
    }
}

#[test]
fn make_sent_again_while_it_is_made_gives_one_session() {
    let mut desk = Desk::new(Limits::default());
    let p = json!({"id": "test/Counter-v0", "nonce": "0".repeat(32)});
    let frames = desk.request("make", None, None, p, &[]);
    let mut away = Away::default();
    for number in 0..3 {
        away.begin(&mut desk.server, number, frames.clone());
    }
    assert_eq!((away.work.len(), away.replies.len()), (1, 0));
    away.finish(&mut desk.server, 0);
    let sids: Vec<_> = (0..3).map(|i| Reply::read(&away.replies[&i]).p("sid").clone()).collect();
    assert!(sids[0].is_string() && sids[0] == sids[1] && sids[1] == sids[2], "{sids:?}");
    assert_eq!(desk.server.sessions().count(), 1);
}

#[test]
fn a_session_whose_user_goes_while_it_is_away_does_not_come_back() {
    let mut desk = Desk::new(Limits::default());
    let sid = desk.make(1, "NextStep");
    let mut away = Away::default();
    let frames = desk.request("observe", Some(&sid), None, json!({}), &[]);
    away.begin(&mut desk.server, 0, frames);
    assert_eq!(desk.server.reap(Duration::MAX), 0, "it is in use");
    assert_eq!(desk.server.revoke(|_| false), 0);
    away.finish(&mut desk.server, 0);
    assert_eq!(desk.server.sessions().count(), 0);
    assert_eq!(desk.shared.ledger.taken(), 0);
}
