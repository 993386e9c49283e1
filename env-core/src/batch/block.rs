//! One block of environments in lanes: a control step, a reset, a snapshot.

use super::machine::Machine;
use super::task::{Outcome, Scorer};
use crate::draw::Draw;
use crate::episodes::AutoresetMode;
use crate::error::{Error, Result};
use crate::lane::{Dual, Kernel, Lanewise, Mask, Real};
use crate::results::StepData;
use crate::scene::Scene;
use crate::seed::Stream;
use crate::snapshot::Snapshot;
use crate::spec::Spec;
use crate::watch::Watch;
use std::sync::Arc;

/// What the batch keeps of each environment beside its plant.
#[derive(Clone, Debug, Default)]
pub(super) struct Clock {
    pub(super) steps: u32,
    ended: bool,
    pub(super) begun: bool,
    episode_return: f64,
    reward: f64,
}

/// `R::LANES` environments; the last block of a batch may use fewer.
#[derive(Clone)]
pub struct Block<M: Machine, R: Real> {
    pub(super) plant: M::Plant<R>,
    pub(super) streams: Vec<Stream>,
    /// How parameters are drawn where that is not the machine's way.
    draws: Vec<Option<Arc<[Draw]>>>,
    pub(super) clocks: Vec<Clock>,
    used: usize,
    actions: Vec<R>,
    pub(super) observation: Vec<R>,
    pub(super) outcome: Outcome<R>,
    /// Rows of the observations that were returned last.
    returned: Vec<f32>,
}

/// What all blocks of a batch share.
pub struct Environment<M: Machine, R: Real> {
    pub machine: M,
    pub task: Box<dyn Scorer<M, R>>,
    /// The same task, for derivatives.
    pub task_of_slopes: Arc<dyn Scorer<M, Dual>>,
    /// The same task, for one environment.
    pub task_of_one: Arc<dyn Scorer<M, f64>>,
    pub spec: Spec,
    pub rules: Rules,
}

/// How a batch runs its blocks.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    pub mode: AutoresetMode,
    pub max_episode_steps: Option<u32>,
}

/// Where a reset acts and with what: row numbers are those of the batch.
pub struct ResetRows<'a> {
    pub first: usize,
    pub mask: Option<&'a [bool]>,
}

impl<M: Machine, R: Real> Block<M, R> {
    /// A block whose environments have streams `first_seed`, `first_seed + 1`, ... and no episode yet.
    pub fn new(env: &Environment<M, R>, used: usize, first_seed: u64) -> Self {
        let spec = &env.spec;
        Block {
            plant: env.machine.new_plant(),
            streams: (0..R::LANES as u64).map(|i| Stream::new(first_seed + i)).collect(),
            draws: vec![None; R::LANES],
            clocks: vec![Clock::default(); R::LANES],
            used,
            actions: vec![R::zero(); spec.action.size()],
            observation: vec![R::zero(); spec.observation.size()],
            outcome: Outcome::new(spec.reward_terms.len() + spec.metrics.len()),
            returned: vec![0.0; used * spec.observation.size()],
        }
    }

    /// Numbers of one environment's plant.
    pub fn numbers(&self) -> usize {
        let mut count = 0;
        self.plant.visit(&mut |_| count += 1);
        count
    }

    /// Number of environments in use.
    pub fn used(&self) -> usize {
        self.used
    }

    /// First environment of the block, if any, that cannot be stepped, and why.
    pub fn refuses_step(&self, rules: &Rules, first: usize) -> Option<Error> {
        for (lane, clock) in self.clocks[..self.used].iter().enumerate() {
            if !clock.begun {
                return Some(Error::NotReset);
            }
            if clock.ended && rules.mode == AutoresetMode::Disabled {
                return Some(Error::NeedsReset { index: first + lane });
            }
        }
        None
    }

    /// One control step of the block; `actions` and `out` are its own rows.
    pub fn step(
        &mut self,
        env: &Environment<M, R>,
        actions: &[f32],
        out: &mut StepData<'_>,
        watch: Watch<'_>,
    ) {
        if !watch.stops() {
            R::run(Step { block: self, env, actions, out, watch });
        }
    }

    #[inline(always)]
    fn step_here(
        &mut self,
        env: &Environment<M, R>,
        actions: &[f32],
        out: &mut StepData<'_>,
        watch: Watch<'_>,
    ) {
        let Environment { machine, task, spec, rules, .. } = env;
        let mut active = R::Mask::splat(false);
        for lane in 0..self.used {
            let resets = self.clocks[lane].ended && rules.mode == AutoresetMode::NextStep;
            active.set(lane, !resets);
        }
        let size = self.actions.len();
        for (j, slot) in self.actions.iter_mut().enumerate() {
            let (low, high) = (spec.action.low[j], spec.action.high[j]);
            for lane in 0..self.used {
                if active.get(lane) {
                    slot.set(lane, (actions[lane * size + j] as f64).clamp(low, high));
                }
            }
        }
        if active.any() {
            let Block { plant, streams, actions, outcome, .. } = self;
            outcome.failed = machine.step(plant, actions, active, streams, watch).not();
            if watch.stops() {
                return;
            }
            task.score(machine, plant, outcome);
        }
        let mut starting = R::Mask::splat(false);
        for lane in 0..self.used {
            if active.get(lane) {
                self.settle(lane, rules, out);
                let restarts = self.clocks[lane].ended && rules.mode == AutoresetMode::SameStep;
                starting.set(lane, restarts);
            } else {
                out.reward[lane] = 0.0;
                out.terminated[lane] = false;
                out.truncated[lane] = false;
                out.solver_failure[lane] = false;
                out.stepped[lane] = false;
                self.begin(env, lane, &M::Start::default(), out);
            }
            out.began[lane] = !active.get(lane);
        }
        self.observe(env, R::Mask::splat(true));
        self.write_rows(starting.not(), out.observation);
        if starting.any() {
            self.write_rows(starting, out.final_observation);
            for lane in 0..self.used {
                if starting.get(lane) {
                    self.begin(env, lane, &M::Start::default(), out);
                    out.began[lane] = true;
                }
            }
            self.observe(env, starting);
            self.write_rows(starting, out.observation);
        }
        self.returned.copy_from_slice(out.observation);
    }

    /// Takes the observation of all lanes; noise is drawn in `lanes` only.
    #[inline(always)]
    fn observe(&mut self, env: &Environment<M, R>, lanes: R::Mask) {
        let size = self.observation.len() - env.task.observation_size();
        let (sensors, further) = self.observation.split_at_mut(size);
        env.machine.observe(&self.plant, lanes, &mut self.streams, sensors);
        env.task.observe(&self.plant, further);
    }

    /// Counts a step that was taken and says what came of it.
    #[inline(always)]
    fn settle(&mut self, lane: usize, rules: &Rules, out: &mut StepData<'_>) {
        let clock = &mut self.clocks[lane];
        clock.steps += 1;
        clock.reward = self.outcome.reward.get(lane);
        clock.episode_return += clock.reward;
        let terminated = self.outcome.terminated.get(lane);
        let failed = self.outcome.failed.get(lane);
        let late = rules.max_episode_steps.is_some_and(|limit| clock.steps >= limit);
        clock.ended = terminated || failed || late;
        out.reward[lane] = clock.reward;
        out.terminated[lane] = terminated;
        out.truncated[lane] = failed || late;
        out.solver_failure[lane] = failed;
        out.stepped[lane] = true;
        let size = self.outcome.terms.len();
        for (j, term) in self.outcome.terms.iter().enumerate() {
            out.terms[lane * size + j] = term.get(lane);
        }
    }

    /// Starts an episode in a lane and reports its parameters.
    fn begin(
        &mut self,
        env: &Environment<M, R>,
        lane: usize,
        start: &M::Start,
        out: &mut StepData<'_>,
    ) {
        let draws = self.draws[lane].as_deref().unwrap_or(env.machine.draws());
        env.machine.begin(&mut self.plant, lane, draws, &mut self.streams[lane], start);
        self.clocks[lane] = Clock { begun: true, ..Clock::default() };
        for slot in &mut self.actions {
            slot.set(lane, 0.0);
        }
        let size = env.spec.parameters.len();
        let row = &mut out.parameters[lane * size..(lane + 1) * size];
        env.machine.parameters(&self.plant, lane, row);
    }

    /// Starts episodes where the mask is set; elsewhere the observation is the one returned last.
    pub fn reset(
        &mut self,
        env: &Environment<M, R>,
        rows: &ResetRows<'_>,
        seed: impl Fn(usize) -> Option<u64>,
        start: &M::Start,
        out: &mut StepData<'_>,
    ) {
        let mut starting = R::Mask::splat(false);
        for lane in 0..self.used {
            let chosen = rows.mask.is_none_or(|mask| mask[rows.first + lane]);
            out.began[lane] = chosen;
            out.stepped[lane] = false;
            out.reward[lane] = 0.0;
            out.terminated[lane] = false;
            out.truncated[lane] = false;
            out.solver_failure[lane] = false;
            if chosen {
                if let Some(seed) = seed(rows.first + lane) {
                    self.streams[lane] = Stream::new(seed);
                }
                self.begin(env, lane, start, out);
                starting.set(lane, true);
            }
        }
        self.observe(env, starting);
        out.observation.copy_from_slice(&self.returned);
        self.write_rows(starting, out.observation);
        self.returned.copy_from_slice(out.observation);
    }

    #[inline(always)]
    fn write_rows(&self, lanes: R::Mask, rows: &mut [f32]) {
        for lane in 0..self.used {
            if lanes.get(lane) {
                self.write_rows_of(lane, rows);
            }
        }
    }

    #[inline(always)]
    fn write_rows_of(&self, lane: usize, rows: &mut [f32]) {
        let size = self.observation.len();
        for (to, from) in rows[lane * size..(lane + 1) * size].iter_mut().zip(&self.observation) {
            *to = from.get(lane) as f32;
        }
    }

    /// How the parameters of one environment are drawn, where that is not the machine's way.
    pub fn draws(&self, lane: usize) -> Option<&Arc<[Draw]>> {
        self.draws[lane].as_ref()
    }

    /// Changes how the parameters of one environment are drawn; they are taken as checked.
    pub fn set_draws(&mut self, lane: usize, draws: Option<Arc<[Draw]>>) {
        self.draws[lane] = draws;
    }

    /// The observation that one environment returned last.
    pub fn returned(&self, lane: usize) -> &[f32] {
        let size = self.observation.len();
        &self.returned[lane * size..(lane + 1) * size]
    }

    /// Everything about one environment.
    pub fn snapshot(&self, lane: usize) -> Snapshot {
        let mut numbers = Vec::new();
        self.plant.visit(&mut |x| numbers.push(x.get(lane)));
        let clock = &self.clocks[lane];
        Snapshot {
            numbers,
            stream: self.streams[lane].clone(),
            steps: clock.steps,
            ended: clock.ended,
            begun: clock.begun,
            episode_return: clock.episode_return,
            reward: clock.reward,
            action: self.actions.iter().map(|a| a.get(lane)).collect(),
            draws: self.draws[lane].as_ref().map(|draws| draws.to_vec()),
            observation: self.returned(lane).to_vec(),
        }
    }

    /// Puts a snapshot in place of one environment.
    pub fn restore(
        &mut self,
        env: &Environment<M, R>,
        lane: usize,
        saved: &Snapshot,
    ) -> Result<()> {
        let fits = saved.numbers.len() == self.numbers()
            && saved.action.len() == self.actions.len()
            && saved.observation.len() == self.observation.len();
        if !fits {
            return Err(Error::snapshot("its lengths are not those of this environment"));
        }
        if !saved.numbers.iter().all(|x| x.is_finite()) {
            return Err(Error::snapshot("it holds a number that is not finite"));
        }
        if let Some(draws) = &saved.draws {
            Draw::check(draws, env.machine.parameter_table())?;
            env.machine.check_draws(draws)?;
        }
        self.draws[lane] = saved.draws.as_deref().map(Arc::from);
        let mut next = saved.numbers.iter();
        self.plant.visit_mut(&mut |x| x.set(lane, *next.next().expect("counted above")));
        for (slot, action) in self.actions.iter_mut().zip(&saved.action) {
            slot.set(lane, *action);
        }
        let size = self.observation.len();
        self.returned[lane * size..(lane + 1) * size].copy_from_slice(&saved.observation);
        self.streams[lane] = saved.stream.clone();
        self.clocks[lane] = Clock {
            steps: saved.steps,
            ended: saved.ended,
            begun: saved.begun,
            episode_return: saved.episode_return,
            reward: saved.reward,
        };
        Ok(())
    }

    /// What there is to draw of one environment.
    pub fn scene(&self, env: &Environment<M, R>, lane: usize) -> Scene {
        let clock = &self.clocks[lane];
        let mut scene = Scene {
            machine: env.spec.machine.into(),
            time: clock.steps as f64 * env.spec.control_dt,
            steps: clock.steps,
            nodes: vec![],
            thickness: vec![],
            curvature: vec![],
            action: self.actions.iter().map(|a| a.get(lane)).collect(),
            reward: clock.reward,
            episode_return: clock.episode_return,
            values: Default::default(),
            arrows: Default::default(),
        };
        env.machine.scene(&self.plant, lane, &mut scene);
        env.task.scene(&self.plant, lane, &mut scene);
        scene
    }

    /// The plant, to be asked about a lane.
    pub fn plant(&self) -> &M::Plant<R> {
        &self.plant
    }
}

/// A block's step as work that is compiled for each instruction set.
struct Step<'a, 'b, M: Machine, R: Real> {
    block: &'a mut Block<M, R>,
    env: &'a Environment<M, R>,
    actions: &'a [f32],
    out: &'a mut StepData<'b>,
    watch: Watch<'a>,
}

impl<M: Machine, R: Real> Kernel for Step<'_, '_, M, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.block.step_here(self.env, self.actions, self.out, self.watch);
    }
}
