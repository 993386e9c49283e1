//! The golden frames: requests and replies byte for byte, for clients in other languages. A change of
//! these bytes is a change of the protocol.
//!
//! `RODGYM_WRITE_GOLDEN=1 cargo test -p rodgym-server --test golden` writes the file anew.

mod common;

use common::Desk;
use rodgym_server::limits::Limits;
use rodgym_server::wire::{self, ArrayHeader, Frame};
use serde_json::{Map, Value, json};
use std::fmt::Write;
use std::time::Duration;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/clients/golden.jsonl");

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// What the frames say, in JSON.
fn told(frames: &[impl AsRef<[u8]>]) -> Value {
    let header: Value = rmp_serde::from_slice(frames[0].as_ref()).expect("our own header");
    let mut arrays = Map::new();
    for (array, frame) in header["arr"].as_array().into_iter().flatten().zip(&frames[1..]) {
        let bytes = frame.as_ref();
        let numbers = match array[1].as_str() {
            Some("<f4") => json!(wire::read::<f32>(bytes)),
            Some("<f8") => json!(wire::read::<f64>(bytes)),
            Some("<u4") => json!(wire::read::<u32>(bytes)),
            Some("<u8") => json!(wire::read::<u64>(bytes)),
            _ => json!(bytes),
        };
        arrays.insert(array[0].as_str().expect("a name").into(), numbers);
    }
    json!({"header": header, "arrays": arrays})
}

/// One exchange a line.
fn record() -> String {
    let mut desk = Desk::new(Limits::default());
    let mut lines = String::new();
    let mut exchange = |desk: &mut Desk, about: &str, frames: Vec<Vec<u8>>| -> Vec<Frame> {
        let reply = desk.server.handle(desk.now, "ada", &frames);
        let all = |frames: &[&[u8]]| frames.iter().map(|f| hex(f)).collect::<Vec<_>>();
        let request: Vec<&[u8]> = frames.iter().map(Vec::as_slice).collect();
        let answer: Vec<&[u8]> = reply.iter().map(|f| &f[..]).collect();
        let skip = usize::from(frames[0].is_empty());
        let line = json!({
            "about": about,
            "request": all(&request), "reply": all(&answer),
            "asks": told(&frames[skip..]), "answers": told(&reply[skip..]),
        });
        lines.push_str(&line.to_string());
        lines.push('\n');
        reply
    };
    let none: &[(ArrayHeader, Frame)] = &[];
    let r = desk.request("hello", None, None, json!({}), none);
    exchange(&mut desk, "hello", r);
    let nonce = "0123456789abcdef".repeat(2);
    let p = json!({"id": "test/Counter-v0", "num_envs": 2, "autoreset_mode": "SameStep", "nonce": nonce});
    let r = desk.request("make", None, None, p, none);
    let reply = exchange(&mut desk, "make", r.clone());
    exchange(&mut desk, "make again: the nonce gives the same session", r);
    let sid = wire::decode_reply(&reply[0]).expect("our own").p["sid"]
        .as_str()
        .expect("text")
        .to_string();
    let sid = Some(sid.as_str());
    let seeds = [
        wire::array("seeds", &[2], &[7u64, u64::MAX]),
        (ArrayHeader("seeded".into(), "|b1".into(), vec![2]), [1u8, 0][..].into()),
    ];
    let r = desk.request("reset", sid, Some(1), json!({}), &seeds);
    exchange(&mut desk, "reset, the second environment without a seed", r);
    for seq in 2..=4 {
        let action = [wire::array("action", &[2, 1], &[0.5f32, -0.25])];
        let r = desk.request("step", sid, Some(seq), json!({}), &action);
        let about = if seq == 4 { "step that ends both episodes" } else { "step" };
        exchange(&mut desk, about, r.clone());
        if seq == 3 {
            exchange(&mut desk, "the same step again: the same reply", r);
        }
    }
    let action = [wire::array("action", &[2, 1], &[9.0f32, 9.0])];
    let r = desk.request("step", sid, Some(4), json!({}), &action);
    exchange(&mut desk, "a number used for something else", r);
    let r = desk.request("step", sid, Some(9), json!({}), &action);
    exchange(&mut desk, "a number too far ahead", r);
    let action = [wire::array("action", &[2, 1], &[0.0f32, f32::INFINITY])];
    let r = desk.request("step", sid, Some(5), json!({}), &action);
    exchange(&mut desk, "an action that is not finite", r);
    let r = desk.request("get_state", sid, None, json!({"first": 1, "count": 1}), none);
    exchange(&mut desk, "snapshot of the second environment", r);
    let r = desk.request("render", sid, None, json!({"index": 0}), none);
    exchange(&mut desk, "scene", r);
    let mut r = desk.request("ping", None, None, json!({}), none);
    r.insert(0, vec![]);
    exchange(&mut desk, "ping with the empty frame of REQ", r);
    let version = rmp_serde::to_vec_named(&json!({"v": 2, "rid": 77, "op": 5})).expect("JSON");
    exchange(&mut desk, "a version that is not spoken", vec![version]);
    let r = desk.request("close", sid, None, json!({}), none);
    exchange(&mut desk, "close", r.clone());
    desk.now = Duration::from_secs(1);
    exchange(&mut desk, "a session that is gone", r);
    let nonce = "fedcba9876543210".repeat(2);
    let p = json!({"id": "test/Counter-v0", "num_envs": 2, "nonce": nonce});
    let r = desk.request("make", None, None, p, none);
    let reply = exchange(&mut desk, "make another session", r);
    let sid = wire::decode_reply(&reply[0]).expect("our own").p["sid"]
        .as_str()
        .expect("text")
        .to_string();
    let sid = Some(sid.as_str());
    let p = json!({"parameters": {"seed": 7.5}});
    let r = desk.request("set_parameters", sid, Some(1), p, none);
    exchange(&mut desk, "a parameter of all environments, from their next episodes", r);
    let each = [wire::array("parameters:seed", &[1], &[8.25])];
    let p = json!({"first": 1, "count": 1});
    let r = desk.request("set_parameters", sid, Some(2), p, &each);
    exchange(&mut desk, "one of the second environment, as an array", r);
    let r = desk.request("reset", sid, Some(3), json!({"seed": 1}), none);
    exchange(&mut desk, "the next episodes have them", r);
    let p = json!({"randomize": {"width": [0.006, 0.009]}});
    let r = desk.request("set_parameters", sid, Some(4), p, none);
    exchange(&mut desk, "a range of a parameter that is not there", r);
    lines
}

#[test]
fn golden_frames_are_those_of_this_server() {
    let ours = record();
    if std::env::var_os("RODGYM_WRITE_GOLDEN").is_some() {
        std::fs::write(FILE, &ours).expect("docs/clients can be written");
    }
    let theirs = std::fs::read_to_string(FILE).expect("docs/clients/golden.jsonl is there");
    for (i, (ours, theirs)) in ours.lines().zip(theirs.lines()).enumerate() {
        assert_eq!(ours, theirs, "line {}", i + 1);
    }
    assert_eq!(ours.lines().count(), theirs.lines().count());
}
