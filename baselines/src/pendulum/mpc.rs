//! Predictive control: at every step a plan for the next second or two is bettered, and its first action taken.

use super::belief::Belief;
use super::filter::{Filter, Learning, Pace};
use super::foresight::{Foresight, Plan, foresight};
use super::lqg::{measured, needs_base};
use super::lqr::{needs_every_edge, state_of};
use super::regulator::{lever, pace};
use super::rods::{ORDER, STATE, State};
use super::{Arrival, Chain, Noise, Regulator, RodDesign, gentle_weights};
use crate::controller::Controller;
use crate::error::Result;
use crate::ilqr::Policy;
use crate::registry::Target;
use std::f64::consts::PI;

/// How far ahead a plan looks \[s\]; control steps of it at least and at most.
const AHEAD: f64 = 1.5;
const STEPS: (usize, usize) = (20, 200);
/// Iterations of the first plan of an episode, and of every other.
const FIRST: usize = 12;
const ITERATIONS: usize = 1;
/// Most torque of a plan, in units of m g L / 2: of harder pushes a soft rod bends as the reduced chain does not. (At 5 mm
/// plans of 2 units lose one rod in twelve.)
const MOST: f64 = 1.6;

/// Swing-up and balance by plans on the reduced chain (receding horizon), the motor's limits kept.
///
/// A plan earns what the task of the swing-up pays, and is made by iterated linear-quadratic regulators. It begins with
/// what is better: the last plan, a step later, or what `lqr` would do. Observation: every edge, as for [`Lqr`](super::Lqr),
/// or the base edge alone, as for [`Lqg`](super::Lqg), whose filter then says what the state is. State: steps taken, the
/// regulator's clock \[s\], actions on their way, the filter's belief, the plan: actions, states, feedback.
pub struct Mpc {
    regulator: Regulator,
    foresight: Box<dyn Foresight>,
    filter: Filter<f64>,
    arrival: Arrival,
    /// Most torque of a plan, as a part of the motor's.
    share: f64,
    steps: usize,
    sees_all: bool,
}

/// An environment's row of `state`.
struct Row<'a> {
    taken: &'a mut f64,
    clock: &'a mut f64,
    actions: &'a mut [f64],
    belief: &'a mut [f64],
    plan: &'a mut [f64],
}

/// Numbers of a step of a plan: action, state, feedback.
const WIDTH: usize = 1 + 2 * STATE;

impl Mpc {
    /// Designs it for an environment, which shows every edge or the base edge.
    ///
    /// # Errors
    /// A rod that is not allowed; a Riccati equation without solution; another observation.
    pub fn for_target(target: &Target) -> Result<Self> {
        let rod = RodDesign::from_config(&target.config)?;
        let shown = target.observation.size();
        let sees_all = shown != 3;
        if sees_all {
            needs_every_edge("Mpc", &rod, shown)?;
        } else {
            needs_base("Mpc", shown)?;
        }
        let arrival = Arrival::from_config(&target.config, rod.control_dt)?;
        let noise = Noise::default().with_sensors(&target.config);
        let share = (MOST * lever(&rod) * pace(&rod) / rod.torque_limit).min(1.0);
        Ok(Mpc {
            regulator: Regulator::new(Chain::new(&rod, ORDER), gentle_weights(&rod))?,
            foresight: foresight(&RodDesign {
                torque_limit: share * rod.torque_limit,
                ..rod.clone()
            })?,
            share,
            steps: ((AHEAD / rod.control_dt) as usize).clamp(STEPS.0, STEPS.1),
            filter: {
                let pace = Pace::of(std::slice::from_ref(&rod), &arrival);
                Filter::new(&[rod], noise, pace, Learning::default())
            },
            arrival,
            sees_all,
        })
    }

    fn limit(&self) -> f64 {
        self.regulator.chain().rod().torque_limit
    }

    fn row<'a>(&self, state: &'a mut [f64]) -> Row<'a> {
        let (law, rest) = state.split_at_mut(2);
        let [taken, clock] = law else { unreachable!("split at two") };
        let (actions, rest) = rest.split_at_mut(self.arrival.memory());
        let (belief, plan) = rest.split_at_mut(self.beliefs());
        Row { taken, clock, actions, belief, plan }
    }

    fn beliefs(&self) -> usize {
        if self.sees_all { 0 } else { Belief::<f64>::SIZE }
    }

    /// The state when an action that is taken now begins to act.
    fn look(&self, observation: &[f32], row: &mut Row<'_>) -> State<f64> {
        let limit = self.limit();
        let mut belief;
        if self.sees_all {
            let x = state_of(self.regulator.chain(), observation);
            let k = self.regulator.chain().coordinates();
            belief = self.filter.start(0.0, 0.0);
            belief.mean = [0.0; STATE];
            belief.mean[..k].copy_from_slice(&x[..k]);
            belief.mean[ORDER..ORDER + k].copy_from_slice(&x[k..2 * k]);
        } else {
            belief = Belief::read(row.belief);
            if *row.taken > 0.0 {
                let torques = self.arrival.acting(row.actions).map(|action| action * limit);
                self.filter.predict(torques, &mut belief);
            }
            let seen = measured(observation);
            if let Some((angle, rate)) = seen {
                self.filter.update(angle, rate, &mut belief);
            }
            if !self.filter.sound(&belief) {
                // As in `lqg`: it begins anew from what is seen.
                let (angle, rate) = seen.unwrap_or((0.0, 0.0));
                belief = self.filter.start(angle, rate);
            }
            belief.write(row.belief);
        }
        self.filter.forecast(&belief, &self.arrival, row.actions, limit)
    }

    /// What `lqr` would do from here on.
    fn regulated(&self, x: &State<f64>, clock: f64) -> Plan {
        let mut clock = clock;
        self.foresight.play(x, self.steps, &mut |_, x| self.regulate(x, &mut clock))
    }

    fn regulate(&self, x: &State<f64>, clock: &mut f64) -> f64 {
        let k = self.regulator.chain().coordinates();
        let mut state = [0.0; STATE];
        state[..k].copy_from_slice(&x[..k]);
        state[k..2 * k].copy_from_slice(&x[ORDER..ORDER + k]);
        self.regulator.torque(&state[..2 * k], clock) / (self.share * self.limit())
    }

    /// The last plan, a step later; the rod may have been counted a whole turn on.
    fn shifted(&self, x: &State<f64>, plan: &[f64]) -> Plan {
        let of = |t: usize| {
            let row = &plan[t.min(self.steps - 1) * WIDTH..][..WIDTH];
            (row[0], &row[1..1 + STATE], &row[1 + STATE..])
        };
        let base = |x: &[f64]| (0..ORDER).map(|j| self.filter.rods().base()[j] * x[j]).sum::<f64>();
        let turns = libm::round((base(of(1).1) - base(x)) / (2.0 * PI));
        let turn = self.filter.rods().straight(2.0 * PI * turns);
        let mut start = *x;
        start.iter_mut().zip(turn).for_each(|(x, turn)| *x += turn);
        self.foresight.play(&start, self.steps, &mut |t, x| {
            let (action, state, feedback) = of(t + 1);
            let off = x.iter().zip(state).map(|(x, was)| x - was);
            action + feedback.iter().zip(off).map(|(gain, off)| gain * off).sum::<f64>()
        })
    }
}

impl Controller for Mpc {
    fn observation_size(&self) -> usize {
        if self.sees_all { 3 * self.regulator.chain().edges() } else { 3 }
    }
    fn state_size(&self) -> usize {
        2 + self.arrival.memory() + self.beliefs() + WIDTH * self.steps
    }
    fn takes_lost_samples(&self) -> bool {
        !self.sees_all
    }
    fn start(&self, observation: &[f32], state: &mut [f64]) {
        state.fill(0.0);
        let row = self.row(state);
        *row.clock = self.regulator.start();
        if !self.sees_all {
            let (angle, rate) = measured(observation).unwrap_or((0.0, 0.0));
            self.filter.start(angle, rate).write(row.belief);
        }
    }
    fn act(&self, observation: &[f32], state: &mut [f64], action: &mut [f32]) {
        let mut row = self.row(state);
        let x = self.look(observation, &mut row);
        let mut plan = self.regulated(&x, *row.clock);
        // (The regulator's clock goes on whether it is followed or not.)
        self.regulate(&x, row.clock);
        let mut iterations = FIRST;
        if *row.taken > 0.0 {
            let last = self.shifted(&x, row.plan);
            if last.loss <= plan.loss {
                plan = last;
            }
            iterations = ITERATIONS;
        }
        let mut policy = Policy::default();
        for _ in 0..iterations {
            if !self.foresight.improve(&mut plan, &mut policy) {
                break;
            }
        }
        for (t, row) in row.plan.chunks_exact_mut(WIDTH).enumerate() {
            row[0] = plan.actions[t];
            row[1..1 + STATE].copy_from_slice(&plan.states[t]);
            row[1 + STATE..].copy_from_slice(&policy.feedback[t * STATE..(t + 1) * STATE]);
        }
        *row.taken += 1.0;
        action[0] = (self.share * plan.actions[0]) as f32;
        self.arrival.push(f64::from(action[0]), row.actions);
    }
}
