//! Many environments of one kind: lanes times threads, autoreset, time limits.
//!
//! Environments are grouped into blocks of `R::LANES`; a block is stepped by one thread in vector
//! instructions. An environment's results depend on its seed and actions alone, never on the batch around it.

mod block;
mod derivative;
mod machine;
mod make;
mod pool;
mod rehearsal;
mod task;
mod vector_env;

pub use machine::{Differentiated, Gradient, Machine};
pub use make::{BatchOptions, MAX_ENVS, MAX_THREADS, in_lanes, make};
pub use rehearsal::{Expansion, Rehearsal};
pub use task::{Outcome, Scorer, Task};

use crate::draw::Draw;
use crate::env::{ResetOptions, StepData, rows};
use crate::error::{Error, Result};
use crate::given::place;
use crate::lane::Real;
use crate::results::{Rows, Widths, check_length};
use crate::simulation::Named;
use crate::watch::Watch;
use block::{Block, Environment, Rules};
use make::spec;
use pool::Pool;
use serde_json::{Map, Value};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Blocks a thread must have at least, or waking it costs more than it saves.
const BLOCKS_A_THREAD: usize = 4;
/// Work below which no step is long, so that nobody looks at the clock.
const SHORT: f64 = 1e6;

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

impl<M: Machine, R: Real> Batch<M, R> {
    /// A batch in numbers `R`; options are taken as checked.
    ///
    /// # Errors
    /// A keyword that is refused.
    pub fn new<T: Task<Machine = M>>(
        id: &str,
        task: &T,
        given: &Map<String, Value>,
        options: &BatchOptions,
    ) -> Result<Self> {
        let n = options.num_envs;
        let machine = M::new(&task.setup(), given)?;
        let rules =
            Rules { mode: options.autoreset_mode, max_episode_steps: options.max_episode_steps };
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
