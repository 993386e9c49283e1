//! Counters of a server and their Prometheus text.

use crate::error::{CODES, Code};
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

/// Operations of the protocol, for counters.
pub const OPS: [&str; 16] = [
    "hello",
    "list",
    "make",
    "reset",
    "step",
    "get_state",
    "set_state",
    "set_parameters",
    "observe",
    "nodes",
    "render",
    "close",
    "touch",
    "ping",
    "info",
    "stats",
];

/// Upper ends of the step time's buckets \[s\].
const BUCKETS: [f64; 12] = [2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 5e-2, 0.2, 1.0];

/// Counters since the start; shared by all threads.
#[derive(Debug, Default)]
pub struct Metrics {
    requests: [AtomicU64; OPS.len()],
    errors: [AtomicU64; CODES.len()],
    buckets: [AtomicU64; BUCKETS.len() + 1],
    step_nanos: AtomicU64,
    /// Steps of single environments.
    pub env_steps: AtomicU64,
    /// Sessions made.
    pub made: AtomicU64,
    /// Sessions dropped because nobody used them.
    pub reaped: AtomicU64,
    /// Sessions dropped because their user's key was removed.
    pub revoked: AtomicU64,
    /// Calls answered from the window.
    pub replayed: AtomicU64,
    /// Replies that could not be sent: the peer was gone or did not read.
    pub undelivered: AtomicU64,
    /// Handshakes refused.
    pub denied: AtomicU64,
    /// Sessions alive.
    pub sessions: AtomicU64,
}

/// Steps so far, or between two looks.
#[derive(Clone, Copy, Debug)]
pub struct Steps {
    /// Steps of single environments.
    pub env_steps: u64,
    /// Steps of batches.
    pub batches: u64,
    /// Time that they took \[ns\].
    pub nanos: u64,
}

impl Steps {
    /// Mean time of a batch's step \[s\].
    pub fn mean_seconds(&self) -> Option<f64> {
        (self.batches > 0).then(|| self.nanos as f64 * 1e-9 / self.batches as f64)
    }
}

impl std::ops::Sub for Steps {
    type Output = Steps;
    fn sub(self, before: Steps) -> Steps {
        Steps {
            env_steps: self.env_steps - before.env_steps,
            batches: self.batches - before.batches,
            nanos: self.nanos - before.nanos,
        }
    }
}

impl Metrics {
    /// Counts a request by operation.
    pub fn request(&self, op: &str) {
        if let Some(i) = OPS.iter().position(|known| *known == op) {
            self.requests[i].fetch_add(1, Relaxed);
        }
    }

    /// Counts a refusal by code.
    pub fn error(&self, code: Code) {
        let i = CODES.iter().position(|known| *known == code).expect("CODES holds every code");
        self.errors[i].fetch_add(1, Relaxed);
    }

    /// Counts a step of a batch of `envs` that took this long.
    pub fn step(&self, envs: usize, time: Duration) {
        self.env_steps.fetch_add(envs as u64, Relaxed);
        self.step_nanos.fetch_add(time.as_nanos() as u64, Relaxed);
        let i = BUCKETS.partition_point(|end| *end < time.as_secs_f64());
        self.buckets[i].fetch_add(1, Relaxed);
    }

    /// Steps so far.
    pub fn steps(&self) -> Steps {
        Steps {
            env_steps: self.env_steps.load(Relaxed),
            batches: self.buckets.iter().map(|count| count.load(Relaxed)).sum(),
            nanos: self.step_nanos.load(Relaxed),
        }
    }

    /// Refusals with this code so far.
    pub fn errors(&self, code: Code) -> u64 {
        let i = CODES.iter().position(|known| *known == code).expect("CODES holds every code");
        self.errors[i].load(Relaxed)
    }

    /// The text that Prometheus reads (exposition format 0.0.4).
    pub fn prometheus(&self) -> String {
        let mut text = String::new();
        let out = &mut text;
        family(out, "requests_total", "counter", "Requests by operation.");
        for (op, count) in OPS.iter().zip(&self.requests) {
            line(out, "requests_total", &format!("{{op=\"{op}\"}}"), count.load(Relaxed));
        }
        family(out, "errors_total", "counter", "Refused requests by code.");
        for (code, count) in CODES.iter().zip(&self.errors) {
            let label = format!("{{code=\"{}\"}}", code.word());
            line(out, "errors_total", &label, count.load(Relaxed));
        }
        let single: [(&str, &str, &str, &AtomicU64); 8] = [
            ("env_steps_total", "counter", "Steps of single environments.", &self.env_steps),
            ("sessions_made_total", "counter", "Sessions made.", &self.made),
            ("sessions_reaped_total", "counter", "Sessions dropped when idle.", &self.reaped),
            ("sessions_revoked_total", "counter", "Sessions dropped with a key.", &self.revoked),
            ("replayed_total", "counter", "Calls answered from the window.", &self.replayed),
            ("undelivered_total", "counter", "Replies that nobody took.", &self.undelivered),
            ("handshakes_denied_total", "counter", "Keys refused.", &self.denied),
            ("sessions", "gauge", "Sessions alive.", &self.sessions),
        ];
        for (name, kind, help, value) in single {
            family(out, name, kind, help);
            line(out, name, "", value.load(Relaxed));
        }
        family(out, "step_seconds", "histogram", "Time of a step of one session.");
        let mut total = 0;
        for (i, count) in self.buckets.iter().enumerate() {
            total += count.load(Relaxed);
            let end = BUCKETS.get(i).map_or("+Inf".to_string(), |end| end.to_string());
            line(out, "step_seconds_bucket", &format!("{{le=\"{end}\"}}"), total);
        }
        let seconds = self.step_nanos.load(Relaxed) as f64 * 1e-9;
        let _ = writeln!(out, "rodgym_step_seconds_sum {seconds}");
        line(out, "step_seconds_count", "", total);
        text
    }
}

fn family(out: &mut String, name: &str, kind: &str, help: &str) {
    let _ = writeln!(out, "# HELP rodgym_{name} {help}\n# TYPE rodgym_{name} {kind}");
}

fn line(out: &mut String, name: &str, label: &str, value: u64) {
    let _ = writeln!(out, "rodgym_{name}{label} {value}");
}
