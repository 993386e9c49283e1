//! The loop between a transport and the state machine: short work is done at once, long work on other
//! threads, so that nobody waits for another's batch; reaping, draining.

use crate::error::{Code, Refusal};
use crate::live::Live;
use crate::memory::{self, Charge};
use crate::pool::{Job, Pool};
use crate::server::{Begun, Server, refuse};
use crate::shared::Shared;
use crate::transport::{Request, Transport};
use crate::wire::Frame;
use std::collections::{HashMap, VecDeque};
use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

/// Requests that may wait for one session; beyond that the answer is `busy`.
const WAITING: usize = 256;
/// Time between looks at idle sessions and removed keys.
const TICK: Duration = Duration::from_secs(1);
/// Longest time in which a stop signal goes unnoticed.
const PATIENCE: Duration = Duration::from_millis(100);
/// Nothing for so long while draining means that nothing is in flight: on a busy machine a request
/// that has arrived may take this long to be seen.
const QUIET: Duration = Duration::from_millis(200);
/// Most time that draining takes.
const DRAIN: Duration = Duration::from_secs(10);

/// Answers `true` for users whose sessions may live on.
pub type Allowed = Arc<dyn Fn(&str) -> bool + Send + Sync>;

/// What runs beside the transport.
pub struct Setup {
    /// Limits and counters.
    pub shared: Arc<Shared>,
    /// The state machine.
    pub server: Server,
    /// Threads for long work.
    pub workers: usize,
    /// What is expected to take longer than this is long.
    pub long: Duration,
    /// Who may still be here.
    pub allowed: Allowed,
    /// Pictures for the live page.
    pub live: Arc<Live>,
    /// Asked often: has a stop been requested?
    pub stop: Box<dyn Fn() -> bool>,
}

/// How serving ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Whatever had arrived is answered.
    Drained,
    /// Something was still being computed: its thread is left behind.
    OutOfTime,
}

/// Serves until asked to stop, then finishes what is in flight (10 s at most).
///
/// # Errors
/// The transport is broken for good.
pub fn run(transport: &mut dyn Transport, setup: Setup) -> io::Result<End> {
    let Setup { shared, server, workers, long, allowed, live, stop } = setup;
    let start = Instant::now();
    let pool = Pool::start(workers, transport)?;
    let mut engine = Engine {
        shared,
        server,
        pool,
        long,
        allowed,
        live,
        start,
        due: start,
        waiting: HashMap::new(),
    };
    let mut draining: Option<Instant> = None;
    let mut last = start;
    loop {
        // Listening goes on while draining: libzmq's unbind would cut the connections that exist.
        let timeout = if draining.is_some() { QUIET } else { PATIENCE };
        let request = transport.receive(timeout)?;
        if let Some(request) = request {
            last = Instant::now();
            engine.submit(request, transport);
        }
        engine.deliver(transport);
        engine.keep();
        match draining {
            None if stop() => {
                engine.shared.draining.store(true, Relaxed);
                draining = Some(Instant::now());
            }
            // A waker ends a wait early: only time tells that nothing comes any more.
            Some(since) if since.elapsed() > DRAIN => return Ok(End::OutOfTime),
            Some(since) if since.max(last).elapsed() > QUIET && engine.pool.is_idle() => {
                return Ok(End::Drained);
            }
            _ => {}
        }
    }
}

/// Where a reply goes.
#[derive(Clone, Debug)]
struct To {
    peer: Vec<u8>,
    user: Arc<str>,
}

/// A request that waits for its session.
struct Waiting {
    to: To,
    frames: Vec<Vec<u8>>,
    _charge: Charge,
}

struct Engine {
    shared: Arc<Shared>,
    server: Server,
    pool: Pool<To>,
    long: Duration,
    allowed: Allowed,
    live: Arc<Live>,
    start: Instant,
    due: Instant,
    waiting: HashMap<u128, VecDeque<Waiting>>,
}

impl Engine {
    fn submit(&mut self, request: Request, transport: &mut dyn Transport) {
        let Request { peer, user, frames } = request;
        match user {
            Some(user) => self.begin(To { peer, user: user.into() }, frames, transport),
            None => {
                let refusal = Refusal::new(Code::Denied, "the key of this connection was removed");
                let to = To { peer, user: "".into() };
                self.send(&to, refuse(&self.shared, &frames, refusal), transport);
            }
        }
    }

    fn begin(&mut self, to: To, frames: Vec<Vec<u8>>, transport: &mut dyn Transport) {
        match self.server.begin(self.start.elapsed(), &to.user, frames) {
            Begun::Reply(reply) => self.send(&to, reply, transport),
            Begun::Work(work) if work.expected() <= self.long => {
                let alone = self.pool.is_idle();
                let reply = self.server.finish(work.alone(alone).run());
                self.send(&to, reply, transport);
            }
            Begun::Work(work) => {
                let user = to.user.clone();
                self.pool.submit(Job { user, work, tag: to });
            }
            Begun::Later(sid, frames) => self.wait(sid, to, frames, transport),
        }
    }

    fn wait(&mut self, sid: u128, to: To, frames: Vec<Vec<u8>>, transport: &mut dyn Transport) {
        let queue = self.waiting.entry(sid).or_default();
        let bytes = frames.iter().map(|frame| frame.len() + memory::MESSAGE).sum();
        let refusal = match self.shared.ledger.take(&to.user, bytes) {
            Ok(charge) if queue.len() < WAITING => {
                queue.push_back(Waiting { to, frames, _charge: charge });
                return;
            }
            Ok(_) => {
                let text = format!("{WAITING} requests wait for this session already");
                Refusal::later(Code::Busy, text, 20)
            }
            Err(refusal) => refusal,
        };
        self.send(&to, refuse(&self.shared, &frames, refusal), transport);
    }

    /// Sends what the threads have finished, and begins what waited for it.
    fn deliver(&mut self, transport: &mut dyn Transport) {
        while let Some((to, finished)) = self.pool.finished() {
            let sid = finished.sid();
            let reply = self.server.finish(finished);
            self.send(&to, reply, transport);
            let mut queue = self.waiting.remove(&sid).unwrap_or_default();
            while let Some(Waiting { to, frames, _charge }) = queue.pop_front() {
                self.begin(to, frames, transport);
                // On its way again: the rest stays in order, behind what began to wait just now.
                if let Some(again) = self.waiting.get_mut(&sid) {
                    again.extend(queue.drain(..));
                }
            }
        }
    }

    /// Does what is due now and then.
    fn keep(&mut self) {
        let now = Instant::now();
        let watched = self.live.is_watched();
        if now < self.due && !(watched && now + Live::INTERVAL < self.due) {
            return;
        }
        self.server.reap(self.start.elapsed());
        self.server.revoke(|user| (self.allowed)(user));
        if watched {
            self.live.publish(&self.server);
        }
        self.due = now + if watched { Live::INTERVAL } else { TICK };
    }

    /// Sends a reply, if its user may have so much unread.
    fn send(&self, to: &To, reply: Vec<Frame>, transport: &mut dyn Transport) {
        let bytes = reply.iter().map(|frame| frame.len()).sum::<usize>() + memory::MESSAGE;
        let charge = self.shared.ledger.take(&to.user, bytes);
        if !charge.is_ok_and(|charge| transport.send(&to.peer, reply, charge)) {
            self.shared.metrics.undelivered.fetch_add(1, Relaxed);
        }
    }
}
