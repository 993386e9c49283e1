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
    /// Bytes of one frame, both ways.
    pub message_bytes: usize,
    /// Bytes of a request's header.
    pub header_bytes: usize,
    /// Frames of a request, the header included.
    pub frames: usize,
    /// Replies that a session remembers; a client may ask for fewer.
    pub window: usize,
    /// Seconds after which a session that nobody uses is dropped.
    pub idle_seconds: u64,
    /// Threads of one step.
    pub threads: usize,
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
            idle_seconds: 600,
            threads: 1,
        }
    }
}

impl Limits {
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
