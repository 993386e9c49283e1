//! Threads of a step: as many as are granted while nothing else is computed, one otherwise.

mod common;

use common::Desk;
use rodgym_server::limits::Limits;
use rodgym_server::server::Begun;
use rodgym_server::wire;
use serde_json::json;

/// Environments of a batch whose step is believed to take longer than 0.1 ms.
const LARGE: usize = 1000;

/// Takes a step and tells how many threads it used.
fn used(desk: &mut Desk, sid: &str, n: usize, alone: bool) -> u64 {
    let action = wire::array("action", &[n, 1], &vec![0.5f32; n]);
    let frames = desk.request("step", Some(sid), Some(1), json!({}), &[action]);
    let Begun::Work(work) = desk.server.begin(desk.now, &"ada".into(), frames) else {
        panic!("a step is work");
    };
    let reply = common::Reply::read(&desk.server.finish(work.alone(alone).run()));
    assert_eq!(reply.code(), "ok");
    assert_eq!(reply.array::<f32>("obs")[..2], [1.0, 0.5]);
    let scene = desk.ask("render", Some(sid), None, json!({"index": 0}));
    scene.p("scene")["values"]["threads"].as_u64().expect("a number")
}

fn with_threads(threads: usize) -> Desk {
    Desk::new(Limits { threads, ..Limits::default() })
}

#[test]
fn a_long_step_uses_the_threads_while_nothing_else_is_computed() {
    for (threads, n, alone, expected) in
        [(4, LARGE, true, 4), (4, LARGE, false, 1), (4, 2, true, 1), (1, LARGE, true, 1)]
    {
        let mut desk = with_threads(threads);
        let sid = desk.make(n, "NextStep");
        assert_eq!(used(&mut desk, &sid, n, alone), expected, "{threads} {n} {alone}");
    }
}

#[test]
fn all_sessions_together_have_so_many_helpers_and_give_them_back() {
    // 64 are lent: two sessions take 30 each.
    let mut desk = with_threads(31);
    let sids: Vec<String> = (0..4).map(|_| desk.make(LARGE, "NextStep")).collect();
    let found: Vec<u64> = sids[..3].iter().map(|sid| used(&mut desk, sid, LARGE, true)).collect();
    assert_eq!(found, [31, 31, 1]);
    desk.ask("close", Some(&sids[0]), None, json!({}));
    assert_eq!(used(&mut desk, &sids[3], LARGE, true), 31);
}

#[test]
fn where_the_system_grants_no_threads_one_suffices() {
    let mut desk = with_threads(50);
    let sid = desk.make(LARGE, "NextStep");
    assert_eq!(used(&mut desk, &sid, LARGE, true), 1);
}
