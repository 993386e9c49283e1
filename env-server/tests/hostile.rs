//! Whatever bytes arrive, the server answers once, allocates little and goes on serving others.

mod common;

use common::{Desk, Reply};
use proptest::prelude::*;
use rodgym_server::limits::Limits;
use rodgym_server::metrics::OPS;
use rodgym_server::wire::{self, ArrayHeader};
use serde_json::json;

/// Sends frames and checks that the answer is one well-formed reply.
fn answered(desk: &mut Desk, frames: &[Vec<u8>]) -> Reply {
    let reply = desk.server.handle(desk.now, "mallory", frames);
    let delimited = frames.first().is_some_and(|f| f.is_empty());
    Reply::read(&reply[usize::from(delimited)..])
}

fn still_serving(desk: &mut Desk, sid: &str, seq: u64) {
    assert_eq!(desk.step(sid, seq, &[0.0]).code(), "ok");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn random_frames_are_answered(
        frames in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..80), 0..12),
    ) {
        let mut desk = Desk::new(Limits::default());
        let sid = desk.make(1, "NextStep");
        let reply = answered(&mut desk, &frames);
        prop_assert!(!reply.header.ok);
        still_serving(&mut desk, &sid, 1);
    }

    #[test]
    fn a_good_request_with_bytes_changed_is_answered(
        op in prop::sample::select(&OPS[..]),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        cut in any::<prop::sample::Index>(),
    ) {
        let mut desk = Desk::new(Limits::default());
        let sid = desk.make(2, "SameStep");
        let action = wire::array("action", &[2, 1], &[0.5f32, 0.5]);
        let p = json!({"id": "test/Counter-v0", "nonce": "e".repeat(32), "index": 0, "first": 0});
        let mut frames = desk.request(op, Some(&sid), Some(1), p, &[action]);
        for (index, byte) in changes {
            let at = index.index(frames[0].len());
            frames[0][at] = byte;
        }
        answered(&mut desk, &frames);
        let length = cut.index(frames[0].len());
        frames[0].truncate(length);
        answered(&mut desk, &frames);
        desk.user = "ada".into();
        let reply = desk.ask("ping", None, None, json!({}));
        prop_assert_eq!(reply.code(), "ok");
    }

    #[test]
    fn arrays_that_do_not_fit_are_refused(
        dtype in prop::sample::select(vec!["<f4", "<f8", "|u1", "|b1", "<u4", "<u8", ">f4", "O", ""]),
        shape in prop::collection::vec(any::<u64>(), 0..5),
        bytes in prop::collection::vec(any::<u8>(), 0..64),
    ) {
        let mut desk = Desk::new(Limits::default());
        let sid = desk.make(2, "NextStep");
        let array = (ArrayHeader("action".into(), dtype.into(), shape.clone()), bytes[..].into());
        let frames = desk.request("step", Some(&sid), Some(1), json!({}), &[array]);
        let reply = desk.send(&frames);
        let fits = dtype == "<f4" && shape == [2, 1] && bytes.len() == 8;
        prop_assert!(fits || reply.code() == "bad_array", "{}", reply.code());
    }
}

#[test]
fn deep_nesting_is_refused_without_overflowing_the_stack() {
    let mut desk = Desk::new(Limits { header_bytes: 1 << 20, ..Limits::default() });
    // {"v": 1, "p": {"": {"": ... and [[[[... a million levels deep.
    for opener in [&[0x81u8, 0xa0][..], &[0x91]] {
        let mut bytes = vec![0x82, 0xa1, b'v', 1, 0xa1, b'p'];
        bytes.extend(opener.iter().cycle().take((1 << 20) - 10));
        let reply = answered(&mut desk, &[bytes]);
        assert_eq!(reply.code(), "bad_header");
    }
}

#[test]
fn a_header_that_promises_gigabytes_is_refused() {
    let mut desk = Desk::new(Limits::default());
    // Maps, arrays, texts and blobs of 2^32 - 1 elements, with none of them there.
    for marker in [0xdfu8, 0xdd, 0xdb, 0xc6] {
        let mut bytes = vec![0x82, 0xa1, b'v', 1, 0xa3, b'a', b'r', b'r', marker];
        bytes.extend([0xff; 4]);
        assert_eq!(answered(&mut desk, &[bytes]).code(), "bad_header");
        let mut bytes = vec![marker];
        bytes.extend([0xff; 4]);
        assert_eq!(answered(&mut desk, &[bytes]).code(), "bad_header");
    }
}

#[test]
fn oversize_headers_and_too_many_frames_are_refused() {
    let mut desk = Desk::new(Limits::default());
    let large = desk.request("ping", None, None, json!({"x": "y".repeat(5000)}), &[]);
    assert_eq!(answered(&mut desk, &large).code(), "bad_header");
    let mut many = desk.request("ping", None, None, json!({}), &[]);
    many.extend(vec![vec![0u8; 4]; 8]);
    assert_eq!(answered(&mut desk, &many).code(), "limit");
    assert_eq!(answered(&mut desk, &[]).code(), "bad_header");
    assert_eq!(answered(&mut desk, &[vec![]]).code(), "bad_header");
}

#[test]
fn a_header_in_array_form_or_with_bytes_behind_it_is_refused() {
    let mut desk = Desk::new(Limits::default());
    let array = rmp_serde::to_vec(&json!([1, "ping", 3])).expect("it is JSON");
    assert_eq!(answered(&mut desk, &[array]).code(), "bad_header");
    let mut frames = desk.request("ping", None, None, json!({}), &[]);
    frames[0].push(0);
    assert_eq!(answered(&mut desk, &frames).code(), "bad_header");
}
