//! What the live page shows: the rods of some sessions, drawn from their scenes.

use crate::server::Server;
use crate::session::Session;
use rodgym_core::env::Scene;
use serde_json::{Value, json};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::Duration;

/// Sessions that are shown.
const SESSIONS: usize = 12;
/// Environments of one session that are shown.
const ENVS: usize = 4;
/// Pieces of one rod that are shown.
const NODES: usize = 60;

/// The newest pictures, by shard. Costs nothing while nobody watches.
#[derive(Debug, Default)]
pub struct Live {
    watchers: AtomicUsize,
    shown: Mutex<Vec<Value>>,
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

    /// Stores new pictures; a session that is being worked on keeps its last one.
    pub fn publish(&self, server: &Server) {
        let mut shown = self.shown.lock().expect("no panic while held");
        let mut new: Vec<Value> = server
            .sessions()
            .filter_map(|(sid, owner, session)| match session {
                Some(session) => Some(picture(sid, owner, session)),
                None => shown.iter().find(|old| old["name"] == name(sid).as_str()).cloned(),
            })
            .collect();
        new.sort_by_key(|s| s["name"].as_str().map(str::to_owned));
        new.truncate(SESSIONS);
        *shown = new;
    }

    /// The pictures, as the page reads them.
    pub fn sessions(&self) -> Value {
        self.shown.lock().expect("no panic while held").clone().into()
    }
}

/// Session numbers are secrets: a checksum tells them apart as well.
fn name(sid: u128) -> String {
    format!("{:08x}", crc32fast::hash(&sid.to_be_bytes()))
}

fn picture(sid: u128, owner: &str, session: &Session) -> Value {
    let env = session.env();
    let shown = env.num_envs().min(ENVS);
    json!({
        "name": name(sid),
        "owner": owner,
        "id": env.spec().id,
        "envs": env.num_envs(),
        "steps": session.steps,
        // A scene before the first reset may be refused: then there is nothing to draw yet.
        "scenes": (0..shown).filter_map(|i| env.scene(i).ok()).map(sketch).collect::<Value>(),
    })
}

/// A scene with as many nodes as a small picture can show.
fn sketch(scene: Scene) -> Value {
    let last = scene.nodes.len().saturating_sub(1);
    let stride = last.div_ceil(NODES).max(1);
    let thinned = |values: &[f64], scale: f64| -> Value {
        let inner = values.iter().take(last).step_by(stride);
        inner.chain(values.get(last)).map(|v| v * scale).collect()
    };
    // To 10 um: a fourth of the text.
    let (x, y): (Vec<f64>, Vec<f64>) =
        scene.nodes.iter().map(|[x, y]| ((x * 1e5).round() / 1e5, (y * 1e5).round() / 1e5)).unzip();
    json!({
        "machine": scene.machine,
        "time": scene.time,
        "return": scene.episode_return,
        "values": scene.values,
        "x": thinned(&x, 1.0),
        "y": thinned(&y, 1.0),
        "thickness": thinned(&scene.thickness, 1.0),
        // Turn of the whole rod if all of it were bent as here [rad].
        "bend": thinned(&scene.curvature, last as f64),
    })
}
