//! The server as a pure state machine: frames in, frames out; no sockets, no clock, no randomness of
//! its own.
//!
//! One `Server` owns some sessions. A transport may run several of them (shards) on threads of their
//! own: a session's number says which one owns it, and what they share is in `Shared`.

use crate::error::{Code, Refusal};
use crate::metrics::{Metrics, OPS};
use crate::session::{Answer, Session, field};
use crate::shared::Shared;
use crate::window::Verdict;
use crate::wire::{self, Arrays, ErrorBody, Frame, ReplyHeader, RequestHeader, VERSION};
use rodgym_core::catalog::{self, MakeOptions};
use rodgym_core::env::{AutoresetMode, VectorEnv};
use serde_json::{Map, Value, json};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

/// Makes batches: `catalog::make`, or a test's own environments.
pub type Factory = Box<dyn Fn(&MakeOptions) -> rodgym_core::Result<Box<dyn VectorEnv>> + Send>;

/// Sessions and what is done with them.
pub struct Server {
    shared: Arc<Shared>,
    shard: u8,
    shards: u8,
    sessions: HashMap<u128, Session>,
    by_nonce: HashMap<(String, u128), u128>,
    factory: Factory,
    ids: Box<dyn FnMut() -> u128 + Send>,
}

impl Server {
    /// A server with a single shard over the registry; `ids` gives unpredictable session numbers.
    pub fn new(shared: Arc<Shared>, ids: Box<dyn FnMut() -> u128 + Send>) -> Self {
        Server {
            shared,
            shard: 0,
            shards: 1,
            sessions: HashMap::new(),
            by_nonce: HashMap::new(),
            factory: Box::new(catalog::make),
            ids,
        }
    }

    /// Makes this number `shard` of `shards`.
    pub fn shard(mut self, shard: u8, shards: u8) -> Self {
        (self.shard, self.shards) = (shard, shards);
        self
    }

    /// Makes batches in another way.
    pub fn factory(mut self, factory: Factory) -> Self {
        self.factory = factory;
        self
    }

    /// Answers one request of `user`. Every request gets exactly one reply; a leading empty frame
    /// (as REQ sockets send) is given back. `now` is the time since the server started.
    pub fn handle<F: AsRef<[u8]>>(
        &mut self,
        now: Duration,
        user: &str,
        frames: &[F],
    ) -> Vec<Frame> {
        let delimited = frames.first().is_some_and(|f| f.as_ref().is_empty());
        let body = &frames[usize::from(delimited)..];
        let mut reply = self.answer(now, user, body);
        if delimited {
            reply.insert(0, Frame::from([]));
        }
        reply
    }

    /// Drops sessions that nobody has used for too long.
    pub fn reap(&mut self, now: Duration) -> usize {
        let idle = self.shared.limits.idle();
        let old = |s: &Session| now.saturating_sub(s.used) > idle;
        let dropped = self.drop_where(old);
        self.shared.metrics.reaped.fetch_add(dropped as u64, Relaxed);
        dropped
    }

    /// Drops all sessions of users that are no longer allowed.
    pub fn revoke(&mut self, allowed: impl Fn(&str) -> bool) -> usize {
        let dropped = self.drop_where(|s| !allowed(&s.owner));
        self.shared.metrics.revoked.fetch_add(dropped as u64, Relaxed);
        dropped
    }

    /// Sessions alive, with their numbers.
    pub fn sessions(&self) -> impl Iterator<Item = (u128, &Session)> {
        self.sessions.iter().map(|(sid, session)| (*sid, session))
    }

    fn drop_where(&mut self, condition: impl Fn(&Session) -> bool) -> usize {
        let gone: Vec<u128> =
            self.sessions.iter().filter(|(_, s)| condition(s)).map(|(sid, _)| *sid).collect();
        for sid in &gone {
            self.remove(*sid);
        }
        gone.len()
    }

    fn remove(&mut self, sid: u128) {
        if let Some(session) = self.sessions.remove(&sid) {
            self.shared.release(&session.owner);
            self.by_nonce.remove(&(session.owner, session.made_by.0));
        }
    }

    fn answer<F: AsRef<[u8]>>(&mut self, now: Duration, user: &str, frames: &[F]) -> Vec<Frame> {
        let head = frames.first().map(AsRef::as_ref).unwrap_or_default();
        let header = match wire::decode_request(head, self.shared.limits.header_bytes) {
            Ok(header) => header,
            Err((rid, refusal)) => return self.reply(rid, None, Err(refusal)),
        };
        let most = self.shared.limits.frames;
        if frames.len() > most {
            let text = format!("the request has {} frames; {most} are allowed", frames.len());
            return self.reply(header.rid, None, Err(Refusal::new(Code::Limit, text)));
        }
        self.shared.metrics.request(&header.op);
        let sid = header.sid.as_deref().and_then(parse_id);
        let mine = sid.filter(|sid| self.sessions.get(sid).is_some_and(|s| s.owner == user));
        let arrays = Arrays::new(&header.arr, &frames[1..]);
        // A panic in an environment costs its session, not the server.
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            self.perform(now, user, &header, mine, arrays?, &frames[1..])
        }))
        .unwrap_or_else(|_| {
            if let Some(sid) = mine {
                self.remove(sid);
            }
            let text = format!("'{}' failed inside the server; its session is lost", header.op);
            Err(Refusal::new(Code::Internal, text))
        });
        let last = mine.and_then(|sid| self.sessions.get(&sid)).map(|s| s.window.last());
        self.reply(header.rid, last, outcome)
    }

    fn perform<F: AsRef<[u8]>>(
        &mut self,
        now: Duration,
        user: &str,
        header: &RequestHeader,
        mine: Option<u128>,
        arrays: Arrays,
        frames: &[F],
    ) -> Result<Answer, Refusal> {
        let p = &header.p;
        match header.op.as_str() {
            "hello" => Ok(self.hello(user)),
            "list" => Ok(Answer::of(
                json!({"ids": catalog::entries().iter().map(|e| e.id).collect::<Vec<_>>(), "environments": catalog::entries()}),
            )),
            "ping" => Ok(Answer::of(json!({"uptime": now.as_secs_f64()}))),
            "stats" => Ok(self.stats(user, now)),
            "make" => self.make(now, user, header, frames),
            op if OPS.contains(&op) => {
                let sid = mine.ok_or_else(|| no_session(header.sid.as_deref()))?;
                let session = self.sessions.get_mut(&sid).expect("it was just found");
                session.used = now;
                match op {
                    "touch" => Ok(Answer::default()),
                    "info" => Ok(info(session)),
                    "observe" => session.observe(p),
                    "nodes" => session.nodes(p),
                    "render" => session.scene(p),
                    "get_state" => session.get_state(p, self.shared.limits.message_bytes),
                    "close" => {
                        self.remove(sid);
                        Ok(Answer::default())
                    }
                    _ => change(session, &self.shared.metrics, header, arrays, frames),
                }
            }
            other => {
                let text = format!("unknown operation '{other}'; known are {}", OPS.join(", "));
                Err(Refusal::new(Code::UnknownOp, text))
            }
        }
    }

    fn hello(&self, user: &str) -> Answer {
        Answer::of(json!({
            "versions": [VERSION, VERSION],
            "build": concat!("rodgym-server ", env!("CARGO_PKG_VERSION")),
            "user": user,
            "features": ["exactly_once", "snapshots", "scenes"],
            "limits": self.shared.limits,
            "draining": self.shared.draining.load(Relaxed),
        }))
    }

    fn stats(&self, user: &str, now: Duration) -> Answer {
        let m = &self.shared.metrics;
        Answer::of(json!({
            "uptime": now.as_secs_f64(),
            "sessions": m.sessions.load(Relaxed),
            "own_sessions": self.shared.sessions_of(user),
            "env_steps": m.env_steps.load(Relaxed),
            "replayed": m.replayed.load(Relaxed),
            "reaped": m.reaped.load(Relaxed),
        }))
    }

    fn make<F: AsRef<[u8]>>(
        &mut self,
        now: Duration,
        user: &str,
        header: &RequestHeader,
        frames: &[F],
    ) -> Result<Answer, Refusal> {
        let p = &header.p;
        let nonce: String = field(p, "nonce")?;
        let nonce = parse_id(&nonce).ok_or_else(|| {
            let text = format!("parameter 'nonce' = '{nonce}' is not 32 hexadecimal digits");
            Refusal::new(Code::BadRequest, text)
        })?;
        let digest = digest(header, frames);
        if let Some(sid) = self.by_nonce.get(&(user.to_string(), nonce)) {
            let session = &self.sessions[sid];
            if session.made_by.1 != digest {
                let text = "this nonce has made another session with other parameters";
                return Err(Refusal::new(Code::NonceConflict, text));
            }
            self.shared.metrics.replayed.fetch_add(1, Relaxed);
            return Ok(session.greeting.clone());
        }
        if self.shared.draining.load(Relaxed) {
            return Err(Refusal::later(Code::Draining, "this server is shutting down", 5000));
        }
        let options = self.make_options(user, p)?;
        self.shared.admit(user)?;
        let made = catch_unwind(AssertUnwindSafe(|| (self.factory)(&options)));
        let env = match made {
            Ok(Ok(env)) => env,
            failed => {
                self.shared.release(user);
                let text = format!("making '{}' failed inside the server", options.id);
                return match failed {
                    Ok(Err(error)) => Err(error.into()),
                    _ => Err(Refusal::new(Code::Internal, text)),
                };
            }
        };
        let (bytes, most) = (Session::largest_reply(&*env), self.shared.limits.message_bytes);
        if bytes > most {
            self.shared.release(user);
            let text = format!("a step of this batch could need {bytes} bytes; {most} are allowed");
            return Err(Refusal::new(Code::Limit, text));
        }
        let granted = self.shared.limits.window;
        let window = field::<Option<usize>>(p, "window")?.unwrap_or(granted).clamp(1, granted);
        let sid = self.new_id();
        let mut session = Session::new(env, user, (nonce, digest), window, now);
        session.greeting = greeting(sid, window, session.env());
        let answer = session.greeting.clone();
        self.sessions.insert(sid, session);
        self.by_nonce.insert((user.into(), nonce), sid);
        self.shared.metrics.made.fetch_add(1, Relaxed);
        Ok(answer)
    }

    fn make_options(&self, user: &str, p: &Map<String, Value>) -> Result<MakeOptions, Refusal> {
        let num_envs = field::<Option<usize>>(p, "num_envs")?.unwrap_or(1);
        let most = self.shared.user_limits(user).envs.unwrap_or(self.shared.limits.envs);
        if num_envs == 0 || num_envs > most {
            let text = format!("num_envs = {num_envs} is not allowed: 1 to {most}");
            return Err(Refusal::new(Code::Limit, text));
        }
        let mode = field::<Option<AutoresetMode>>(p, "autoreset_mode")?;
        let mut options = MakeOptions {
            id: field(p, "id")?,
            num_envs,
            kwargs: field(p, "kwargs")?,
            autoreset_mode: mode.unwrap_or(AutoresetMode::NextStep),
            max_episode_steps: field(p, "max_episode_steps")?,
            num_threads: self.shared.limits.threads,
        };
        // Absent means the environment's own time limit; null means none.
        if !p.contains_key("max_episode_steps") {
            let one = (self.factory)(&MakeOptions { num_envs: 1, ..options.clone() })?;
            options.max_episode_steps = Some(one.spec().default_max_episode_steps);
        }
        Ok(options)
    }

    /// A free session number whose first byte names this shard.
    fn new_id(&mut self) -> u128 {
        loop {
            let id = (self.ids)();
            let byte = (id >> 120) as u8;
            let byte = byte - byte % self.shards;
            let byte = byte.checked_add(self.shard).unwrap_or(self.shard);
            let id = id & (u128::MAX >> 8) | u128::from(byte) << 120;
            if !self.sessions.contains_key(&id) {
                return id;
            }
        }
    }

    fn reply(&self, rid: u64, seq: Option<u64>, outcome: Result<Answer, Refusal>) -> Vec<Frame> {
        let epoch = self.shared.epoch.clone();
        let mut header = ReplyHeader { v: VERSION, rid, seq, epoch, ..ReplyHeader::default() };
        let mut frames = Vec::new();
        match outcome {
            Ok(answer) => {
                header.ok = true;
                header.arr = answer.arr;
                header.p = answer.p;
                frames = answer.frames;
            }
            Err(refusal) => {
                self.shared.metrics.error(refusal.code);
                header.err = Some(ErrorBody::from(&refusal));
                header.p = refusal.details;
            }
        }
        let mut reply = Vec::with_capacity(1 + frames.len());
        reply.push(Frame::from(wire::encode(&header)));
        reply.append(&mut frames);
        reply
    }
}

/// A refusal for a transport to send by itself, such as `busy` while a shard's queue is full.
pub fn refuse<F: AsRef<[u8]>>(shared: &Shared, frames: &[F], refusal: Refusal) -> Vec<Frame> {
    let delimited = frames.first().is_some_and(|f| f.as_ref().is_empty());
    let head = frames.get(usize::from(delimited)).map(AsRef::as_ref).unwrap_or_default();
    let rid = match wire::decode_request(head, shared.limits.header_bytes) {
        Ok(header) => header.rid,
        Err((rid, _)) => rid,
    };
    shared.metrics.error(refusal.code);
    let header = ReplyHeader {
        v: VERSION,
        rid,
        epoch: shared.epoch.clone(),
        err: Some(ErrorBody::from(&refusal)),
        p: refusal.details,
        ..ReplyHeader::default()
    };
    let mut reply = vec![Frame::from(wire::encode(&header))];
    if delimited {
        reply.insert(0, Frame::from([]));
    }
    reply
}

/// Which of `shards` a request belongs to: its session's, else one chosen by the nonce of `make`.
pub fn shard_of<F: AsRef<[u8]>>(frames: &[F], shards: u8, header_bytes: usize) -> u8 {
    let delimited = frames.first().is_some_and(|f| f.as_ref().is_empty());
    let head = frames.get(usize::from(delimited)).map(AsRef::as_ref).unwrap_or_default();
    let Ok(header) = wire::decode_request(head, header_bytes) else { return 0 };
    let nonce = header.p.get("nonce").and_then(Value::as_str);
    let id = header.sid.as_deref().or(nonce).and_then(parse_id);
    id.map_or(0, |id| (id >> 120) as u8 % shards)
}

/// Carries out a numbered call, or answers it from memory.
fn change<F: AsRef<[u8]>>(
    session: &mut Session,
    metrics: &Metrics,
    header: &RequestHeader,
    arrays: Arrays,
    frames: &[F],
) -> Result<Answer, Refusal> {
    let seq = header.seq.ok_or_else(|| {
        Refusal::new(Code::BadRequest, format!("'{}' needs a sequence number 'seq'", header.op))
    })?;
    let digest = digest(header, frames);
    let last = session.window.last();
    match session.window.judge(seq, digest) {
        Verdict::Run => {}
        Verdict::Cached(answer) => {
            metrics.replayed.fetch_add(1, Relaxed);
            return Ok(answer.clone());
        }
        Verdict::Stale => {
            let text = format!("seq {seq} is older than the replies kept; the last was {last}");
            return Err(Refusal::new(Code::StaleSeq, text));
        }
        Verdict::Gap => {
            let text = format!("seq {seq} is ahead; the next is {}", last + 1);
            return Err(Refusal::new(Code::SeqGap, text));
        }
        Verdict::Conflict => {
            let text = format!("seq {seq} was used for a call with other content");
            return Err(Refusal::new(Code::SeqConflict, text));
        }
    }
    let answer = match header.op.as_str() {
        "reset" => session.reset(&header.p, &arrays)?,
        "set_state" => session.set_state(&header.p, &arrays)?,
        _ => {
            let start = Instant::now();
            let answer = session.step(&arrays)?;
            metrics.step(session.env().num_envs(), start.elapsed());
            answer
        }
    };
    session.window.record(digest, answer.clone());
    Ok(answer)
}

/// Checksum of what a call asks for, whatever number it carries.
fn digest<F: AsRef<[u8]>>(header: &RequestHeader, frames: &[F]) -> u32 {
    let content = serde_json::to_vec(&(&header.op, &header.p, &header.arr))
        .expect("a header was made of JSON values");
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&content);
    for frame in frames {
        hasher.update(frame.as_ref());
    }
    hasher.finalize()
}

fn greeting(sid: u128, window: usize, env: &dyn VectorEnv) -> Answer {
    Answer::of(json!({
        "sid": format!("{sid:032x}"),
        "window": window,
        "num_envs": env.num_envs(),
        "autoreset_mode": env.autoreset_mode(),
        "max_episode_steps": env.max_episode_steps(),
        "spec": env.spec(),
    }))
}

fn info(session: &Session) -> Answer {
    let env = session.env();
    Answer::of(json!({
        "id": env.spec().id,
        "num_envs": env.num_envs(),
        "autoreset_mode": env.autoreset_mode(),
        "max_episode_steps": env.max_episode_steps(),
        "config": env.spec().config,
        "steps": session.steps,
    }))
}

fn no_session(sid: Option<&str>) -> Refusal {
    let text = match sid {
        // A foreign session answers like an unknown one.
        Some(_) => {
            "there is no such session: it was closed, idle for too long, or the server restarted"
        }
        None => "this operation needs a session 'sid'; 'make' gives one",
    };
    Refusal::new(Code::NoSession, text)
}

/// 32 hexadecimal digits as a number.
fn parse_id(text: &str) -> Option<u128> {
    let digits = text.len() == 32 && text.bytes().all(|b| b.is_ascii_hexdigit());
    digits.then(|| u128::from_str_radix(text, 16).ok()).flatten()
}
