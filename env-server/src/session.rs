//! One session: a batch of environments, its owner, and the replies it still remembers.

use crate::error::{Code, Refusal};
use crate::memory::Charge;
use crate::shared::{Helpers, Place};
use crate::window::Window;
use crate::wire::{self, ArrayHeader, Arrays, Frame};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, Settings, StepBuffer, VectorEnv};
use serde_json::{Map, Value, json};
use std::time::Duration;

/// Bits of the `flags` array, one byte an environment.
pub mod flag {
    /// The task ended the episode.
    pub const TERMINATED: u8 = 1;
    /// The time limit or a solver failure cut the episode.
    pub const TRUNCATED: u8 = 2;
    /// A step was taken: reward and terms are of this step.
    pub const STEPPED: u8 = 4;
    /// An episode began: `parameters` has a row.
    pub const BEGAN: u8 = 8;
    /// The solver gave up.
    pub const SOLVER_FAILURE: u8 = 16;
    /// `final_obs` has a row.
    pub const FINAL: u8 = 32;
}

/// What an operation answers, before it has a request's number.
#[derive(Clone, Debug, Default)]
pub struct Answer {
    /// Results that are not arrays.
    pub p: Map<String, Value>,
    /// Descriptions of the arrays.
    pub arr: Vec<ArrayHeader>,
    /// Their bytes.
    pub frames: Vec<Frame>,
}

impl Answer {
    /// An answer with parameters only.
    pub fn of(p: Value) -> Self {
        match p {
            Value::Object(p) => Answer { p, ..Answer::default() },
            other => unreachable!("parameters are a map, not {other}"),
        }
    }

    /// Adds an array.
    pub fn push<T: wire::Element>(&mut self, name: &str, shape: &[usize], values: &[T]) {
        let (header, frame) = wire::array(name, shape, values);
        self.arr.push(header);
        self.frames.push(frame);
    }

    /// Bytes of the arrays.
    pub fn bytes(&self) -> usize {
        self.frames.iter().map(|f| f.len()).sum()
    }
}

/// A batch of environments with the replies that it remembers.
pub struct Session {
    /// The reply of `make`, for a client that asks again.
    pub greeting: Answer,
    /// Numbers and replies of the last changing calls.
    pub window: Window<Answer>,
    /// When a request named it last, on the server's clock.
    pub used: Duration,
    /// Steps of the batch since it was made.
    pub steps: u64,
    /// How long its next step may take: as the last one, a guess before the first.
    pub expected: Duration,
    /// Its place and memory, given back with it.
    pub reserved: Option<(Place, Charge)>,
    env: Box<dyn VectorEnv>,
    buffer: StepBuffer,
    helpers: Option<Helpers>,
}

impl Session {
    /// A session around a new batch.
    pub fn new(env: Box<dyn VectorEnv>, window: usize, now: Duration) -> Self {
        let buffer = StepBuffer::new(env.spec(), env.num_envs());
        Session {
            greeting: Answer::default(),
            window: Window::new(window),
            used: now,
            steps: 0,
            expected: Duration::ZERO,
            reserved: None,
            env,
            buffer,
            helpers: None,
        }
    }

    /// Lets the next step use several threads, which `lend` grants, or one.
    pub fn spread(&mut self, threads: usize, lend: impl FnOnce() -> Option<Helpers>) {
        if threads > 1 && self.helpers.is_none() {
            self.helpers = lend();
        }
        let granted = if self.helpers.is_some() { threads } else { 1 };
        if self.env.num_threads() != granted && self.env.set_num_threads(granted).is_err() {
            self.helpers = None;
        }
    }

    /// Writes the reply of `make`.
    pub fn greet(&mut self, sid: u128, window: usize, message_bytes: usize) {
        let env = &self.env;
        self.greeting = Answer::of(json!({
            "sid": format!("{sid:032x}"),
            "window": window,
            "message_bytes": message_bytes,
            "num_envs": env.num_envs(),
            "autoreset_mode": env.autoreset_mode(),
            "max_episode_steps": env.max_episode_steps(),
            "spec": env.spec(),
        }));
    }

    /// The batch.
    pub fn env(&self) -> &dyn VectorEnv {
        &*self.env
    }

    /// Starts episodes. Arrays: `seeds` <u8 (n) with `seeded` |b1 (n), `mask` |b1 (n),
    /// `state:NAME` <f8; parameters: `seed`, `options`.
    ///
    /// # Errors
    /// What cannot be read, and what the environment refuses.
    pub fn reset(&mut self, p: &Map<String, Value>, arrays: &Arrays) -> Result<Answer, Refusal> {
        let n = self.env.num_envs();
        let seeds = match (arrays.get("seeds", "<u8", &[n])?, field::<Option<u64>>(p, "seed")?) {
            (None, None) => Seeds::Continue,
            (None, Some(base)) => Seeds::Base(base),
            (Some(bytes), None) => {
                let seeded = arrays.get("seeded", "|b1", &[n])?;
                let given = |i: usize| seeded.is_none_or(|s| s[i] != 0);
                let each = wire::read::<u64>(bytes);
                Seeds::Each(
                    each.into_iter().enumerate().map(|(i, s)| given(i).then_some(s)).collect(),
                )
            }
            (Some(_), Some(_)) => {
                return Err(bad("'seed' and array 'seeds' cannot both be given"));
            }
        };
        let mask: Option<Vec<bool>> =
            arrays.get("mask", "|b1", &[n])?.map(|m| m.iter().map(|b| *b != 0).collect());
        let mut options: ResetOptions = field(p, "options")?;
        let state = lists_from_arrays(arrays, "state:")?;
        if !state.is_empty() {
            options.state = Some(Value::Object(state));
        }
        self.clear();
        self.env.reset(&seeds, mask.as_deref(), &options, self.buffer.data())?;
        let mut answer = Answer::default();
        self.push_observation(&mut answer);
        self.push_flags(&mut answer);
        self.push_parameters(&mut answer);
        Ok(answer)
    }

    /// One control step of the batch. Array `action` <f4 (n, a).
    ///
    /// # Errors
    /// What cannot be read, and what the environment refuses.
    pub fn step(&mut self, arrays: &Arrays) -> Result<Answer, Refusal> {
        let n = self.env.num_envs();
        let size = self.env.spec().action.size();
        let action = wire::read::<f32>(arrays.need("action", "<f4", &[n, size])?);
        self.clear();
        let done = self.env.step(&action, self.buffer.data());
        if done.is_err() && self.env.num_threads() > 1 {
            // Perhaps the system grants no further threads. A step that is refused has changed nothing.
            self.env.set_num_threads(1)?;
            self.env.step(&action, self.buffer.data())?;
        } else {
            done?;
        }
        self.steps += 1;
        let mut answer = Answer::default();
        self.push_observation(&mut answer);
        answer.push("reward", &[n], &self.buffer.reward);
        self.push_flags(&mut answer);
        answer.push("terms", &[n, self.buffer.terms.len() / n], &self.buffer.terms);
        self.push_final_observation(&mut answer);
        self.push_parameters(&mut answer);
        Ok(answer)
    }

    /// Snapshots of environments `first` to `first + count`: `sizes` <u4 (count), `data` |u1.
    ///
    /// # Errors
    /// Numbers beyond the batch; a result beyond `max_bytes`.
    pub fn get_state(&self, p: &Map<String, Value>, max_bytes: usize) -> Result<Answer, Refusal> {
        let range = self.range(p)?;
        let (first, count) = (range.start, range.len());
        let (mut sizes, mut data) = (Vec::with_capacity(count), Vec::new());
        for index in range {
            let state = self.env.get_state(index)?;
            sizes.push(state.len() as u32);
            data.extend_from_slice(&state);
            if data.len() > max_bytes {
                let text = format!(
                    "snapshots of {count} environments exceed {max_bytes} bytes; ask for fewer with 'first' and 'count'"
                );
                return Err(Refusal::new(Code::Limit, text));
            }
        }
        let mut answer = Answer::of(json!({"first": first}));
        answer.push("sizes", &[count], &sizes);
        answer.push("data", &[data.len()], &data);
        Ok(answer)
    }

    /// Puts snapshots into environments from `first` on, all or none; answers like `observe`.
    ///
    /// # Errors
    /// Sizes that do not add up; a snapshot that the environment refuses.
    pub fn set_state(
        &mut self,
        p: &Map<String, Value>,
        arrays: &Arrays,
    ) -> Result<Answer, Refusal> {
        let length = |name: &str| {
            let shape = arrays.with_prefix(name).find(|a| a.0.is_empty()).map(|a| a.2.to_vec());
            shape.map(|s| s.iter().product::<u64>() as usize).unwrap_or(0)
        };
        let sizes = wire::read::<u32>(arrays.need("sizes", "<u4", &[length("sizes")])?);
        let data = arrays.need("data", "|u1", &[length("data")])?;
        let total: u64 = sizes.iter().map(|s| u64::from(*s)).sum();
        if total != data.len() as u64 {
            return Err(bad(format!("sizes add up to {total}, but data has {} bytes", data.len())));
        }
        let first: usize = field(p, "first")?;
        let mut place = Map::new();
        place.insert("first".into(), first.into());
        place.insert("count".into(), sizes.len().into());
        self.range(&place)?;
        let mut rest = data;
        let mut before: Vec<Option<Vec<u8>>> = Vec::with_capacity(sizes.len());
        for (index, size) in (first..).zip(&sizes) {
            let (state, tail) = rest.split_at(*size as usize);
            rest = tail;
            // An environment that was never reset has nothing to go back to.
            let old = self.env.get_state(index).ok();
            if let Err(refused) = self.env.set_state(index, state) {
                for (index, old) in (first..).zip(&before) {
                    if let Some(old) = old {
                        self.env.set_state(index, old)?;
                    }
                }
                return Err(refused.into());
            }
            before.push(old);
        }
        self.observe(&place)
    }

    /// Changes how the parameters of environments `first` to `first + count` are drawn, from the next episode of each:
    /// `parameters`, of which those with a value for each environment may be arrays `parameters:NAME` <f8 (count), and
    /// `randomize`.
    ///
    /// # Errors
    /// What cannot be read, and what the environment refuses; nothing changes then.
    pub fn set_parameters(
        &mut self,
        p: &Map<String, Value>,
        arrays: &Arrays,
    ) -> Result<Answer, Refusal> {
        let range = self.range(p)?;
        let mut parameters: Map<String, Value> = field(p, "parameters")?;
        for (name, value) in lists_from_arrays(arrays, "parameters:")? {
            if parameters.insert(name.clone(), value).is_some() {
                return Err(bad(format!("'{name}' is given in 'parameters' and as an array")));
            }
        }
        let randomize = field(p, "randomize")?;
        self.env.configure(range, &Settings { parameters, randomize })?;
        Ok(Answer::default())
    }

    /// The last observations and the parameters in force of environments `first` to
    /// `first + count`: `obs` <f4 (count, d), `parameters` <f8 (count, p).
    ///
    /// # Errors
    /// Numbers beyond the batch, and what the environment refuses.
    pub fn observe(&self, p: &Map<String, Value>) -> Result<Answer, Refusal> {
        let range = self.range(p)?;
        let (count, d) = (range.len(), self.env.spec().observation.size());
        let mut observation = vec![0.0f32; count * d];
        let mut parameters = Vec::new();
        for (index, row) in range.zip(observation.chunks_exact_mut(d)) {
            self.env.observe(index, row)?;
            parameters.extend(self.env.parameters(index)?);
        }
        let mut answer = Answer::default();
        answer.push("obs", &[count, d], &observation);
        answer.push("parameters", &[count, parameters.len() / count], &parameters);
        Ok(answer)
    }

    /// Positions \[m\] and velocities \[m/s\] of the nodes of one environment, <f8 (nodes, 2).
    ///
    /// # Errors
    /// A number beyond the batch.
    pub fn nodes(&self, p: &Map<String, Value>) -> Result<Answer, Refusal> {
        let nodes = self.env.nodes(field(p, "index")?)?;
        let mut answer = Answer::default();
        let count = nodes.positions.len();
        answer.push("positions", &[count, 2], nodes.positions.as_flattened());
        answer.push("velocities", &[count, 2], nodes.velocities.as_flattened());
        Ok(answer)
    }

    /// The environments that `first` and `count` name; all of them if absent.
    fn range(&self, p: &Map<String, Value>) -> Result<std::ops::Range<usize>, Refusal> {
        let n = self.env.num_envs();
        let first: usize = field(p, "first")?;
        let count = field::<Option<usize>>(p, "count")?.unwrap_or(n.saturating_sub(first));
        if first >= n || count == 0 || count > n - first {
            return Err(bad(format!(
                "environments {first} to {first} + {count} of {n} do not exist"
            )));
        }
        Ok(first..first + count)
    }

    /// What there is to draw of one environment: numbers in `p.scene`, node arrays as `nodes`,
    /// `thickness`, `curvature` and `arrow:NAME`.
    ///
    /// # Errors
    /// A number beyond the batch.
    pub fn scene(&self, p: &Map<String, Value>) -> Result<Answer, Refusal> {
        let index: usize = field(p, "index")?;
        let scene = self.env.scene(index)?;
        let mut answer = Answer::of(json!({"scene": {
            "machine": scene.machine, "time": scene.time, "steps": scene.steps,
            "action": scene.action, "reward": scene.reward,
            "episode_return": scene.episode_return, "values": scene.values,
        }}));
        let count = scene.nodes.len();
        answer.push("nodes", &[count, 2], scene.nodes.as_flattened());
        answer.push("thickness", &[scene.thickness.len()], &scene.thickness);
        answer.push("curvature", &[scene.curvature.len()], &scene.curvature);
        for (name, arrow) in &scene.arrows {
            let rows: Vec<[f64; 2]> = serde_json::from_value(arrow.clone())
                .map_err(|e| Refusal::new(Code::Internal, format!("arrow '{name}': {e}")))?;
            answer.push(&format!("arrow:{name}"), &[rows.len(), 2], rows.as_flattened());
        }
        Ok(answer)
    }

    fn clear(&mut self) {
        let b = &mut self.buffer;
        // What a step does not write reads as zero, as in a fresh buffer.
        b.reward.fill(0.0);
        b.terms.fill(0.0);
        for flags in [
            &mut b.terminated,
            &mut b.truncated,
            &mut b.stepped,
            &mut b.began,
            &mut b.solver_failure,
        ] {
            flags.fill(false);
        }
    }

    /// Whether the last step left a final observation of environment `i`.
    fn is_final(&self, i: usize) -> bool {
        let ended = self.buffer.terminated[i] || self.buffer.truncated[i];
        ended && self.env.autoreset_mode() == AutoresetMode::SameStep
    }

    fn push_observation(&self, answer: &mut Answer) {
        let shape = [self.env.num_envs(), self.env.spec().observation.size()];
        answer.push("obs", &shape, &self.buffer.observation);
    }

    fn push_flags(&self, answer: &mut Answer) {
        let b = &self.buffer;
        let flags: Vec<u8> = (0..self.env.num_envs())
            .map(|i| {
                [
                    (b.terminated[i], flag::TERMINATED),
                    (b.truncated[i], flag::TRUNCATED),
                    (b.stepped[i], flag::STEPPED),
                    (b.began[i], flag::BEGAN),
                    (b.solver_failure[i], flag::SOLVER_FAILURE),
                    (self.is_final(i), flag::FINAL),
                ]
                .iter()
                .fold(0, |bits, (set, bit)| if *set { bits | bit } else { bits })
            })
            .collect();
        answer.push("flags", &[flags.len()], &flags);
    }

    /// Rows of the environments whose episode ended in this step; no array if there is none.
    fn push_final_observation(&self, answer: &mut Answer) {
        let d = self.env.spec().observation.size();
        let rows = (0..self.env.num_envs()).filter(|i| self.is_final(*i));
        push_rows(answer, "final_obs", &self.buffer.final_observation, d, rows);
    }

    /// Rows of the environments whose episode began; no array if there is none.
    fn push_parameters(&self, answer: &mut Answer) {
        let p = self.env.spec().parameters.len();
        let rows = (0..self.env.num_envs()).filter(|i| self.buffer.began[*i]);
        push_rows(answer, "parameters", &self.buffer.parameters, p, rows);
    }
}

fn push_rows<T: wire::Element>(
    answer: &mut Answer,
    name: &str,
    table: &[T],
    width: usize,
    rows: impl Iterator<Item = usize>,
) {
    let mut picked = Vec::new();
    let mut count = 0;
    for i in rows {
        picked.extend_from_slice(&table[i * width..(i + 1) * width]);
        count += 1;
    }
    if count > 0 {
        answer.push(name, &[count, width], &picked);
    }
}

/// Lists of numbers that came as arrays, such as `state:positions`: long ones do not fit into a header.
///
/// # Errors
/// Other elements than <f8, more than two dimensions, a number that JSON does not have.
pub fn lists_from_arrays(arrays: &Arrays, prefix: &str) -> Result<Map<String, Value>, Refusal> {
    let mut lists = Map::new();
    for (name, dtype, shape, bytes) in arrays.with_prefix(prefix) {
        let numbers = match dtype {
            "<f8" => wire::read::<f64>(bytes),
            other => {
                return Err(bad(format!("array '{prefix}{name}' is {other}, but <f8 is needed")));
            }
        };
        if let Some(odd) = numbers.iter().find(|number| !number.is_finite()) {
            return Err(bad(format!("array '{prefix}{name}' holds {odd}: numbers must be finite")));
        }
        let value = match shape {
            [_] => json!(numbers),
            [_, columns] if *columns > 0 => {
                let rows = numbers.chunks_exact(*columns as usize);
                Value::Array(rows.map(|row| json!(row)).collect())
            }
            other => return Err(bad(format!("array '{prefix}{name}' has shape {other:?}"))),
        };
        lists.insert(name.into(), value);
    }
    Ok(lists)
}

/// Reads a parameter of an operation; an absent one has its type's default.
///
/// # Errors
/// `bad_request` if it has another type.
pub fn field<T: serde::de::DeserializeOwned + Default>(
    p: &Map<String, Value>,
    name: &str,
) -> Result<T, Refusal> {
    match p.get(name) {
        None | Some(Value::Null) => Ok(T::default()),
        Some(value) => serde_json::from_value(value.clone())
            .map_err(|e| bad(format!("parameter '{name}' = {value} is not allowed: {e}"))),
    }
}

fn bad(text: impl Into<String>) -> Refusal {
    Refusal::new(Code::BadRequest, text)
}
