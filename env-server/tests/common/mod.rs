//! A batch of counters, small enough to predict every reply, and a client of the state machine.
#![allow(dead_code, reason = "each test file uses its part")]

use rodgym_core::catalog::MakeOptions;
use rodgym_core::env::*;
use rodgym_core::error::{Error, Result};
use rodgym_core::simulation::Simulation;
use rodgym_server::limits::Limits;
use rodgym_server::server::Server;
use rodgym_server::shared::Shared;
use rodgym_server::wire::{self, ArrayHeader, Frame, ReplyHeader, RequestHeader};
use serde_json::{Map, Value, json};
use std::sync::Arc;
use std::time::Duration;

/// Observation (steps since the episode began, sum of actions since ever). An action of 99 panics.
pub struct Counters {
    spec: Spec,
    mode: AutoresetMode,
    limit: Option<u32>,
    rows: Vec<(u32, f32, bool)>,
    /// What `configure` has set.
    told: Vec<Option<f64>>,
    threads: usize,
    /// Threads of the last step; a scene tells.
    used: usize,
}

impl Counters {
    pub fn boxed(options: &MakeOptions) -> Result<Box<dyn VectorEnv>> {
        if options.id != "test/Counter-v0" {
            let id = options.id.clone();
            return Err(Error::UnknownEnv { id, known: "test/Counter-v0".into() });
        }
        if let Some(name) = options.kwargs.keys().next() {
            let name = name.clone();
            return Err(Error::UnknownKeyword { name, known: "none".into() });
        }
        let mut observation = Space::new();
        observation.push(0.0, 1e6, "steps");
        observation.push(-1e6, 1e6, "sum");
        let mut action = Space::new();
        action.push(-1.0, 1.0, "push");
        let spec = Spec {
            machine: "counter",
            task: "count",
            id: options.id.clone(),
            observation,
            action,
            reward_terms: vec!["sum"],
            metrics: vec![],
            keywords: vec![],
            parameters: vec![Parameter {
                name: "seed",
                unit: "",
                default: 0.0,
                low: 0.0,
                high: 1e9,
                doc: "What the episode was seeded with.",
            }],
            config: Map::new(),
            default_max_episode_steps: 3,
            control_dt: 0.01,
            physics_dt: 0.01,
            error: None,
            warning: None,
        };
        Ok(Box::new(Counters {
            spec,
            mode: options.autoreset_mode,
            limit: options.max_episode_steps,
            rows: vec![(0, 0.0, false); options.num_envs],
            told: vec![None; options.num_envs],
            threads: options.num_threads,
            used: 0,
        }))
    }

    fn write(&self, i: usize, out: &mut [f32]) {
        out.copy_from_slice(&[self.rows[i].0 as f32, self.rows[i].1]);
    }
}

impl VectorEnv for Counters {
    fn spec(&self) -> &Spec {
        &self.spec
    }
    fn num_envs(&self) -> usize {
        self.rows.len()
    }
    fn autoreset_mode(&self) -> AutoresetMode {
        self.mode
    }
    fn max_episode_steps(&self) -> Option<u32> {
        self.limit
    }
    fn num_threads(&self) -> usize {
        self.threads
    }
    fn set_num_threads(&mut self, threads: usize) -> Result<()> {
        self.threads = threads;
        Ok(())
    }
    fn reset(
        &mut self,
        seeds: &Seeds,
        mask: Option<&[bool]>,
        _: &ResetOptions,
        out: StepData<'_>,
    ) -> Result<()> {
        for i in 0..self.rows.len() {
            if mask.is_none_or(|m| m[i]) {
                self.rows[i] = (0, 0.0, false);
                out.began[i] = true;
                out.parameters[i] = match seeds {
                    Seeds::Continue => 0.0,
                    Seeds::Base(base) => *base as f64 + i as f64,
                    Seeds::Each(each) => each[i].map_or(-1.0, |s| s as f64),
                };
                out.parameters[i] = self.told[i].unwrap_or(out.parameters[i]);
            }
            self.write(i, &mut out.observation[2 * i..2 * i + 2]);
        }
        Ok(())
    }
    /// The system of this batch grants no more than 40 threads.
    fn step(&mut self, actions: &[f32], out: StepData<'_>) -> Result<()> {
        if self.threads > 40 {
            return Err(Error::parameter("num_threads", self.threads, "what the system allows"));
        }
        self.used = self.threads;
        if let Some(index) = actions.iter().position(|a| !a.is_finite()) {
            return Err(Error::Action { index, value: f64::from(actions[index]) });
        }
        assert!(!actions.contains(&99.0), "the forbidden action");
        for (i, action) in actions.iter().enumerate() {
            if self.rows[i].2 && self.mode == AutoresetMode::NextStep {
                self.rows[i] = (0, self.rows[i].1, false);
                out.began[i] = true;
                out.reward[i] = 0.0;
            } else {
                self.rows[i].0 += 1;
                self.rows[i].1 += action;
                out.stepped[i] = true;
                out.reward[i] = f64::from(self.rows[i].1);
                out.terms[i] = out.reward[i];
                out.truncated[i] = self.limit.is_some_and(|l| self.rows[i].0 >= l);
                self.rows[i].2 = out.truncated[i];
                if out.truncated[i] && self.mode == AutoresetMode::SameStep {
                    self.write(i, &mut out.final_observation[2 * i..2 * i + 2]);
                    self.rows[i] = (0, self.rows[i].1, false);
                    out.began[i] = true;
                }
            }
            self.write(i, &mut out.observation[2 * i..2 * i + 2]);
        }
        Ok(())
    }
    /// Tells the value of `seed` in place of the seed; knows no ranges.
    fn configure(&mut self, range: std::ops::Range<usize>, settings: &Settings) -> Result<()> {
        let unknown =
            |name: &String| Error::UnknownParameter { name: name.clone(), known: "seed".into() };
        let mut names = settings.parameters.keys().filter(|name| *name != "seed");
        if let Some(name) = names.next().or(settings.randomize.keys().next()) {
            return Err(unknown(name));
        }
        for (k, index) in range.enumerate() {
            let value = settings.parameters.get("seed").and_then(|value| match value {
                Value::Array(each) => each.get(k)?.as_f64(),
                one => one.as_f64(),
            });
            self.told[index] = value.or(self.told[index]);
        }
        Ok(())
    }
    fn get_state(&self, index: usize) -> Result<Vec<u8>> {
        let (steps, sum, ended) = self.rows[index];
        Ok([&steps.to_le_bytes()[..], &sum.to_le_bytes(), &[ended.into()]].concat())
    }
    fn set_state(&mut self, index: usize, bytes: &[u8]) -> Result<()> {
        let bytes: [u8; 9] = bytes.try_into().map_err(|_| Error::snapshot("9 bytes are needed"))?;
        let [a, b, c, d, e, f, g, h, ended] = bytes;
        let (steps, sum) = (u32::from_le_bytes([a, b, c, d]), f32::from_le_bytes([e, f, g, h]));
        self.rows[index] = (steps, sum, ended != 0);
        Ok(())
    }
    fn observe(&self, index: usize, out: &mut [f32]) -> Result<()> {
        self.write(index, out);
        Ok(())
    }
    fn scene(&self, index: usize) -> Result<Scene> {
        if index >= self.rows.len() {
            return Err(Error::Index { index, num_envs: self.rows.len() });
        }
        Ok(Scene {
            machine: "counter".into(),
            time: 0.0,
            steps: self.rows[index].0,
            nodes: vec![[0.0, 0.5], [1.0, 1.5]],
            thickness: vec![0.1, 0.2],
            curvature: vec![0.0, 0.0],
            action: vec![0.0],
            reward: 0.0,
            episode_return: 0.0,
            values: Map::from_iter([("threads".to_string(), json!(self.used))]),
            arrows: Map::from_iter([("wind".to_string(), json!([[1.0, 2.0], [3.0, 4.0]]))]),
        })
    }
    fn parameters(&self, _: usize) -> Result<Vec<f64>> {
        Ok(vec![0.0])
    }
    fn nodes(&self, _: usize) -> Result<NodeState> {
        Ok(NodeState::default())
    }

    fn simulation(&self, index: usize) -> Result<Box<dyn Simulation>> {
        Err(Error::Index { index, num_envs: 0 })
    }
}

/// A reply taken apart.
#[derive(Clone, Debug)]
pub struct Reply {
    pub header: ReplyHeader,
    pub frames: Vec<Frame>,
}

impl Reply {
    pub fn read(frames: &[Frame]) -> Reply {
        let header = wire::decode_reply(&frames[0]).expect("a reply's header can be read");
        assert_eq!(header.arr.len(), frames.len() - 1, "one frame an array");
        assert_eq!(header.ok, header.err.is_none());
        Reply { header, frames: frames[1..].to_vec() }
    }
    pub fn code(&self) -> &str {
        self.header.err.as_ref().map_or("ok", |e| &e.code)
    }
    pub fn p(&self, name: &str) -> &Value {
        &self.header.p[name]
    }
    pub fn has(&self, name: &str) -> bool {
        self.header.arr.iter().any(|a| a.0 == name)
    }
    pub fn array<T: wire::Element>(&self, name: &str) -> Vec<T> {
        let i = self.header.arr.iter().position(|a| a.0 == name).expect(name);
        assert_eq!(self.header.arr[i].1, T::DTYPE, "{name}");
        wire::read(&self.frames[i])
    }
}

/// A server of counters and a user who talks to it.
pub struct Desk {
    pub server: Server,
    pub shared: Arc<Shared>,
    pub now: Duration,
    pub user: String,
    rid: u64,
}

impl Desk {
    pub fn new(limits: Limits) -> Self {
        let shared = Arc::new(Shared::new(limits, "epoch-of-tests"));
        // The first two numbers make the key of the digests, the third is the first session's.
        let mut next = u128::MAX - 1;
        // Far apart, so that guessing is not what a test does by accident.
        let ids = move || {
            next = next.wrapping_add(1);
            next.wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835)
        };
        let server = Server::new(shared.clone(), Box::new(ids)).factory(Arc::new(Counters::boxed));
        Desk { server, shared, now: Duration::ZERO, user: "ada".into(), rid: 0 }
    }

    pub fn send(&mut self, frames: &[Vec<u8>]) -> Reply {
        Reply::read(&self.server.handle(self.now, &self.user, frames))
    }

    /// A request with arrays of f32.
    pub fn ask(&mut self, op: &str, sid: Option<&str>, seq: Option<u64>, p: Value) -> Reply {
        self.send(&self.request(op, sid, seq, p, &[]))
    }

    pub fn request(
        &self,
        op: &str,
        sid: Option<&str>,
        seq: Option<u64>,
        p: Value,
        arrays: &[(ArrayHeader, Frame)],
    ) -> Vec<Vec<u8>> {
        let header = RequestHeader {
            v: 1,
            op: op.into(),
            rid: self.rid + 1,
            sid: sid.map(Into::into),
            seq,
            arr: arrays.iter().map(|a| a.0.clone()).collect(),
            p: p.as_object().expect("parameters are a map").clone(),
        };
        let mut frames = vec![wire::encode(&header)];
        frames.extend(arrays.iter().map(|a| a.1.to_vec()));
        frames
    }

    /// Makes a session and gives its number.
    pub fn make(&mut self, n: usize, mode: &str) -> String {
        self.rid += 1;
        let nonce = format!("{:032x}", self.rid);
        let p =
            json!({"id": "test/Counter-v0", "num_envs": n, "autoreset_mode": mode, "nonce": nonce});
        let reply = self.ask("make", None, None, p);
        assert_eq!(reply.code(), "ok", "{:?}", reply.header.err);
        reply.p("sid").as_str().expect("sid is text").into()
    }

    pub fn step(&mut self, sid: &str, seq: u64, action: &[f32]) -> Reply {
        let array = wire::array("action", &[action.len(), 1], action);
        self.send(&self.request("step", Some(sid), Some(seq), json!({}), &[array]))
    }
}
