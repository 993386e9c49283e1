//! One request's computation, apart from the state machine that ordered it: it may run on any thread,
//! with the session that it concerns inside.

use crate::error::{Code, Refusal};
use crate::memory::Charge;
use crate::session::{Answer, Session};
use crate::shared::{Factory, Place, Shared};
use crate::window::{Digest, Verdict};
use crate::wire::{Arrays, RequestHeader};
use rodgym_core::catalog::MakeOptions;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

/// How a reply names its request.
#[derive(Clone, Copy, Debug)]
pub struct Ticket {
    pub(crate) rid: u64,
    /// Whether an empty frame came first and goes back.
    pub(crate) delimited: bool,
}

/// What takes shorter is not worth waking other threads for.
const WORTH: Duration = Duration::from_micros(100);

/// What is to be computed.
pub struct Work {
    pub(crate) sid: u128,
    pub(crate) ticket: Ticket,
    /// How long it is expected to take.
    pub(crate) expected: Duration,
    /// Whether nothing else is computed meanwhile, so that other cores are free.
    pub(crate) alone: bool,
    pub(crate) shared: Arc<Shared>,
    pub(crate) task: Task,
}

pub(crate) enum Task {
    /// An operation on a session.
    Operate {
        session: Box<Session>,
        header: Box<RequestHeader>,
        frames: Vec<Vec<u8>>,
        digest: Digest,
    },
    /// A new session.
    Make(Box<Making>),
}

/// All that a new session needs, reserved already.
pub(crate) struct Making {
    pub factory: Factory,
    pub options: MakeOptions,
    pub window: usize,
    pub now: Duration,
    pub place: Place,
    pub charge: Charge,
    pub expected: Duration,
}

/// What came of it; the server puts it into its books with `Server::finish`.
pub struct Finished {
    pub(crate) sid: u128,
    pub(crate) ticket: Ticket,
    /// `None`: the session is lost, or was never made.
    pub(crate) session: Option<Box<Session>>,
    pub(crate) outcome: Result<Answer, Refusal>,
}

impl Finished {
    /// The session that it concerns.
    pub fn sid(&self) -> u128 {
        self.sid
    }
}

impl Work {
    /// The session that it concerns.
    pub fn sid(&self) -> u128 {
        self.sid
    }

    /// How long it is expected to take.
    pub fn expected(&self) -> Duration {
        self.expected
    }

    /// Says that nothing else is computed meanwhile.
    #[must_use]
    pub fn alone(self, alone: bool) -> Work {
        Work { alone, ..self }
    }

    /// Computes. A panic in an environment costs its session, not the server.
    pub fn run(self) -> Finished {
        let Work { sid, ticket, expected, alone, shared, task } = self;
        let lost = |what: &str| {
            let text = format!("'{what}' failed inside the server; its session is lost");
            Err(Refusal::new(Code::Internal, text))
        };
        let (session, outcome) = match task {
            Task::Operate { mut session, header, frames, digest } => {
                let spreads = alone && expected >= WORTH && header.op == "step";
                let threads = if spreads { shared.limits.threads } else { 1 };
                session.spread(threads, || shared.lend(threads - 1));
                let work = || operate(&mut session, &shared, &header, &frames, digest);
                match catch_unwind(AssertUnwindSafe(work)) {
                    Ok(outcome) => (Some(session), outcome),
                    Err(_) => (None, lost(&header.op)),
                }
            }
            Task::Make(making) => {
                match catch_unwind(AssertUnwindSafe(|| make(&shared, sid, *making))) {
                    Ok(Ok(session)) => {
                        shared.metrics.made.fetch_add(1, Relaxed);
                        let greeting = session.greeting.clone();
                        (Some(session), Ok(greeting))
                    }
                    Ok(Err(refusal)) => (None, Err(refusal)),
                    Err(_) => (None, lost("make")),
                }
            }
        };
        Finished { sid, ticket, session, outcome }
    }
}

fn make(shared: &Shared, sid: u128, making: Making) -> Result<Box<Session>, Refusal> {
    let env = (making.factory)(&making.options)?;
    let mut session = Session::new(env, making.window, making.now);
    session.greet(sid, making.window, shared.limits.message_bytes);
    session.expected = making.expected;
    session.reserved = Some((making.place, making.charge));
    Ok(Box::new(session))
}

fn operate(
    session: &mut Session,
    shared: &Shared,
    header: &RequestHeader,
    frames: &[Vec<u8>],
    digest: Digest,
) -> Result<Answer, Refusal> {
    let p = &header.p;
    match header.op.as_str() {
        "observe" => session.observe(p),
        "nodes" => session.nodes(p),
        "render" => session.scene(p),
        "get_state" => session.get_state(p, shared.limits.message_bytes),
        _ => change(session, shared, header, frames, digest),
    }
}

/// Carries out a numbered call, or answers it from memory.
fn change(
    session: &mut Session,
    shared: &Shared,
    header: &RequestHeader,
    frames: &[Vec<u8>],
    digest: Digest,
) -> Result<Answer, Refusal> {
    let seq = header.seq.ok_or_else(|| {
        Refusal::new(Code::BadRequest, format!("'{}' needs a sequence number 'seq'", header.op))
    })?;
    let last = session.window.last();
    match session.window.judge(seq, digest) {
        Verdict::Run => {}
        Verdict::Cached(answer) => {
            shared.metrics.replayed.fetch_add(1, Relaxed);
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
    let arrays = Arrays::new(&header.arr, frames)?;
    let answer = match header.op.as_str() {
        "reset" => session.reset(&header.p, &arrays)?,
        "set_state" => session.set_state(&header.p, &arrays)?,
        "set_parameters" => session.set_parameters(&header.p, &arrays)?,
        _ => {
            let start = Instant::now();
            let answer = session.step(&arrays)?;
            session.expected = start.elapsed();
            shared.metrics.step(session.env().num_envs(), session.expected);
            answer
        }
    };
    session.window.record(digest, answer.clone());
    Ok(answer)
}
