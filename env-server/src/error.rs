//! Why a request was not done, and what its sender can do about it.

use rodgym_core::Error;
use serde_json::{Map, Value};
use std::fmt;

/// Stable words for refusals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "docs/protocol.md describes each word")]
pub enum Code {
    Version,
    BadHeader,
    BadRequest,
    BadArray,
    UnknownOp,
    NoSession,
    StaleSeq,
    SeqGap,
    SeqConflict,
    NonceConflict,
    Limit,
    Busy,
    Draining,
    Denied,
    Env,
    Internal,
}

/// All codes, for counters.
pub const CODES: [Code; 16] = [
    Code::Version,
    Code::BadHeader,
    Code::BadRequest,
    Code::BadArray,
    Code::UnknownOp,
    Code::NoSession,
    Code::StaleSeq,
    Code::SeqGap,
    Code::SeqConflict,
    Code::NonceConflict,
    Code::Limit,
    Code::Busy,
    Code::Draining,
    Code::Denied,
    Code::Env,
    Code::Internal,
];

impl Code {
    /// The word on the wire.
    pub fn word(self) -> &'static str {
        match self {
            Code::Version => "version",
            Code::BadHeader => "bad_header",
            Code::BadRequest => "bad_request",
            Code::BadArray => "bad_array",
            Code::UnknownOp => "unknown_op",
            Code::NoSession => "no_session",
            Code::StaleSeq => "stale_seq",
            Code::SeqGap => "seq_gap",
            Code::SeqConflict => "seq_conflict",
            Code::NonceConflict => "nonce_conflict",
            Code::Limit => "limit",
            Code::Busy => "busy",
            Code::Draining => "draining",
            Code::Denied => "denied",
            Code::Env => "env",
            Code::Internal => "internal",
        }
    }
}

/// A refused request.
#[derive(Clone, Debug, PartialEq)]
pub struct Refusal {
    /// Stable word.
    pub code: Code,
    /// One sentence, with the offending value.
    pub msg: String,
    /// Time to wait before a retry \[ms\].
    pub after_ms: Option<u64>,
    /// Facts for programs, sent as `p`.
    pub details: Map<String, Value>,
}

impl Refusal {
    /// A refusal without a waiting time.
    pub fn new(code: Code, msg: impl Into<String>) -> Self {
        Refusal { code, msg: msg.into(), after_ms: None, details: Map::new() }
    }

    /// What a client may try: `never`, `same`, `new_session` or `elsewhere`.
    pub fn retry(&self) -> &'static str {
        match self.code {
            // Without a waiting time the limit is one that waiting does not lift.
            Code::Busy | Code::Limit if self.after_ms.is_some() => "same",
            Code::NoSession | Code::Internal => "new_session",
            Code::Draining => "elsewhere",
            _ => "never",
        }
    }

    /// A refusal that may end by itself after this time \[ms\].
    pub fn later(code: Code, msg: impl Into<String>, after_ms: u64) -> Self {
        Refusal { after_ms: Some(after_ms), ..Refusal::new(code, msg) }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.code.word(), self.msg)
    }
}

impl From<Error> for Refusal {
    fn from(error: Error) -> Self {
        let mut refusal = Refusal::new(Code::Env, error.to_string());
        // The client raises the same class of error as a local environment would.
        let kind = match error {
            Error::UnknownEnv { .. } => "unknown_env",
            Error::UnknownKeyword { .. } => "unknown_keyword",
            Error::UnknownParameter { .. } => "unknown_parameter",
            Error::Parameter { .. } => "parameter",
            Error::Shape { .. } => "shape",
            Error::Action { .. } => "action",
            Error::NeedsReset { .. } => "needs_reset",
            Error::NotReset => "not_reset",
            Error::Index { .. } => "index",
            Error::Snapshot { .. } => "snapshot",
            Error::Solver { .. } => "solver",
        };
        refusal.details.insert("kind".into(), kind.into());
        refusal
    }
}
