//! What all threads of a server share: limits, counters, and places for sessions.

use crate::error::{Code, Refusal};
use crate::limits::{Limits, UserLimits};
use crate::memory::Ledger;
use crate::metrics::Metrics;
use rodgym_core::catalog::MakeOptions;
use rodgym_core::env::VectorEnv;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, RwLock};

/// Makes batches: `catalog::make`, or a test's own environments.
pub type Factory =
    Arc<dyn Fn(&MakeOptions) -> rodgym_core::Result<Box<dyn VectorEnv>> + Send + Sync>;

/// What all threads of a server have in common.
pub struct Shared {
    /// What is granted.
    pub limits: Limits,
    /// Changes with every start.
    pub epoch: String,
    /// Counters.
    pub metrics: Metrics,
    /// Memory promised.
    pub ledger: Arc<Ledger>,
    /// Limits of single users.
    pub users: RwLock<HashMap<String, UserLimits>>,
    /// Set while the server is going down: no new sessions.
    pub draining: AtomicBool,
    /// Sessions by user.
    quota: Mutex<HashMap<Arc<str>, usize>>,
    /// Threads that may still be lent to sessions.
    helpers: AtomicUsize,
}

/// Threads lent to all sessions together, however many there are.
const HELPERS: usize = 64;

/// Threads that help a session with its steps; given back when dropped.
pub struct Helpers {
    shared: Arc<Shared>,
    count: usize,
}

impl Drop for Helpers {
    fn drop(&mut self) {
        self.shared.helpers.fetch_add(self.count, Relaxed);
    }
}

/// A place for a session; given back when dropped.
pub struct Place {
    shared: Arc<Shared>,
    user: Arc<str>,
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut quota = self.shared.quota.lock().expect("no panic while held");
        if let Some(mine) = quota.get_mut(&self.user) {
            *mine -= 1;
            if *mine == 0 {
                quota.remove(&self.user);
            }
        }
        self.shared.metrics.sessions.store(quota.values().sum::<usize>() as u64, Relaxed);
    }
}

impl Shared {
    /// A new server's common part.
    pub fn new(limits: Limits, epoch: impl Into<String>) -> Self {
        Shared {
            ledger: Ledger::new(limits.memory_bytes, limits.memory_per_user_bytes),
            limits,
            epoch: epoch.into(),
            metrics: Metrics::default(),
            users: RwLock::default(),
            draining: AtomicBool::new(false),
            quota: Mutex::default(),
            helpers: AtomicUsize::new(HELPERS),
        }
    }

    /// Lends threads beside a session's own; none where the others have them all.
    pub(crate) fn lend(self: &Arc<Self>, count: usize) -> Option<Helpers> {
        let left = |left: usize| left.checked_sub(count);
        self.helpers.fetch_update(Relaxed, Relaxed, left).ok()?;
        Some(Helpers { shared: self.clone(), count })
    }

    /// What the key file of `user` says.
    pub(crate) fn user_limits(&self, user: &str) -> UserLimits {
        self.users.read().expect("no panic while held").get(user).copied().unwrap_or_default()
    }

    /// Takes a place for a session of `user`.
    pub(crate) fn admit(self: &Arc<Self>, user: &Arc<str>) -> Result<Place, Refusal> {
        let most = self.user_limits(user).sessions.unwrap_or(self.limits.sessions_per_user);
        let mut quota = self.quota.lock().expect("no panic while held");
        let all: usize = quota.values().sum();
        if all >= self.limits.sessions {
            let text = format!("all {} sessions of this server are taken", self.limits.sessions);
            return Err(Refusal::later(Code::Busy, text, 1000));
        }
        let mine = quota.get(user).copied().unwrap_or(0);
        if mine >= most {
            let text = format!("user '{user}' has {mine} sessions already; {most} are allowed");
            return Err(Refusal::later(Code::Limit, text, 1000));
        }
        quota.insert(user.clone(), mine + 1);
        self.metrics.sessions.store(all as u64 + 1, Relaxed);
        Ok(Place { shared: self.clone(), user: user.clone() })
    }

    /// Sessions of `user` now.
    pub(crate) fn sessions_of(&self, user: &str) -> usize {
        self.quota.lock().expect("no panic while held").get(user).copied().unwrap_or(0)
    }
}
