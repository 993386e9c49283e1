//! Promises of the protocol: one reply a request, a step at most once, nobody sees another's
//! session, and a refusal changes nothing.

mod common;

use common::{Desk, Reply};
use rodgym_server::limits::{Limits, UserLimits};
use rodgym_server::session::flag;
use rodgym_server::wire;
use serde_json::json;
use std::time::Duration;

fn desk() -> Desk {
    Desk::new(Limits::default())
}

#[test]
fn hello_tells_versions_limits_and_user() {
    let reply = desk().ask("hello", None, None, json!({"versions": [1, 9]}));
    assert_eq!(reply.p("versions"), &json!([1, 1]));
    assert_eq!(reply.p("user"), "ada");
    assert_eq!(reply.p("limits")["window"], 16);
    assert_eq!(reply.header.epoch, "epoch-of-tests");
}

#[test]
fn any_other_version_is_told_both_ranges() {
    for v in [0u64, 2, 77, u64::MAX] {
        // A future header may use our keys for other things.
        let header = rmp_serde::to_vec_named(&json!({"v": v, "rid": 5, "op": ["x"], "p": 3}));
        let reply = desk().send(&[header.expect("it is JSON")]);
        assert_eq!(reply.code(), "version");
        assert_eq!(reply.header.rid, 5);
        assert_eq!(reply.p("client"), &json!([v, v]));
        assert_eq!(reply.p("server"), &json!([1, 1]));
    }
}

#[test]
fn unknown_keys_of_a_header_are_ignored() {
    let header = json!({"v": 1, "rid": 9, "op": "ping", "colour": {"deep": [1, 2]}});
    let reply = desk().send(&[rmp_serde::to_vec_named(&header).expect("it is JSON")]);
    assert_eq!((reply.code(), reply.header.rid), ("ok", 9));
}

#[test]
fn a_leading_empty_frame_comes_back() {
    let mut desk = desk();
    let mut frames = desk.request("ping", None, None, json!({}), &[]);
    frames.insert(0, vec![]);
    let reply = desk.server.handle(Duration::ZERO, "ada", &frames);
    assert!(reply[0].is_empty());
    assert_eq!(Reply::read(&reply[1..]).code(), "ok");
}

#[test]
fn a_step_answers_for_the_whole_batch() {
    let mut desk = desk();
    let sid = desk.make(2, "SameStep");
    let reply = desk.ask("reset", Some(&sid), Some(1), json!({"seed": 7}));
    assert_eq!(reply.array::<f64>("parameters"), [7.0, 8.0]);
    assert_eq!(reply.array::<u8>("flags"), [flag::BEGAN; 2]);
    for seq in 2..=3 {
        let reply = desk.step(&sid, seq, &[0.5, -0.5]);
        assert_eq!(reply.array::<u8>("flags"), [flag::STEPPED; 2]);
        assert!(!reply.has("final_obs") && !reply.has("parameters"));
    }
    let reply = desk.step(&sid, 4, &[0.5, -0.5]);
    let ended = flag::STEPPED | flag::TRUNCATED | flag::BEGAN | flag::FINAL;
    assert_eq!(reply.array::<u8>("flags"), [ended; 2]);
    assert_eq!(reply.array::<f32>("obs"), [0.0, 1.5, 0.0, -1.5]);
    assert_eq!(reply.array::<f32>("final_obs"), [3.0, 1.5, 3.0, -1.5]);
    assert_eq!(reply.array::<f64>("reward"), [1.5, -1.5]);
    assert_eq!(reply.header.seq, Some(4));
}

#[test]
fn seeds_and_masks_reach_the_environments() {
    let mut desk = desk();
    let sid = desk.make(3, "Disabled");
    let arrays = [
        wire::array("seeds", &[3], &[u64::MAX, 1, 5]),
        (wire::ArrayHeader("seeded".into(), "|b1".into(), vec![3]), [1u8, 0, 1].into()),
    ];
    let frames = desk.request("reset", Some(&sid), Some(1), json!({}), &arrays);
    let reply = desk.send(&frames);
    assert_eq!(reply.array::<f64>("parameters"), [u64::MAX as f64, -1.0, 5.0]);
    desk.step(&sid, 2, &[1.0, 1.0, 1.0]);
    let mask = [(wire::ArrayHeader("mask".into(), "|b1".into(), vec![3]), [0u8, 1, 0].into())];
    let frames = desk.request("reset", Some(&sid), Some(3), json!({}), &mask);
    let reply = desk.send(&frames);
    assert_eq!(reply.array::<f32>("obs"), [1.0, 1.0, 0.0, 0.0, 1.0, 1.0]);
    assert_eq!(reply.array::<u8>("flags"), [0, flag::BEGAN, 0]);
}

#[test]
fn a_step_sent_again_is_answered_from_memory() {
    let mut desk = desk();
    let sid = desk.make(1, "NextStep");
    desk.ask("reset", Some(&sid), Some(1), json!({}));
    let first = desk.step(&sid, 2, &[0.25]);
    let again = desk.step(&sid, 2, &[0.25]);
    assert_eq!(first.frames, again.frames);
    assert_eq!(desk.step(&sid, 3, &[0.25]).array::<f32>("obs"), [2.0, 0.5]);
    assert_eq!(desk.step(&sid, 2, &[0.5]).code(), "seq_conflict");
    assert_eq!(desk.step(&sid, 5, &[0.5]).code(), "seq_gap");
    for seq in 4..30 {
        assert_eq!(desk.step(&sid, seq, &[0.0]).code(), "ok");
    }
    assert_eq!(desk.step(&sid, 2, &[0.25]).code(), "stale_seq");
    assert_eq!(desk.step(&sid, 14, &[0.0]).code(), "ok", "the 16th from the end is kept");
    assert_eq!(desk.step(&sid, 13, &[0.0]).code(), "stale_seq");
}

#[test]
fn a_refused_step_changes_nothing_and_its_number_is_free() {
    let mut desk = desk();
    let sid = desk.make(1, "NextStep");
    desk.ask("reset", Some(&sid), Some(1), json!({}));
    let refused = desk.step(&sid, 2, &[f32::NAN]);
    assert_eq!((refused.code(), refused.header.seq), ("env", Some(1)));
    assert_eq!(refused.p("kind"), "action");
    assert_eq!(desk.step(&sid, 2, &[0.1, 0.2]).code(), "bad_array");
    let reply = desk.ask("step", Some(&sid), Some(2), json!({}));
    assert_eq!(reply.code(), "bad_array");
    assert_eq!(desk.ask("step", Some(&sid), None, json!({})).code(), "bad_request");
    assert_eq!(desk.step(&sid, 2, &[0.5]).array::<f32>("obs"), [1.0, 0.5]);
}

#[test]
fn make_with_the_same_nonce_gives_the_same_session() {
    let mut desk = desk();
    let p = |n: usize| json!({"id": "test/Counter-v0", "num_envs": n, "nonce": "f".repeat(32)});
    let first = desk.ask("make", None, None, p(2));
    let again = desk.ask("make", None, None, p(2));
    assert_eq!(first.p("sid"), again.p("sid"));
    assert_eq!(first.p("max_episode_steps"), 3, "absent means the environment's own");
    assert_eq!(desk.ask("make", None, None, p(3)).code(), "nonce_conflict");
    desk.user = "bob".into();
    let other = desk.ask("make", None, None, p(2));
    assert_ne!(first.p("sid"), other.p("sid"), "a nonce belongs to its user");
    assert_eq!(desk.server.sessions().count(), 2);
}

#[test]
fn a_foreign_session_answers_like_an_unknown_one() {
    let mut desk = desk();
    let sid = desk.make(1, "NextStep");
    desk.user = "eve".into();
    let mut unknown = desk.ask("info", Some(&"0".repeat(32)), None, json!({}));
    let mut foreign = desk.ask("info", Some(&sid), None, json!({}));
    (unknown.header.rid, foreign.header.rid) = (0, 0);
    assert_eq!(unknown.header, foreign.header);
    for op in ["step", "reset", "close", "get_state", "set_state", "render", "touch", "observe"] {
        let reply = desk.ask(op, Some(&sid), Some(1), json!({}));
        assert_eq!((reply.code(), reply.header.seq), ("no_session", None), "{op}");
    }
    desk.user = "ada".into();
    assert_eq!(desk.ask("info", Some(&sid), None, json!({})).code(), "ok");
}

#[test]
fn snapshots_go_in_whole_or_not_at_all() {
    let mut desk = desk();
    let sid = desk.make(2, "NextStep");
    desk.ask("reset", Some(&sid), Some(1), json!({}));
    desk.step(&sid, 2, &[0.5, 1.0]);
    let saved = desk.ask("get_state", Some(&sid), None, json!({}));
    desk.step(&sid, 3, &[0.5, 1.0]);
    let sizes = saved.array::<u32>("sizes");
    let data = saved.array::<u8>("data");
    let set = |desk: &mut Desk, seq: u64, sizes: &[u32], data: &[u8]| {
        let arrays =
            [wire::array("sizes", &[sizes.len()], sizes), wire::array("data", &[data.len()], data)];
        desk.send(&desk.request("set_state", Some(&sid), Some(seq), json!({}), &arrays))
    };
    // The second snapshot is cut short: the first must not stay either.
    let refused = set(&mut desk, 4, &[sizes[0], sizes[1] - 1], &data[..data.len() - 1]);
    assert_eq!((refused.code(), refused.p("kind").as_str()), ("env", Some("snapshot")));
    let seen = desk.ask("observe", Some(&sid), None, json!({}));
    assert_eq!(seen.array::<f32>("obs"), [2.0, 1.0, 2.0, 2.0]);
    assert_eq!(set(&mut desk, 4, &[1, 2], &data).code(), "bad_request");
    let restored = set(&mut desk, 4, &sizes, &data);
    assert_eq!(restored.array::<f32>("obs"), [1.0, 0.5, 1.0, 1.0]);
    let one = desk.ask("get_state", Some(&sid), None, json!({"first": 1, "count": 1}));
    assert_eq!(one.array::<u8>("data"), data[sizes[0] as usize..]);
    let beyond = desk.ask("get_state", Some(&sid), None, json!({"first": 1, "count": 2}));
    assert_eq!(beyond.code(), "bad_request");
}

#[test]
fn a_scene_travels_as_arrays() {
    let mut desk = desk();
    let sid = desk.make(1, "NextStep");
    let scene = desk.ask("render", Some(&sid), None, json!({"index": 0}));
    assert_eq!(scene.array::<f64>("nodes"), [0.0, 0.5, 1.0, 1.5]);
    assert_eq!(scene.array::<f64>("arrow:wind"), [1.0, 2.0, 3.0, 4.0]);
    assert_eq!(scene.p("scene")["machine"], "counter");
    assert_eq!(desk.ask("render", Some(&sid), None, json!({"index": 1})).code(), "env");
}

#[test]
fn limits_refuse_and_closing_makes_room() {
    let mut desk = Desk::new(Limits { sessions: 3, sessions_per_user: 2, ..Limits::default() });
    let first = desk.make(1, "NextStep");
    desk.make(1, "NextStep");
    let p = json!({"id": "test/Counter-v0", "nonce": "a".repeat(32)});
    let full = desk.ask("make", None, None, p.clone());
    let error = full.header.err.expect("a third session of one user is refused");
    assert_eq!((error.code.as_str(), error.retry.as_str()), ("limit", "same"));
    assert!(error.after_ms.is_some());
    desk.user = "bob".into();
    assert_eq!(desk.ask("make", None, None, p.clone()).code(), "ok");
    let other = json!({"id": "test/Counter-v0", "nonce": "b".repeat(32)});
    assert_eq!(desk.ask("make", None, None, other).code(), "busy");
    desk.user = "ada".into();
    assert_eq!(desk.ask("close", Some(&first), None, json!({})).code(), "ok");
    assert_eq!(desk.ask("make", None, None, p).code(), "ok");
    let large = json!({"id": "test/Counter-v0", "num_envs": 5000, "nonce": "c".repeat(32)});
    assert_eq!(desk.ask("make", None, None, large).header.err.expect("too many").retry, "never");
}

#[test]
fn a_named_user_can_have_limits_of_its_own() {
    let mut desk = desk();
    let limits = UserLimits { sessions: Some(1), envs: Some(8) };
    desk.shared.users.write().expect("nobody holds it").insert("ada".into(), limits);
    let p =
        |n: usize, c: &str| json!({"id": "test/Counter-v0", "num_envs": n, "nonce": c.repeat(32)});
    assert_eq!(desk.ask("make", None, None, p(9, "a")).code(), "limit");
    assert_eq!(desk.ask("make", None, None, p(8, "b")).code(), "ok");
    assert_eq!(desk.ask("make", None, None, p(1, "c")).code(), "limit");
}

#[test]
fn idle_sessions_are_dropped_and_touch_keeps_them() {
    let mut desk = Desk::new(Limits { idle_seconds: 10, ..Limits::default() });
    let (kept, lost) = (desk.make(1, "NextStep"), desk.make(1, "NextStep"));
    desk.now = Duration::from_secs(8);
    desk.ask("touch", Some(&kept), None, json!({}));
    desk.ask("ping", Some(&lost), None, json!({}));
    assert_eq!(desk.server.reap(Duration::from_secs(12)), 1);
    assert_eq!(desk.ask("touch", Some(&kept), None, json!({})).code(), "ok");
    assert_eq!(desk.ask("touch", Some(&lost), None, json!({})).code(), "no_session");
}

#[test]
fn revoking_a_user_drops_its_sessions_only() {
    let mut desk = desk();
    let ada = desk.make(1, "NextStep");
    desk.user = "bob".into();
    let bob = desk.make(1, "NextStep");
    assert_eq!(desk.server.revoke(|user| user != "ada"), 1);
    assert_eq!(desk.ask("info", Some(&bob), None, json!({})).code(), "ok");
    desk.user = "ada".into();
    assert_eq!(desk.ask("info", Some(&ada), None, json!({})).code(), "no_session");
}

#[test]
fn a_panic_inside_costs_one_session_not_the_server() {
    let mut desk = desk();
    let (bad, good) = (desk.make(1, "NextStep"), desk.make(1, "NextStep"));
    let reply = desk.step(&bad, 1, &[99.0]);
    let error = reply.header.err.expect("a panic is an error");
    assert_eq!((error.code.as_str(), error.retry.as_str()), ("internal", "new_session"));
    assert_eq!(desk.ask("info", Some(&bad), None, json!({})).code(), "no_session");
    assert_eq!(desk.step(&good, 1, &[0.5]).code(), "ok");
    assert_eq!(desk.server.sessions().count(), 1);
}

#[test]
fn a_draining_server_sends_new_sessions_elsewhere_and_finishes_old_ones() {
    let mut desk = desk();
    let sid = desk.make(1, "NextStep");
    desk.shared.draining.store(true, std::sync::atomic::Ordering::Relaxed);
    let p = json!({"id": "test/Counter-v0", "nonce": "a".repeat(32)});
    let error = desk.ask("make", None, None, p).header.err.expect("no new sessions");
    assert_eq!((error.code.as_str(), error.retry.as_str()), ("draining", "elsewhere"));
    assert_eq!(desk.step(&sid, 1, &[0.5]).code(), "ok");
}

/// Eight bytes whose last four make their CRC-32 this one: a checksum is linear in each bit.
fn forge(first: f32, crc: u32) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&first.to_le_bytes());
    let sum = |last: u32| {
        let mut bytes = bytes;
        bytes[4..].copy_from_slice(&last.to_le_bytes());
        crc32fast::hash(&bytes)
    };
    // Gauss elimination over bits: what each bit of the last four bytes does to the checksum.
    let mut rows: Vec<(u32, u32)> = (0..32).map(|i| (sum(1 << i) ^ sum(0), 1 << i)).collect();
    let (mut left, mut last) = (crc ^ sum(0), 0);
    for bit in (0..32).map(|i| 1u32 << i) {
        let Some(at) = rows.iter().position(|row| row.0 & bit != 0) else { continue };
        let pivot = rows.swap_remove(at);
        for row in &mut rows {
            if row.0 & bit != 0 {
                *row = (row.0 ^ pivot.0, row.1 ^ pivot.1);
            }
        }
        if left & bit != 0 {
            (left, last) = (left ^ pivot.0, last ^ pivot.1);
        }
    }
    bytes[4..].copy_from_slice(&last.to_le_bytes());
    bytes
}

#[test]
fn another_call_with_the_same_checksum_is_a_conflict_and_no_old_reply() {
    let mut desk = desk();
    let sid = desk.make(2, "NextStep");
    assert_eq!(desk.step(&sid, 1, &[0.5, 0.25]).code(), "ok");
    let sent: Vec<u8> = [0.5f32, 0.25].iter().flat_map(|a| a.to_le_bytes()).collect();
    let bytes = (1..100)
        .map(|i| forge(i as f32 * 0.01, crc32fast::hash(&sent)))
        .find(|b| f32::from_le_bytes([b[4], b[5], b[6], b[7]]).is_finite())
        .expect("most bit patterns are finite numbers");
    assert_eq!(crc32fast::hash(&bytes), crc32fast::hash(&sent));
    let action = wire::read::<f32>(&bytes);
    assert_ne!(action, [0.5, 0.25]);
    assert_eq!(desk.step(&sid, 1, &action).code(), "seq_conflict");
    assert_eq!(desk.step(&sid, 1, &[0.5, 0.25]).code(), "ok");
}

#[test]
fn content_cut_at_another_place_is_other_content() {
    let mut desk = desk();
    let sid = desk.make(1, "NextStep");
    let state = desk.server.handle(
        desk.now,
        "ada",
        &desk.request("get_state", Some(&sid), None, json!({}), &[]),
    );
    let state = Reply::read(&state).array::<u8>("data");
    let (sizes, data) = (wire::array("sizes", &[1], &[9u32]), wire::array("data", &[9], &state));
    let good = desk.request("set_state", Some(&sid), Some(1), json!({}), &[sizes, data]);
    assert_eq!(desk.send(&good).code(), "ok");
    // The same bytes in other frames, and the descriptions that fit them.
    let mut other = desk.request(
        "set_state",
        Some(&sid),
        Some(1),
        json!({}),
        &[wire::array("sizes", &[13], &[0u8; 13]), wire::array("data", &[0], &[0u8; 0])],
    );
    other[1] = [&good[1][..], &good[2]].concat();
    assert_eq!(desk.send(&other).code(), "seq_conflict");
}

#[test]
fn a_header_that_json_could_not_say_is_refused() {
    let mut desk = desk();
    // {"v": 1, "op": "make", "rid": 9, "p": {"x": ...}} with what no JSON has in the place of the dots.
    let with =
        |value: &[u8]| [b"\x84\xa1v\x01\xa2op\xa4ping\xa3rid\x09\xa1p\x81\xa1x", value].concat();
    assert_eq!(desk.send(&[with(b"\xcb\x3f\xf0\0\0\0\0\0\0")]).code(), "ok");
    for value in [
        &b"\xcb\x7f\xf8\0\0\0\0\0\0"[..],
        b"\xcb\x7f\xf0\0\0\0\0\0\0",
        b"\xca\xff\x80\0\0",
        b"\x81\xa1y\xca\x7f\xc0\0\0",
        b"\xc4\x01a",
        b"\xd4\x01\0",
        b"\x81\x01\x01",
    ] {
        let reply = desk.send(&[with(value)]);
        assert_eq!((reply.code(), reply.header.rid), ("bad_header", 0), "{value:?}");
    }
    // Keys that are the fields' numbers, and an operation in binary.
    assert_eq!(desk.send(&[b"\x83\x00\x01\x01\xa4ping\x02\x09".to_vec()]).code(), "bad_header");
    assert_eq!(desk.send(&[b"\x82\xa1v\x01\xa2op\xc4\x04ping".to_vec()]).code(), "bad_header");
    // Numbers of the wrong kind.
    assert_eq!(
        desk.send(&[b"\x83\xa1v\x01\xa2op\xa4ping\xa3rid\xff".to_vec()]).code(),
        "bad_header"
    );
}

#[test]
fn keywords_may_come_as_arrays() {
    let mut desk = desk();
    let p = json!({"id": "test/Counter-v0", "nonce": "0".repeat(32)});
    let long = wire::array("kwargs:profile", &[300], &[0.5f64; 300]);
    // These environments have no such keyword: that they say so shows that it arrived.
    let reply = desk.send(&desk.request("make", None, None, p.clone(), &[long]));
    assert_eq!(reply.p("kind"), "unknown_keyword");
    assert!(reply.header.err.expect("refused").msg.contains("profile"));
    // A dot leads into a map.
    let both =
        [wire::array("kwargs:shape.x", &[1], &[1.0]), wire::array("kwargs:shape", &[1], &[1.0])];
    let reply = desk.send(&desk.request("make", None, None, p.clone(), &both));
    assert_eq!(reply.code(), "bad_request");
    let odd = wire::array("kwargs:profile", &[2], &[0.5, f64::NAN]);
    let reply = desk.send(&desk.request("make", None, None, p, &[odd]));
    assert_eq!(reply.code(), "bad_request");
}

#[test]
fn what_an_environment_refuses_is_told_with_its_kind() {
    let mut desk = desk();
    let unknown = desk.ask("make", None, None, json!({"id": "x", "nonce": "0".repeat(32)}));
    assert_eq!((unknown.code(), unknown.p("kind").as_str()), ("env", Some("unknown_env")));
    let p = json!({"id": "test/Counter-v0", "nonce": "0".repeat(32), "kwargs": {"wdith": 1}});
    let typo = desk.ask("make", None, None, p);
    assert_eq!(typo.p("kind"), "unknown_keyword");
    let p = json!({"id": "test/Counter-v0", "nonce": "short"});
    assert_eq!(desk.ask("make", None, None, p).code(), "bad_request");
    assert_eq!(desk.server.sessions().count(), 0);
    assert_eq!(desk.ask("dance", None, None, json!({})).code(), "unknown_op");
}
