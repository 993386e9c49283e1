//! What one server grants, in all, to a user and to a session.

use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Limits of a server. Beyond them a request is refused, never half done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Sessions of all users.
    pub sessions: usize,
    /// Sessions of one user, unless the key file says otherwise.
    pub sessions_per_user: usize,
    /// Environments of one session, unless the key file says otherwise.
    pub envs: usize,
    /// Bytes of a request, and of a reply's arrays.
    pub message_bytes: usize,
    /// Bytes of a request's header.
    pub header_bytes: usize,
    /// Frames of a request, the header included.
    pub frames: usize,
    /// Replies that a session remembers; a client may ask for fewer.
    pub window: usize,
    /// Work of one control step of a session: environments x nodes x physics steps.
    pub node_steps: u64,
    /// Bytes of sessions, of requests that wait and of replies that are not read yet.
    pub memory_bytes: usize,
    /// The same, of one user.
    pub memory_per_user_bytes: usize,
    /// Seconds after which a session that nobody uses is dropped.
    pub idle_seconds: u64,
    /// Threads of one step, while nothing else is computed.
    pub threads: usize,
    /// Milliseconds that a connection may take for its handshake.
    #[serde(skip_serializing)]
    pub handshake_ms: i32,
    /// Bytes that the transport may hold for all peers: what arrives, and connections.
    #[serde(skip_serializing)]
    pub transport_bytes: usize,
    /// Connections at a time.
    #[serde(skip_serializing)]
    pub connections: usize,
    /// Connections that wait to be accepted.
    #[serde(skip_serializing)]
    pub backlog: i32,
    /// Milliseconds that the end waits for replies that are not sent yet.
    #[serde(skip_serializing)]
    pub linger_ms: i32,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            sessions: 256,
            sessions_per_user: 32,
            envs: 4096,
            message_bytes: 16 << 20,
            header_bytes: 4096,
            frames: 8,
            window: 16,
            node_steps: 10_000_000,
            memory_bytes: 768 << 20,
            memory_per_user_bytes: 768 << 20,
            idle_seconds: 600,
            threads: 1,
            handshake_ms: 2000,
            transport_bytes: 256 << 20,
            connections: 4096,
            backlog: 1024,
            linger_ms: 500,
        }
    }
}

/// Messages that wait for one peer. A ROUTER drops replies silently when more than half of this is
/// outstanding, so no window may be larger than that.
pub const HIGH_WATER_MARK: i32 = 64;

impl Limits {
    /// Sets one limit by the name of its field.
    ///
    /// # Errors
    /// An unknown name, or a value that is not allowed: a sentence.
    pub fn set(&mut self, name: &str, value: u64) -> Result<(), String> {
        let least = if name == "linger_ms" { 0 } else { 1 };
        let most = match name {
            "window" => HIGH_WATER_MARK as u64 / 2,
            "threads" => 64,
            // The front throws away what lies far beyond.
            "frames" => 32,
            // What libzmq takes.
            "handshake_ms" | "backlog" | "linger_ms" => i32::MAX as u64,
            "message_bytes" => i64::MAX as u64,
            "node_steps" => u64::MAX,
            "connections" => i32::MAX as u64,
            _ => u64::from(u32::MAX),
        };
        if !(least..=most).contains(&value) {
            return Err(format!("limit {name} = {value} is not allowed: {least} to {most}"));
        }
        let size = value as usize;
        match name {
            "sessions" => self.sessions = size,
            "sessions_per_user" => self.sessions_per_user = size,
            "envs" => self.envs = size,
            "message_bytes" => self.message_bytes = size,
            "header_bytes" => self.header_bytes = size,
            "frames" => self.frames = size,
            "window" => self.window = size,
            "node_steps" => self.node_steps = value,
            "connections" => self.connections = size,
            "idle_seconds" => self.idle_seconds = value,
            "threads" => self.threads = size,
            "handshake_ms" => self.handshake_ms = value as i32,
            "backlog" => self.backlog = value as i32,
            "linger_ms" => self.linger_ms = value as i32,
            _ => return Err(format!("'{name}' is not a limit")),
        }
        Ok(())
    }

    /// Divides the memory that the whole server may take: a quarter to the transport, the rest to
    /// sessions and messages; with several users, one may have half of that. A message takes no more
    /// than half of what the transport has.
    pub fn share_memory(&mut self, bytes: u64, several_users: bool) {
        let bytes = usize::try_from(bytes).unwrap_or(usize::MAX);
        self.transport_bytes = bytes / 4;
        self.memory_bytes = bytes - bytes / 4;
        self.message_bytes = self.message_bytes.min(self.transport_bytes / 2);
        self.memory_per_user_bytes = self.memory_bytes / if several_users { 2 } else { 1 };
    }

    /// Time after which an idle session is dropped.
    pub fn idle(&self) -> Duration {
        Duration::from_secs(self.idle_seconds)
    }
}

/// Limits of one named user, from the key file; what is absent follows the server's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UserLimits {
    /// Sessions at a time.
    pub sessions: Option<usize>,
    /// Environments of one session.
    pub envs: Option<usize>,
}
