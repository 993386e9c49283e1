//! The server as a pure state machine: frames in, frames out; no sockets, no threads, no clock, no
//! randomness of its own.
//!
//! `begin` judges a request. What a session has to compute comes out as `Work`, with the session inside,
//! for the caller to run where it likes; `finish` takes the session back and gives the reply. `handle`
//! does all of it at once.

use crate::error::{Code, Refusal};
use crate::metrics::OPS;
use crate::session::{Answer, Session, field, lists_from_arrays};
pub use crate::shared::Factory;
use crate::shared::Shared;
use crate::size::Size;
use crate::window::Digest;
use crate::wire::{self, Arrays, ErrorBody, Frame, ReplyHeader, RequestHeader, VERSION};
use crate::work::{Finished, Making, Task, Ticket, Work};
use rodgym_core::catalog::{self, MakeOptions};
use rodgym_core::env::AutoresetMode;
use serde_json::{Map, Value, json};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

/// What `list` answers: ids, and what each stands for.
fn list() -> Value {
    let entries = catalog::entries();
    let ids: Vec<&str> = entries.iter().map(|entry| entry.id).collect();
    json!({"ids": ids, "environments": entries})
}

/// Sessions and what is done with them.
pub struct Server {
    shared: Arc<Shared>,
    sessions: HashMap<u128, Slot>,
    by_nonce: HashMap<(Arc<str>, u128), u128>,
    factory: Factory,
    ids: Box<dyn FnMut() -> u128 + Send>,
    /// Nobody else knows it, so nobody finds two calls with one digest.
    key: [u8; 32],
}

/// Who owns a session, and the session unless it is being worked on.
struct Slot {
    owner: Arc<str>,
    /// What `make` was called with: nonce and digest of its content.
    made_by: (u128, Digest),
    session: Option<Box<Session>>,
    /// To be dropped when it comes back.
    doomed: bool,
}

/// What becomes of a request.
pub enum Begun {
    /// It is answered.
    Reply(Vec<Frame>),
    /// This is to be run and finished.
    Work(Work),
    /// The session is being worked on: begin again with these frames once that is finished.
    Later(u128, Vec<Vec<u8>>),
}

/// The same, before a reply has its frames.
enum Next {
    Answer(Option<u128>, Answer),
    Work(u128, Duration, Task),
    Later(u128),
}

impl Server {
    /// A server over the registry; `ids` gives unpredictable numbers.
    pub fn new(shared: Arc<Shared>, mut ids: Box<dyn FnMut() -> u128 + Send>) -> Self {
        let mut key = [0; 32];
        key[..16].copy_from_slice(&ids().to_le_bytes());
        key[16..].copy_from_slice(&ids().to_le_bytes());
        Server {
            shared,
            sessions: HashMap::new(),
            by_nonce: HashMap::new(),
            factory: Arc::new(catalog::make),
            ids,
            key,
        }
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
        let frames = frames.iter().map(|f| f.as_ref().to_vec()).collect();
        match self.begin(now, &user.into(), frames) {
            Begun::Reply(reply) => reply,
            Begun::Work(work) => self.finish(work.run()),
            Begun::Later(..) => unreachable!("nothing is being worked on between two calls"),
        }
    }

    /// Judges one request of `user`.
    pub fn begin(&mut self, now: Duration, user: &Arc<str>, mut frames: Vec<Vec<u8>>) -> Begun {
        let delimited = frames.first().is_some_and(Vec::is_empty);
        let mut ticket = Ticket { rid: 0, delimited };
        let body = &frames[usize::from(delimited)..];
        let head = body.first().map(Vec::as_slice).unwrap_or_default();
        let header = match wire::decode_request(head, self.shared.limits.header_bytes) {
            Ok(header) => header,
            Err((rid, refusal)) => {
                ticket.rid = rid;
                return Begun::Reply(self.reply(ticket, None, Err(refusal)));
            }
        };
        ticket.rid = header.rid;
        let sid = header.sid.as_deref().and_then(parse_id).filter(|sid| self.owns(user, *sid));
        // What no session does can still panic: a one-environment batch is made to be measured.
        let next = catch_unwind(AssertUnwindSafe(|| self.judge(now, user, &header, sid, body)));
        let next = next.unwrap_or_else(|_| {
            let text = format!("'{}' failed inside the server", header.op);
            Err(Refusal::new(Code::Internal, text))
        });
        match next {
            Ok(Next::Answer(sid, answer)) => Begun::Reply(self.reply(ticket, sid, Ok(answer))),
            Ok(Next::Later(sid)) => Begun::Later(sid, frames),
            Ok(Next::Work(sid, expected, mut task)) => {
                if let Task::Operate { frames: arrays, header: h, .. } = &mut task {
                    *arrays = frames.split_off(usize::from(delimited) + 1);
                    **h = header;
                }
                Begun::Work(Work {
                    sid,
                    ticket,
                    expected,
                    alone: false,
                    shared: self.shared.clone(),
                    task,
                })
            }
            Err(refusal) => Begun::Reply(self.reply(ticket, sid, Err(refusal))),
        }
    }

    /// Takes a session back from its work and gives the reply.
    pub fn finish(&mut self, finished: Finished) -> Vec<Frame> {
        let Finished { sid, ticket, session, outcome } = finished;
        let slot = self.sessions.get_mut(&sid).expect("a slot stays while its session is away");
        match session {
            Some(_) if slot.doomed => {
                self.remove(sid);
                self.shared.metrics.revoked.fetch_add(1, Relaxed);
            }
            Some(session) => slot.session = Some(session),
            None => self.remove(sid),
        }
        // The reply of `make` is of no session yet.
        let made = matches!(&outcome, Ok(answer) if answer.p.contains_key("sid"));
        self.reply(ticket, (!made).then_some(sid), outcome)
    }

    /// Drops sessions that nobody has used for too long.
    pub fn reap(&mut self, now: Duration) -> usize {
        let idle = self.shared.limits.idle();
        let old =
            |slot: &Slot| slot.session.as_ref().is_some_and(|s| now.saturating_sub(s.used) > idle);
        let dropped = self.drop_where(old);
        self.shared.metrics.reaped.fetch_add(dropped as u64, Relaxed);
        dropped
    }

    /// Drops all sessions of users that are no longer allowed.
    pub fn revoke(&mut self, allowed: impl Fn(&str) -> bool) -> usize {
        for slot in self.sessions.values_mut().filter(|slot| slot.session.is_none()) {
            slot.doomed |= !allowed(&slot.owner);
        }
        let dropped = self.drop_where(|slot| slot.session.is_some() && !allowed(&slot.owner));
        self.shared.metrics.revoked.fetch_add(dropped as u64, Relaxed);
        dropped
    }

    /// Sessions alive: number, owner, and the session unless it is being worked on.
    pub fn sessions(&self) -> impl Iterator<Item = (u128, &str, Option<&Session>)> {
        self.sessions.iter().map(|(sid, slot)| (*sid, &*slot.owner, slot.session.as_deref()))
    }

    fn drop_where(&mut self, condition: impl Fn(&Slot) -> bool) -> usize {
        let gone: Vec<u128> =
            self.sessions.iter().filter(|(_, s)| condition(s)).map(|(sid, _)| *sid).collect();
        for sid in &gone {
            self.remove(*sid);
        }
        gone.len()
    }

    fn remove(&mut self, sid: u128) {
        if let Some(slot) = self.sessions.remove(&sid) {
            self.by_nonce.remove(&(slot.owner, slot.made_by.0));
        }
    }

    fn owns(&self, user: &str, sid: u128) -> bool {
        self.sessions.get(&sid).is_some_and(|slot| &*slot.owner == user)
    }

    fn judge(
        &mut self,
        now: Duration,
        user: &Arc<str>,
        header: &RequestHeader,
        mine: Option<u128>,
        body: &[Vec<u8>],
    ) -> Result<Next, Refusal> {
        let (most, bytes) = (self.shared.limits.frames, self.shared.limits.message_bytes);
        if body.len() > most {
            let text = format!("the request has {} frames; {most} are allowed", body.len());
            return Err(Refusal::new(Code::Limit, text));
        }
        let sent: usize = body.iter().map(Vec::len).sum();
        if sent > bytes {
            let text = format!("the request has {sent} bytes; {bytes} are allowed");
            return Err(Refusal::new(Code::Limit, text));
        }
        self.shared.metrics.request(&header.op);
        let frames = &body[1..];
        let arrays = Arrays::new(&header.arr, frames)?;
        let plain = |answer| Ok(Next::Answer(mine, answer));
        match header.op.as_str() {
            "hello" => plain(self.hello(user)),
            "list" => plain(Answer::of(list())),
            "ping" => plain(Answer::of(json!({"uptime": now.as_secs_f64()}))),
            "stats" => plain(self.stats(user, now)),
            "make" => self.make(now, user, header, &arrays, frames),
            op if OPS.contains(&op) => {
                let sid = mine.ok_or_else(|| no_session(header.sid.as_deref()))?;
                let slot = self.sessions.get_mut(&sid).expect("it was just found");
                let Some(session) = &mut slot.session else { return Ok(Next::Later(sid)) };
                session.used = now;
                match op {
                    "touch" => plain(Answer::default()),
                    "info" => plain(info(session)),
                    "close" => {
                        self.remove(sid);
                        plain(Answer::default())
                    }
                    _ => {
                        let session = slot.session.take().expect("it is here");
                        let (expected, digest) =
                            (session.expected, digest(&self.key, header, frames));
                        // Header and frames move in when nobody looks at them any more.
                        let (header, frames) = (Box::default(), vec![]);
                        let task = Task::Operate { session, header, frames, digest };
                        Ok(Next::Work(sid, expected, task))
                    }
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
            "memory_bytes": self.shared.ledger.taken(),
            "replayed": m.replayed.load(Relaxed),
            "reaped": m.reaped.load(Relaxed),
        }))
    }

    /// Everything is read and judged before anything is reserved.
    fn make(
        &mut self,
        now: Duration,
        user: &Arc<str>,
        header: &RequestHeader,
        arrays: &Arrays,
        frames: &[Vec<u8>],
    ) -> Result<Next, Refusal> {
        let p = &header.p;
        let nonce: String = field(p, "nonce")?;
        let nonce = parse_id(&nonce).ok_or_else(|| {
            let text = format!("parameter 'nonce' = '{nonce}' is not 32 hexadecimal digits");
            Refusal::new(Code::BadRequest, text)
        })?;
        let digest = digest(&self.key, header, frames);
        if let Some(sid) = self.by_nonce.get(&(user.clone(), nonce)) {
            let slot = &self.sessions[sid];
            if slot.made_by.1 != digest {
                let text = "this nonce has made another session with other parameters";
                return Err(Refusal::new(Code::NonceConflict, text));
            }
            let Some(session) = &slot.session else { return Ok(Next::Later(*sid)) };
            self.shared.metrics.replayed.fetch_add(1, Relaxed);
            return Ok(Next::Answer(None, session.greeting.clone()));
        }
        if self.shared.draining.load(Relaxed) {
            return Err(Refusal::later(Code::Draining, "this server is shutting down", 5000));
        }
        let granted = self.shared.limits.window;
        let window = field::<Option<usize>>(p, "window")?.unwrap_or(granted).clamp(1, granted);
        let mut options = self.make_options(user, p, arrays)?;
        let size = Size::of(&self.factory, &mut options, !p.contains_key("max_episode_steps"))?;
        size.check(&options, &self.shared.limits)?;
        let place = self.shared.admit(user)?;
        let charge = self.shared.ledger.take(user, size.memory(window))?;
        let sid = self.new_id();
        let expected = size.guess();
        let factory = self.factory.clone();
        let making = Making { factory, options, window, now, place, charge, expected };
        let slot =
            Slot { owner: user.clone(), made_by: (nonce, digest), session: None, doomed: false };
        self.sessions.insert(sid, slot);
        self.by_nonce.insert((user.clone(), nonce), sid);
        Ok(Next::Work(sid, size.guess(), Task::Make(Box::new(making))))
    }

    fn make_options(
        &self,
        user: &str,
        p: &Map<String, Value>,
        arrays: &Arrays,
    ) -> Result<MakeOptions, Refusal> {
        let num_envs = field::<Option<usize>>(p, "num_envs")?.unwrap_or(1);
        let most = self.shared.user_limits(user).envs.unwrap_or(self.shared.limits.envs);
        if num_envs == 0 || num_envs > most {
            let text = format!("num_envs = {num_envs} is not allowed: 1 to {most}");
            return Err(Refusal::new(Code::Limit, text));
        }
        let mode = field::<Option<AutoresetMode>>(p, "autoreset_mode")?;
        let mut kwargs: Map<String, Value> = field(p, "kwargs")?;
        for (name, value) in lists_from_arrays(arrays, "kwargs:")? {
            insert(&mut kwargs, &name, value).ok_or_else(|| {
                let text = format!("keyword '{name}' is given in 'kwargs' and as an array");
                Refusal::new(Code::BadRequest, text)
            })?;
        }
        Ok(MakeOptions {
            id: field(p, "id")?,
            num_envs,
            kwargs,
            autoreset_mode: mode.unwrap_or(AutoresetMode::NextStep),
            max_episode_steps: field(p, "max_episode_steps")?,
            num_threads: 1,
        })
    }

    /// A free session number.
    fn new_id(&mut self) -> u128 {
        loop {
            let id = (self.ids)();
            if !self.sessions.contains_key(&id) {
                return id;
            }
        }
    }

    fn reply(
        &self,
        ticket: Ticket,
        sid: Option<u128>,
        outcome: Result<Answer, Refusal>,
    ) -> Vec<Frame> {
        let session = sid.and_then(|sid| self.sessions.get(&sid)).and_then(|s| s.session.as_ref());
        let seq = session.map(|session| session.window.last());
        let epoch = self.shared.epoch.clone();
        let Ticket { rid, delimited } = ticket;
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
        let mut reply = Vec::with_capacity(2 + frames.len());
        if delimited {
            reply.push(Frame::from([]));
        }
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

/// Digest of what a call asks for, whatever number it carries.
fn digest(key: &[u8; 32], header: &RequestHeader, frames: &[Vec<u8>]) -> Digest {
    let content = serde_json::to_vec(&(&header.op, &header.p, &header.arr))
        .expect("a header was made of JSON values");
    let mut hasher = blake3::Hasher::new_keyed(key);
    // Lengths go in too: the same bytes cut at other places are other content.
    for part in std::iter::once(&content).chain(frames) {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    *hasher.finalize().as_bytes()
}

/// Puts a value where its name leads: `geometry.widths` is the key `widths` of the map `geometry`. `None`:
/// another value is there.
fn insert(map: &mut Map<String, Value>, name: &str, value: Value) -> Option<()> {
    match name.split_once('.') {
        Some((outer, inner)) => {
            let below = map.entry(outer).or_insert_with(|| json!({}));
            insert(below.as_object_mut()?, inner, value)
        }
        None => map.insert(name.into(), value).is_none().then_some(()),
    }
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
