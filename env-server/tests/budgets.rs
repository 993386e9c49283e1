//! Places and memory are promised before they are used, and come back on every way out.

mod common;

use common::{Counters, Desk};
use rodgym_core::catalog;
use rodgym_server::limits::Limits;
use serde_json::{Value, json};
use std::sync::Arc;

fn make(desk: &mut Desk, p: Value) -> common::Reply {
    let mut all = json!({"id": "test/Counter-v0", "nonce": "0".repeat(32)});
    all.as_object_mut().expect("a map").extend(p.as_object().expect("a map").clone());
    desk.ask("make", None, None, all)
}

/// Nothing is promised to anybody.
fn is_empty(desk: &mut Desk) -> bool {
    let stats = desk.ask("stats", None, None, json!({}));
    stats.p("sessions") == 0 && stats.p("own_sessions") == 0 && stats.p("memory_bytes") == 0
}

#[test]
fn a_refused_make_keeps_no_place_whatever_is_wrong_with_it() {
    let limits = Limits { sessions_per_user: 2, sessions: 3, envs: 8, ..Limits::default() };
    let mut desk = Desk::new(limits);
    let wrong = [
        json!({"window": "many"}),
        json!({"window": -1}),
        json!({"num_envs": 9}),
        json!({"num_envs": 0}),
        json!({"num_envs": 1.5}),
        json!({"autoreset_mode": "Never"}),
        json!({"max_episode_steps": -1}),
        json!({"max_episode_steps": "none"}),
        json!({"kwargs": {"wdith": 1}}),
        json!({"kwargs": []}),
        json!({"id": "test/Other-v0"}),
        json!({"id": 7}),
        json!({"nonce": 7}),
        json!({"nonce": "x".repeat(32)}),
    ];
    for p in &wrong {
        for _ in 0..4 {
            assert!(!make(&mut desk, p.clone()).header.ok, "{p}");
        }
        assert!(is_empty(&mut desk), "{p}");
    }
    // Both places are there, and come back with the sessions.
    for _ in 0..3 {
        let (first, second) = (desk.make(1, "NextStep"), desk.make(8, "SameStep"));
        assert_eq!(make(&mut desk, json!({})).code(), "limit");
        for sid in [first, second] {
            assert_eq!(desk.ask("close", Some(&sid), None, json!({})).code(), "ok");
        }
        assert!(is_empty(&mut desk));
    }
}

#[test]
fn a_batch_that_panics_while_it_is_made_keeps_no_place() {
    let mut desk = Desk::new(Limits { sessions_per_user: 2, ..Limits::default() });
    desk.server = desk.server.factory(Arc::new(|options: &catalog::MakeOptions| {
        assert!(options.num_envs < 3, "too many to be made");
        Counters::boxed(options)
    }));
    for _ in 0..5 {
        assert_eq!(make(&mut desk, json!({"num_envs": 3})).code(), "internal");
        assert!(is_empty(&mut desk));
    }
    assert_eq!(make(&mut desk, json!({"num_envs": 2})).code(), "ok");
}

#[test]
fn memory_is_refused_before_it_is_taken_with_the_number() {
    let mut desk = Desk::new(Limits {
        memory_bytes: 30 << 20,
        memory_per_user_bytes: 20 << 20,
        ..Limits::default()
    });
    // 4096 environments of a few kilobytes fit once, not twice.
    let sid = desk.make(4096, "NextStep");
    let refused = make(&mut desk, json!({"num_envs": 4096})).header.err.expect("a refusal");
    assert_eq!((refused.code.as_str(), refused.retry.as_str()), ("limit", "same"));
    assert!(refused.msg.contains("20971520") && refused.msg.contains("ada"), "{}", refused.msg);
    // Another user has memory of its own, within what the server has.
    desk.user = "bob".into();
    let refused = make(&mut desk, json!({"num_envs": 4096})).header.err.expect("a refusal");
    assert!(refused.msg.contains("31457280") && refused.msg.contains("server"), "{}", refused.msg);
    assert_eq!(make(&mut desk, json!({"num_envs": 64})).code(), "ok");
    desk.user = "ada".into();
    desk.ask("close", Some(&sid), None, json!({}));
    desk.user = "bob".into();
    assert_eq!(make(&mut desk, json!({"num_envs": 4096, "nonce": "1".repeat(32)})).code(), "ok");
}

#[test]
fn what_can_never_fit_is_refused_for_good() {
    let mut desk = Desk::new(Limits { memory_per_user_bytes: 1 << 20, ..Limits::default() });
    let refused = make(&mut desk, json!({"num_envs": 4096})).header.err.expect("a refusal");
    assert_eq!((refused.code.as_str(), refused.retry.as_str()), ("limit", "never"));
}

#[test]
fn a_step_that_would_take_long_is_refused_by_name() {
    let mut desk = Desk::new(Limits::default());
    desk.server = desk.server.factory(Arc::new(catalog::make));
    let long = json!({
        "id": "rodgym/PendulumSwingUp-v0",
        "kwargs": {"nodes": 1001, "control_dt": 1.0, "physics_dt": 1e-5},
    });
    let refused = make(&mut desk, long).header.err.expect("a refusal");
    assert_eq!((refused.code.as_str(), refused.retry.as_str()), ("limit", "never"));
    for number in ["100100000", "1001 nodes", "100000 physics steps", "10000000"] {
        assert!(refused.msg.contains(number), "{number}: {}", refused.msg);
    }
    assert!(is_empty(&mut desk));
    // Every environment of ours may be had 4096 times.
    for catalog::Entry { id, .. } in catalog::entries() {
        let reply = make(&mut desk, json!({"id": id, "num_envs": 4096, "window": 1}));
        assert_eq!(reply.code(), "ok", "{id}: {:?}", reply.header.err);
        let sid = reply.p("sid").as_str().expect("text").to_string();
        desk.ask("close", Some(&sid), None, json!({}));
    }
}
