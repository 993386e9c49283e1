//! The loop between transport and state machine, over a transport in memory: the same trajectory however
//! many threads compute, users kept apart, requests that arrived finished before the end.

mod common;

use common::{Counters, Desk, Reply};
use rodgym_server::limits::Limits;
use rodgym_server::live::Live;
use rodgym_server::memory::Charge;
use rodgym_server::run::{End, Setup, run};
use rodgym_server::server::Server;
use rodgym_server::shared::Shared;
use rodgym_server::transport::{Request, Transport, Waker};
use rodgym_server::wire::{self, Frame};
use serde_json::json;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// Requests and wake-ups come in over one channel, replies go out over another.
struct Memory {
    incoming: Receiver<Option<Request>>,
    wake: Sender<Option<Request>>,
    outgoing: Sender<(Vec<u8>, Vec<Frame>)>,
}

impl Transport for Memory {
    fn receive(&mut self, timeout: Duration) -> io::Result<Option<Request>> {
        Ok(self.incoming.recv_timeout(timeout).unwrap_or(None))
    }
    fn send(&mut self, peer: &[u8], reply: Vec<Frame>, _: Charge) -> bool {
        peer != b"gone" && self.outgoing.send((peer.to_vec(), reply)).is_ok()
    }
    fn waker(&mut self) -> io::Result<Waker> {
        let wake = self.wake.clone();
        Ok(Box::new(move || {
            let _ = wake.send(None);
        }))
    }
}

/// A running server and the other ends of its channels.
struct Running {
    requests: Sender<Option<Request>>,
    replies: Receiver<(Vec<u8>, Vec<Frame>)>,
    stop: Arc<AtomicBool>,
    shared: Arc<Shared>,
    thread: std::thread::JoinHandle<io::Result<End>>,
}

/// `workers` threads compute what takes longer than `long`.
fn start(workers: usize, long: Duration, limits: Limits, allowed: fn(&str) -> bool) -> Running {
    let (requests, incoming) = channel();
    let (outgoing, replies) = channel();
    let stop = Arc::new(AtomicBool::new(false));
    let shared = Arc::new(Shared::new(limits, "epoch"));
    let mut memory = Memory { incoming, wake: requests.clone(), outgoing };
    let (stopping, common) = (stop.clone(), shared.clone());
    let serve = move || {
        let mut next = 1u128;
        let ids = move || {
            next = next.wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835);
            next
        };
        let server = Server::new(common.clone(), Box::new(ids));
        let setup = Setup {
            shared: common,
            server: server.factory(Arc::new(Counters::boxed)),
            workers,
            long,
            allowed: Arc::new(allowed),
            live: Arc::new(Live::default()),
            stop: Box::new(move || stopping.load(SeqCst)),
        };
        run(&mut memory, setup)
    };
    Running { requests, replies, stop, shared, thread: std::thread::spawn(serve) }
}

/// Everything at once in the loop's thread, or everything on threads.
const HOW: [(usize, Duration); 3] = [(1, Duration::MAX), (1, Duration::ZERO), (3, Duration::ZERO)];

impl Running {
    fn send(&self, peer: &[u8], user: Option<&str>, frames: Vec<Vec<u8>>) {
        let request = Request { peer: peer.to_vec(), user: user.map(Into::into), frames };
        self.requests.send(Some(request)).expect("the server runs");
    }

    fn reply(&self) -> (Vec<u8>, Reply) {
        let wait = Duration::from_secs(10);
        let (peer, frames) = self.replies.recv_timeout(wait).expect("every request is answered");
        (peer, Reply::read(&frames))
    }

    fn ask(&self, frames: Vec<Vec<u8>>) -> Reply {
        self.send(b"peer", Some("ada"), frames);
        self.reply().1
    }

    fn end(self) {
        self.stop.store(true, SeqCst);
        self.thread.join().expect("no panic").expect("no fault");
    }
}

fn make(desk: &Desk, nonce: u8) -> Vec<Vec<u8>> {
    let nonce = format!("{nonce:02x}").repeat(16);
    desk.request("make", None, None, json!({"id": "test/Counter-v0", "nonce": nonce}), &[])
}

fn step(desk: &Desk, sid: &str, seq: u64) -> Vec<Vec<u8>> {
    let action = wire::array("action", &[1, 1], &[0.5f32]);
    desk.request("step", Some(sid), Some(seq), json!({}), &[action])
}

#[test]
fn any_number_of_threads_gives_the_same_replies() {
    let desk = Desk::new(Limits::default());
    for (workers, long) in HOW {
        let server = start(workers, long, Limits::default(), |_| true);
        // Steps of many sessions, interleaved.
        let sids: Vec<String> = (0..20)
            .map(|i| server.ask(make(&desk, i * 11)).p("sid").as_str().expect("text").into())
            .collect();
        for seq in 1..=3 {
            for sid in &sids {
                let reply = server.ask(step(&desk, sid, seq));
                assert_eq!(reply.array::<f32>("obs"), [seq as f32, seq as f32 * 0.5]);
            }
        }
        server.end();
    }
}

#[test]
fn what_arrived_is_answered_before_the_end() {
    let desk = Desk::new(Limits::default());
    for (workers, long) in HOW {
        let server = start(workers, long, Limits::default(), |_| true);
        let sid: String = server.ask(make(&desk, 7)).p("sid").as_str().expect("text").into();
        server.stop.store(true, SeqCst);
        for seq in 1..=200 {
            server.send(b"peer", Some("ada"), step(&desk, &sid, seq));
        }
        let began = Instant::now();
        for seq in 1..=200 {
            assert_eq!(server.reply().1.header.seq, Some(seq));
        }
        server.thread.join().expect("no panic").expect("no fault");
        assert!(began.elapsed() < Duration::from_secs(5), "nothing was in flight any more");
    }
}

#[test]
fn a_removed_user_is_refused_and_its_sessions_go() {
    let desk = Desk::new(Limits::default());
    let server = start(2, Duration::ZERO, Limits::default(), |user| user != "ada");
    server.ask(make(&desk, 1));
    let end = Instant::now() + Duration::from_secs(5);
    while server.shared.metrics.revoked.load(SeqCst) == 0 {
        assert!(Instant::now() < end, "the session goes within five seconds");
        std::thread::sleep(Duration::from_millis(20));
    }
    server.send(b"peer", None, desk.request("ping", None, None, json!({}), &[]));
    assert_eq!(server.reply().1.code(), "denied");
    server.end();
}

#[test]
fn a_peer_that_is_gone_is_counted_and_others_are_served() {
    let desk = Desk::new(Limits::default());
    let server = start(1, Duration::MAX, Limits::default(), |_| true);
    server.send(b"gone", Some("ada"), desk.request("ping", None, None, json!({}), &[]));
    assert_eq!(server.ask(desk.request("ping", None, None, json!({}), &[])).code(), "ok");
    assert_eq!(server.shared.metrics.undelivered.load(SeqCst), 1);
    server.end();
}
