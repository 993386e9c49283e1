//! The loop between a transport and the state machine: shards on threads, reaping, draining.

use crate::error::{Code, Refusal};
use crate::live::Live;
use crate::server::{Server, refuse, shard_of};
use crate::shared::Shared;
use crate::transport::{Request, Transport, Waker};
use crate::wire::Frame;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed, Ordering::SeqCst};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Requests that may wait for one worker; beyond that the answer is `busy`.
const QUEUE: usize = 256;
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
    /// Common part of all shards.
    pub shared: Arc<Shared>,
    /// Shards: one computes in the calling thread, more have threads of their own.
    pub shards: Vec<Server>,
    /// Who may still be here.
    pub allowed: Allowed,
    /// Pictures for the live page.
    pub live: Arc<Live>,
    /// Asked often: has a stop been requested?
    pub stop: Box<dyn Fn() -> bool>,
}

/// Serves until asked to stop, then finishes what is in flight (10 s at most).
///
/// # Errors
/// The transport is broken for good.
pub fn run(transport: &mut dyn Transport, setup: Setup) -> io::Result<()> {
    let Setup { shared, mut shards, allowed, live, stop } = setup;
    let start = Instant::now();
    let keeper = Keeper { allowed, live, start };
    let mut engine = if shards.len() == 1 {
        let server = shards.pop().expect("its length is 1");
        Engine::Inline { server: Box::new(server), keeper, due: Instant::now() }
    } else {
        Engine::Workers(Workers::start(shards, keeper, transport)?)
    };
    let mut draining: Option<Instant> = None;
    let mut last = start;
    loop {
        // Listening goes on while draining: libzmq's unbind would cut the connections that exist.
        let timeout = if draining.is_some() { QUIET } else { PATIENCE };
        let request = transport.receive(timeout)?;
        if let Some(request) = request {
            last = Instant::now();
            engine.submit(request, &shared, start, transport);
        }
        engine.deliver(&shared, transport);
        engine.tick();
        match draining {
            None if stop() => {
                shared.draining.store(true, Relaxed);
                draining = Some(Instant::now());
            }
            // A waker ends a wait early: only time tells that nothing comes any more.
            Some(since) if since.elapsed() > DRAIN => return Ok(()),
            Some(since) if since.max(last).elapsed() > QUIET && engine.idle() => return Ok(()),
            _ => {}
        }
    }
}

/// What a shard does beside answering.
#[derive(Clone)]
struct Keeper {
    allowed: Allowed,
    live: Arc<Live>,
    start: Instant,
}

impl Keeper {
    /// Does what is due and tells when to come again.
    fn keep(&self, part: usize, server: &mut Server) -> Instant {
        server.reap(self.start.elapsed());
        server.revoke(|user| (self.allowed)(user));
        if self.live.is_watched() {
            self.live.publish(part, server);
            return Instant::now() + Live::INTERVAL;
        }
        Instant::now() + TICK
    }
}

enum Engine {
    Inline { server: Box<Server>, keeper: Keeper, due: Instant },
    Workers(Workers),
}

impl Engine {
    fn submit(
        &mut self,
        request: Request,
        shared: &Shared,
        start: Instant,
        transport: &mut dyn Transport,
    ) {
        let Some(user) = &request.user else {
            let refusal = Refusal::new(Code::Denied, "the key of this connection was removed");
            return send(
                transport,
                shared,
                &request.peer,
                &refuse(shared, &request.frames, refusal),
            );
        };
        match self {
            Engine::Inline { server, .. } => {
                let reply = server.handle(start.elapsed(), user, &request.frames);
                send(transport, shared, &request.peer, &reply);
            }
            Engine::Workers(workers) => {
                if let Err(request) = workers.submit(request, shared) {
                    let text = "too many requests wait for this session's thread";
                    let refusal = Refusal::later(Code::Busy, text, 20);
                    let reply = refuse(shared, &request.frames, refusal);
                    send(transport, shared, &request.peer, &reply);
                }
            }
        }
    }

    fn deliver(&mut self, shared: &Shared, transport: &mut dyn Transport) {
        if let Engine::Workers(workers) = self {
            while let Ok((peer, reply)) = workers.replies.try_recv() {
                send(transport, shared, &peer, &reply);
                workers.in_flight.fetch_sub(1, SeqCst);
            }
        }
    }

    fn tick(&mut self) {
        if let Engine::Inline { server, keeper, due } = self
            && Instant::now() >= *due
        {
            *due = keeper.keep(0, server);
        }
    }

    fn idle(&self) -> bool {
        match self {
            Engine::Inline { .. } => true,
            Engine::Workers(workers) => workers.in_flight.load(SeqCst) == 0,
        }
    }
}

fn send(transport: &mut dyn Transport, shared: &Shared, peer: &[u8], reply: &[Frame]) {
    if !transport.send(peer, reply) {
        shared.metrics.undelivered.fetch_add(1, Relaxed);
    }
}

type Answered = (Vec<u8>, Vec<Frame>);

/// One thread a shard; a session stays with its thread for life.
struct Workers {
    queues: Vec<SyncSender<Request>>,
    replies: Receiver<Answered>,
    in_flight: Arc<AtomicUsize>,
    threads: Vec<JoinHandle<()>>,
}

impl Workers {
    fn start(
        shards: Vec<Server>,
        keeper: Keeper,
        transport: &mut dyn Transport,
    ) -> io::Result<Self> {
        let (done, replies) = channel();
        let (mut queues, mut threads) = (Vec::new(), Vec::new());
        for (part, mut server) in shards.into_iter().enumerate() {
            let (queue, requests) = sync_channel(QUEUE);
            let (done, keeper, waker) = (done.clone(), keeper.clone(), transport.waker()?);
            let work = move || work(part, &mut server, &requests, &done, &keeper, &waker);
            threads.push(std::thread::Builder::new().name(format!("shard-{part}")).spawn(work)?);
            queues.push(queue);
        }
        Ok(Workers { queues, replies, in_flight: Arc::default(), threads })
    }

    /// Hands a request over, or gives it back if that thread has too much to do.
    fn submit(&self, request: Request, shared: &Shared) -> Result<(), Request> {
        let shards = self.queues.len() as u8;
        let shard = shard_of(&request.frames, shards, shared.limits.header_bytes);
        self.in_flight.fetch_add(1, SeqCst);
        self.queues[usize::from(shard)].try_send(request).map_err(|refused| {
            self.in_flight.fetch_sub(1, SeqCst);
            match refused {
                std::sync::mpsc::TrySendError::Full(request)
                | std::sync::mpsc::TrySendError::Disconnected(request) => request,
            }
        })
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        self.queues.clear();
        for thread in self.threads.drain(..) {
            // A worker only panics outside of `handle`, which leaves nothing to save.
            let _ = thread.join();
        }
    }
}

fn work(
    part: usize,
    server: &mut Server,
    requests: &Receiver<Request>,
    done: &Sender<Answered>,
    keeper: &Keeper,
    waker: &Waker,
) {
    let mut due = Instant::now();
    loop {
        // A short wait, so that a page that begins to watch is served soon.
        match requests.recv_timeout(PATIENCE) {
            Ok(Request { peer, user, frames }) => {
                let user = user.expect("requests without a user are refused by the front");
                let reply = server.handle(keeper.start.elapsed(), &user, &frames);
                if done.send((peer, reply)).is_err() {
                    return;
                }
                waker();
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        let now = Instant::now();
        if now >= due || (keeper.live.is_watched() && now + Live::INTERVAL < due) {
            due = keeper.keep(part, server);
        }
    }
}
