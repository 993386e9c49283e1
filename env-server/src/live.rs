//! What the live page shows: the rods of some sessions, drawn from their scenes.

use crate::server::Server;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::Duration;

/// Sessions of one shard that are shown.
const SESSIONS: usize = 12;
/// Environments of one session that are shown.
const ENVS: usize = 4;

/// The newest pictures, by shard. Costs nothing while nobody watches.
#[derive(Debug, Default)]
pub struct Live {
    watchers: AtomicUsize,
    parts: Mutex<BTreeMap<usize, Value>>,
}

/// Somebody who watches, until dropped.
#[derive(Debug)]
pub struct Watcher<'a>(&'a Live);

impl Drop for Watcher<'_> {
    fn drop(&mut self) {
        self.0.watchers.fetch_sub(1, Relaxed);
    }
}

impl Live {
    /// Time between two pictures.
    pub const INTERVAL: Duration = Duration::from_millis(100);

    /// Begins to watch.
    pub fn watch(&self) -> Watcher<'_> {
        self.watchers.fetch_add(1, Relaxed);
        Watcher(self)
    }

    /// Whether pictures are wanted.
    pub fn is_watched(&self) -> bool {
        self.watchers.load(Relaxed) > 0
    }

    /// Stores the pictures of a shard.
    pub fn publish(&self, part: usize, server: &Server) {
        let mut shown: Vec<Value> = server.sessions().map(|(sid, s)| picture(sid, s)).collect();
        shown.sort_by_key(|s| s["name"].as_str().map(str::to_owned));
        shown.truncate(SESSIONS);
        self.parts.lock().expect("no panic while held").insert(part, shown.into());
    }

    /// The pictures of all shards, as the page reads them.
    pub fn sessions(&self) -> Value {
        let parts = self.parts.lock().expect("no panic while held");
        parts.values().flat_map(|part| part.as_array().into_iter().flatten().cloned()).collect()
    }
}

fn picture(sid: u128, session: &crate::session::Session) -> Value {
    let env = session.env();
    let shown = env.num_envs().min(ENVS);
    // A scene before the first reset may be refused: then there is nothing to draw yet.
    let scenes: Vec<Value> = (0..shown)
        .filter_map(|i| env.scene(i).ok())
        .map(|s| {
            json!({"machine": s.machine, "nodes": s.nodes, "time": s.time, "reward": s.reward,
                "return": s.episode_return, "length": s.values.get("length")})
        })
        .collect();
    json!({
        // Session numbers are secrets: a checksum tells them apart as well.
        "name": format!("{:08x}", crc32fast::hash(&sid.to_be_bytes())),
        "owner": session.owner,
        "id": env.spec().id,
        "envs": env.num_envs(),
        "steps": session.steps,
        "scenes": scenes,
    })
}
