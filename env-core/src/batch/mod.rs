//! Many environments of one kind: lanes times threads, autoreset, time limits.
//!
//! Environments are grouped into blocks of `R::LANES`; a block is stepped by one thread in vector
//! instructions. An environment's results depend on its seed and actions alone, never on the batch around it.

mod block;
mod derivative;
mod machine;
mod pool;
mod rehearsal;
mod task;

pub use machine::{Differentiated, Gradient, Machine};
pub use rehearsal::{Expansion, Rehearsal};
pub use task::{Outcome, Scorer, Task};

use crate::draw::Draw;
use crate::env::{
    AutoresetMode, LongStep, NodeState, ResetOptions, Saved, Scene, Seeds, Settings, Spec,
    StepData, VectorEnv, rows,
};
use crate::error::{Error, Result};
use crate::given::place;
use crate::isa::{ForLanes, Isa, with_lanes};
use crate::lane::Real;
use crate::results::{Rows, Widths, check_length};
use crate::simulation::{Named, Simulation};
use crate::snapshot::Snapshot;
use crate::watch::Watch;
use block::{Block, Environment, ResetRows, Rules};
use pool::Pool;
use serde_json::{Map, Value};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Blocks a thread must have at least, or waking it costs more than it saves.
const BLOCKS_A_THREAD: usize = 4;
/// Work of a step that may be long, for all that is known before the first: some 2 ms in eight lanes, 100 ms in one.
const GUESSED: f64 = 4e6;
/// Work below which no step is long, so that nobody looks at the clock.
const SHORT: f64 = 1e6;
/// A step that takes longer is one that somebody may want to stop.
const LONG: Duration = Duration::from_millis(50);
/// Most environments of one batch.
pub const MAX_ENVS: usize = 1 << 20;
/// Most threads of one batch.
pub const MAX_THREADS: usize = 256;

/// A batch of environments of machine `M`, `R::LANES` to a block.
pub struct Batch<M: Machine, R: Real> {
    env: Environment<M, R>,
    blocks: Vec<Block<M, R>>,
    num_envs: usize,
    threads: usize,
    pool: Option<Pool>,
    /// Threads of derivatives, which are worth more of them than steps are.
    derivative_pool: Option<Pool>,
    /// Numbers that a control step changes, times its physics steps.
    work: f64,
    /// How long the last step took, where steps may be long.
    took: Option<Duration>,
}

/// How to run a batch: see `catalog::MakeOptions`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields are those of MakeOptions")]
pub struct BatchOptions {
    pub num_envs: usize,
    pub autoreset_mode: AutoresetMode,
    pub max_episode_steps: Option<u32>,
    pub num_threads: usize,
}

/// Makes a batch of a task's environments with the number of lanes that suits its size and the processor.
///
/// # Errors
/// A keyword or an option that is refused.
pub fn make<T: Task>(
    id: &str,
    task: &T,
    given: &Map<String, Value>,
    options: &BatchOptions,
) -> Result<Box<dyn VectorEnv>> {
    check_count("num_envs", options.num_envs, MAX_ENVS)?;
    check_count("num_threads", options.num_threads, MAX_THREADS)?;
    if options.max_episode_steps == Some(0) {
        return Err(Error::parameter("max_episode_steps", 0, "at least 1"));
    }
    let isa = Isa::current()?;
    if options.num_envs == 1 {
        return Ok(Box::new(Batch::<T::Machine, f64>::new(
            id,
            task,
            given,
            options,
            Isa::Baseline,
        )?));
    }
    in_lanes(id, task, given, options, isa)
}

/// Makes a batch in eight lanes with the given instruction set; options are taken as checked.
///
/// # Errors
/// A keyword that is refused.
///
/// # Panics
/// When this machine lacks the instruction set.
pub fn in_lanes<T: Task>(
    id: &str,
    task: &T,
    given: &Map<String, Value>,
    options: &BatchOptions,
    isa: Isa,
) -> Result<Box<dyn VectorEnv>> {
    struct Make<'a, T>(&'a str, &'a T, &'a Map<String, Value>, &'a BatchOptions, Isa);
    impl<T: Task> ForLanes for Make<'_, T> {
        type Output = Result<Box<dyn VectorEnv>>;
        fn make<R: Real>(self) -> Self::Output {
            let Make(id, task, given, options, isa) = self;
            Ok(Box::new(Batch::<T::Machine, R>::new(id, task, given, options, isa)?))
        }
    }
    with_lanes(isa, Make(id, task, given, options, isa))
}

/// All that users can ask of a task's environments.
fn spec<T: Task>(id: &str, machine: &T::Machine) -> Spec {
    let mut observation = machine.observation();
    for &(name, bound) in T::OBSERVATION {
        observation.push(-bound, bound, name);
    }
    Spec {
        id: id.into(),
        machine: T::Machine::NAME,
        task: T::NAME,
        observation,
        action: machine.action(),
        reward_terms: T::TERMS.to_vec(),
        metrics: [T::Machine::METRICS, T::METRICS].concat(),
        parameters: machine.parameter_table().to_vec(),
        keywords: T::Machine::KEYWORDS.to_vec(),
        config: machine.resolved().clone(),
        default_max_episode_steps: T::MAX_EPISODE_STEPS,
        control_dt: machine.control_dt(),
        physics_dt: machine.physics_dt(),
        error: machine.error(),
        warning: machine.warning(),
    }
}

fn check_count(name: &str, value: usize, most: usize) -> Result<()> {
    if (1..=most).contains(&value) {
        return Ok(());
    }
    Err(Error::parameter(name, value, format!("an integer from 1 to {most}")))
}

impl<M: Machine, R: Real> Batch<M, R> {
    /// A batch whose blocks use the given instruction set; options are taken as checked.
    ///
    /// # Errors
    /// A keyword that is refused.
    pub fn new<T: Task<Machine = M>>(
        id: &str,
        task: &T,
        given: &Map<String, Value>,
        options: &BatchOptions,
        isa: Isa,
    ) -> Result<Self> {
        let n = options.num_envs;
        let machine = M::new(&task.setup(), given)?;
        let rules = Rules {
            mode: options.autoreset_mode,
            max_episode_steps: options.max_episode_steps,
            isa,
        };
        let spec = spec::<T>(id, &machine);
        let (task_of_slopes, task_of_one) = (Arc::new(task.clone()), Arc::new(task.clone()));
        let task = Box::new(task.clone());
        let env = Environment { machine, task, task_of_slopes, task_of_one, spec, rules };
        let block = |first| Block::new(&env, R::LANES.min(n - first), first as u64);
        let blocks: Vec<_> = (0..n).step_by(R::LANES).map(block).collect();
        let work = blocks[0].numbers() as f64 * n as f64 * env.machine.control_dt()
            / env.machine.physics_dt();
        let threads = options.num_threads;
        Ok(Batch {
            env,
            blocks,
            num_envs: n,
            threads,
            pool: None,
            derivative_pool: None,
            work,
            took: None,
        })
    }

    fn place(&self, index: usize) -> Result<(usize, usize)> {
        if index >= self.num_envs {
            return Err(Error::Index { index, num_envs: self.num_envs });
        }
        Ok((index / R::LANES, index % R::LANES))
    }

    /// How the parameters of an environment are drawn.
    fn draws_of(&self, index: usize) -> &[Draw] {
        let own = self.blocks[index / R::LANES].draws(index % R::LANES);
        own.map_or(self.env.machine.draws(), |draws| draws)
    }

    /// Checks reset options for all environments that they concern.
    fn check_options(&self, options: &ResetOptions, mask: Option<&[bool]>) -> Result<M::Start> {
        let machine = &self.env.machine;
        let mut checked: Option<(&[Draw], M::Start)> = None;
        for index in (0..self.num_envs).filter(|&index| mask.is_none_or(|mask| mask[index])) {
            let draws = self.draws_of(index);
            if checked.as_ref().is_none_or(|(last, _)| !std::ptr::eq(*last, draws)) {
                checked = Some((draws, machine.check(options, draws)?));
            }
        }
        match checked {
            Some((_, start)) => Ok(start),
            None => machine.check(options, machine.draws()),
        }
    }

    fn step_watched(
        &mut self,
        actions: &[f32],
        mut out: StepData<'_>,
        watch: Watch<'_>,
    ) -> Result<()> {
        let widths = Widths::of(&self.env.spec);
        out.check(widths, self.num_envs)?;
        let size = self.env.spec.action.size();
        check_length("action", actions.len(), self.num_envs * size)?;
        if let Some(at) = actions.iter().position(|a| !a.is_finite()) {
            return Err(Error::Action { index: at / size, value: actions[at] as f64 });
        }
        for (b, block) in self.blocks.iter().enumerate() {
            if let Some(error) = block.refuses_step(&self.env.rules, b * R::LANES) {
                return Err(error);
            }
        }
        let began = (self.work > SHORT).then(Instant::now);
        let threads = self.useful_threads();
        let rows = Rows::new(widths, &mut out);
        let env = &self.env;
        let step = |b: usize, block: &mut Block<M, R>| {
            let (first, count) = (b * R::LANES, block.used());
            // SAFETY: `out` is borrowed for as long as `rows` is used, and each block is stepped by one
            // thread, so nobody else holds these rows.
            let mut mine = unsafe { rows.of(first, count) };
            block.step(env, &actions[first * size..(first + count) * size], &mut mine, watch);
        };
        if threads == 1 {
            self.blocks.iter_mut().enumerate().for_each(|(b, block)| step(b, block));
        } else {
            ensure_pool(&mut self.pool, threads)?.share(&mut self.blocks, step);
        }
        if !watch.stops() {
            self.took = began.map(|began| began.elapsed());
        }
        Ok(())
    }

    /// Checks what a derivative is asked for; returns the places of the parameters.
    fn check_derivative(
        &self,
        index: usize,
        actions: &[f32],
        parameters: &[String],
    ) -> Result<Vec<usize>> {
        if let Some(&value) = actions.iter().find(|a| !a.is_finite()) {
            return Err(Error::Action { index, value: value as f64 });
        }
        let table = self.env.machine.parameter_table();
        let known: Vec<_> = table.iter().map(|parameter| parameter.name).collect();
        parameters.iter().map(|name| place(name, &known)).collect()
    }

    /// What `derive` finds for every environment and its row of `actions`, an environment a thread.
    fn over_threads(
        &mut self,
        actions: &[f32],
        derive: impl Fn(&Self, usize, &[f32]) -> Result<Vec<Named>> + Sync,
    ) -> Result<Vec<Named>> {
        struct Row<'a> {
            index: usize,
            actions: &'a [f32],
            found: Result<Vec<Named>>,
        }
        let row = |(index, actions)| Row { index, actions, found: Ok(vec![]) };
        let mut rows: Vec<Row<'_>> = rows(actions, self.num_envs).map(row).collect();
        let threads = self.threads.min(self.num_envs);
        let mut pool = self.derivative_pool.take();
        let batch = &*self;
        let work = |_: usize, row: &mut Row<'_>| row.found = derive(batch, row.index, row.actions);
        if threads == 1 {
            rows.iter_mut().for_each(|row| work(0, row));
        } else {
            ensure_pool(&mut pool, threads)?.share(&mut rows, work);
        }
        self.derivative_pool = pool;
        Ok(Named::stack(rows.into_iter().map(|row| row.found).collect::<Result<_>>()?))
    }

    /// Threads that a step really uses.
    fn useful_threads(&self) -> usize {
        self.threads.min(self.blocks.len() / BLOCKS_A_THREAD).max(1)
    }
}

/// The pool, built or rebuilt where needed.
fn ensure_pool(pool: &mut Option<Pool>, threads: usize) -> Result<&mut Pool> {
    if !pool.as_ref().is_some_and(|pool| pool.is_alive() && pool.threads() == threads) {
        *pool = Some(Pool::new(threads).map_err(|error| {
            Error::parameter("num_threads", threads, format!("what the system allows ({error})"))
        })?);
    }
    Ok(pool.as_mut().expect("made above"))
}

impl<M: Machine, R: Real> VectorEnv for Batch<M, R> {
    fn spec(&self) -> &Spec {
        &self.env.spec
    }

    fn num_envs(&self) -> usize {
        self.num_envs
    }

    fn autoreset_mode(&self) -> AutoresetMode {
        self.env.rules.mode
    }

    fn max_episode_steps(&self) -> Option<u32> {
        self.env.rules.max_episode_steps
    }

    fn num_threads(&self) -> usize {
        self.threads
    }

    fn set_num_threads(&mut self, threads: usize) -> Result<()> {
        check_count("num_threads", threads, MAX_THREADS)?;
        self.threads = threads;
        Ok(())
    }

    fn reset(
        &mut self,
        seeds: &Seeds,
        mask: Option<&[bool]>,
        options: &ResetOptions,
        mut out: StepData<'_>,
    ) -> Result<()> {
        let widths = Widths::of(&self.env.spec);
        out.check(widths, self.num_envs)?;
        if let Some(mask) = mask {
            check_length("reset_mask", mask.len(), self.num_envs)?;
        }
        if let Seeds::Each(each) = seeds {
            check_length("seed", each.len(), self.num_envs)?;
        }
        let start = self.check_options(options, mask)?;
        let seed = |index: usize| match seeds {
            Seeds::Continue => None,
            Seeds::Base(base) => Some(base.wrapping_add(index as u64)),
            Seeds::Each(each) => each[index],
        };
        let rows = Rows::new(widths, &mut out);
        for (b, block) in self.blocks.iter_mut().enumerate() {
            let first = b * R::LANES;
            // SAFETY: `out` is borrowed for as long as `rows` is used, one block at a time.
            let mut mine = unsafe { rows.of(first, block.used()) };
            let place = ResetRows { first, mask };
            block.reset(&self.env, &place, seed, &start, &mut mine);
        }
        Ok(())
    }

    fn step(&mut self, actions: &[f32], out: StepData<'_>) -> Result<()> {
        self.step_watched(actions, out, Watch::nobody())
    }

    fn configure(&mut self, range: Range<usize>, settings: &Settings) -> Result<()> {
        if range.is_empty() || range.end > self.num_envs {
            let index = range.end.saturating_sub(1).max(range.start);
            return Err(Error::Index { index, num_envs: self.num_envs });
        }
        let machine = &self.env.machine;
        let changes = settings.read(machine.parameter_table(), range.len())?;
        let mut changed: Vec<Option<Arc<[Draw]>>> = Vec::with_capacity(range.len());
        for (k, index) in range.clone().enumerate() {
            let mut draws = self.draws_of(index).to_vec();
            changes.make(k, &mut draws);
            Draw::check_together(&draws, machine.parameter_table())?;
            // Neighbours are often alike.
            changed.push(match changed.last() {
                Some(Some(last)) if **last == *draws => Some(last.clone()),
                _ if draws == machine.draws() => None,
                _ => {
                    machine.check_draws(&draws)?;
                    Some(draws.into())
                }
            });
        }
        for (index, draws) in range.zip(changed) {
            self.blocks[index / R::LANES].set_draws(index % R::LANES, draws);
        }
        Ok(())
    }

    fn long_step(&mut self) -> Option<&mut dyn LongStep> {
        let long = self.took.map_or(self.work > GUESSED, |took| took > LONG);
        if long { Some(self) } else { None }
    }

    fn get_state(&self, index: usize) -> Result<Vec<u8>> {
        let (block, lane) = self.place(index)?;
        Ok(self.blocks[block].snapshot(lane).encode(self.spec()))
    }

    fn set_state(&mut self, index: usize, bytes: &[u8]) -> Result<()> {
        let (block, lane) = self.place(index)?;
        let saved = Snapshot::decode(bytes, self.spec())?;
        self.blocks[block].restore(&self.env, lane, &saved)
    }

    fn observe(&self, index: usize, out: &mut [f32]) -> Result<()> {
        let (block, lane) = self.place(index)?;
        check_length("observation", out.len(), self.spec().observation.size())?;
        out.copy_from_slice(self.blocks[block].returned(lane));
        Ok(())
    }

    fn scene(&self, index: usize) -> Result<Scene> {
        let (block, lane) = self.place(index)?;
        Ok(self.blocks[block].scene(&self.env, lane))
    }

    fn parameters(&self, index: usize) -> Result<Vec<f64>> {
        let (block, lane) = self.place(index)?;
        let mut values = vec![0.0; self.spec().parameters.len()];
        self.env.machine.parameters(self.blocks[block].plant(), lane, &mut values);
        Ok(values)
    }

    fn nodes(&self, index: usize) -> Result<NodeState> {
        let (block, lane) = self.place(index)?;
        Ok(self.env.machine.nodes(self.blocks[block].plant(), lane))
    }

    fn step_jacobian(
        &self,
        index: usize,
        action: &[f32],
        parameters: &[String],
    ) -> Result<Vec<Named>> {
        let (block, lane) = self.place(index)?;
        check_length("action", action.len(), self.env.spec.action.size())?;
        let chosen = self.check_derivative(index, action, parameters)?;
        self.blocks[block].jacobian(&self.env, lane, action, &chosen)
    }

    fn rollout_gradient(
        &self,
        index: usize,
        actions: &[f32],
        parameters: &[String],
    ) -> Result<Vec<Named>> {
        let (block, lane) = self.place(index)?;
        let size = self.env.spec.action.size();
        check_length("actions", actions.len(), actions.len().div_ceil(size) * size)?;
        let chosen = self.check_derivative(index, actions, parameters)?;
        self.blocks[block].rollout_gradient(&self.env, lane, actions, &chosen)
    }

    fn step_jacobians(&mut self, actions: &[f32], parameters: &[String]) -> Result<Vec<Named>> {
        check_length("actions", actions.len(), self.num_envs * self.env.spec.action.size())?;
        self.over_threads(actions, |batch, index, row| batch.step_jacobian(index, row, parameters))
    }

    fn rollout_gradients(&mut self, actions: &[f32], parameters: &[String]) -> Result<Vec<Named>> {
        let row = self.num_envs * self.env.spec.action.size();
        check_length("actions", actions.len(), actions.len().div_ceil(row) * row)?;
        self.over_threads(actions, |batch, index, row| {
            batch.rollout_gradient(index, row, parameters)
        })
    }

    fn rehearsal(&self, index: usize) -> Result<Box<dyn Rehearsal>> {
        let (block, lane) = self.place(index)?;
        self.blocks[block].rehearsal(&self.env, lane)
    }

    fn simulation(&self, index: usize) -> Result<Box<dyn Simulation>> {
        let (block, lane) = self.place(index)?;
        Ok(self.env.machine.simulation(self.blocks[block].plant(), lane))
    }
}

impl<M: Machine, R: Real> LongStep for Batch<M, R> {
    fn save(&self) -> Saved {
        Box::new(self.blocks.clone())
    }

    fn restore(&mut self, saved: Saved) {
        self.blocks = *saved.downcast().expect("it was saved by this batch");
    }

    fn step_unless(&mut self, actions: &[f32], out: StepData<'_>, stop: &AtomicBool) -> Result<()> {
        self.step_watched(actions, out, Watch::new(stop))
    }
}
