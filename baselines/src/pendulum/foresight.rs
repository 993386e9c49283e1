//! Plans of a rod's next second or two on the reduced chain: what they lose, how to better them.
//!
//! Eight motions go side by side in lanes: parts of a change of plan, or moments of one plan whose linear models are
//! made. What a plan loses is what the task of the swing-up counts (`rodgym_core`), and what is left after its end.

use super::filter::{Filter, Learning, Pace, fastest};
use super::rods::{Feel, ORDER, STATE, State, round, sin_cos};
use super::{Arrival, Chain, Noise, RodDesign};
use crate::error::Result;
use crate::ilqr::{Model, Policy, sweep};
use crate::linalg::dare;
use nalgebra::DMatrix;
use rodgym_core::isa::{ForLanes, Isa, with_lanes};
use rodgym_core::lane::{Kernel, Real};
use std::f64::consts::PI;

/// Weights of the reward: of the square of the rates over 20 rad/s, and of the action.
const RATE: f64 = 0.05 / 400.0;
const EFFORT: f64 = 0.02;
/// Longest step of the Runge-Kutta method, in units of 1/(highest frequency), and in any case \[s\]: a soft rod is flung
/// faster than it vibrates.
const RUNGE_KUTTA_STEP: f64 = 1.5;
const LONGEST_STEP: f64 = 2.5e-3;
/// Parts of a change of plan that are tried side by side.
const PARTS: [f64; 8] = [1.0, 0.6, 0.35, 0.2, 0.1, 0.04, 0.01, 0.0];

/// Actions, the states between them (one more), and what they lose.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    pub actions: Vec<f64>,
    pub states: Vec<State<f64>>,
    pub loss: f64,
}

/// Looks ahead for one rod, whatever the number type of the lanes.
pub trait Foresight: Send + Sync {
    /// Plays a law of step and state from a state on.
    fn play(&self, start: &State<f64>, steps: usize, law: Law<'_>) -> Plan;
    /// One iteration: a better plan from the same start, or false; `policy` has the feedback about the plan in any case.
    fn improve(&self, plan: &mut Plan, policy: &mut Policy) -> bool;
}

/// An action from a step's number and the state.
pub type Law<'a> = &'a mut dyn FnMut(usize, &State<f64>) -> f64;

/// Makes it for a rod.
///
/// # Errors
/// A Riccati equation without solution; an instruction set that `RODGYM_ISA` names and this machine has not.
pub fn foresight(rod: &RodDesign) -> Result<Box<dyn Foresight>> {
    with_lanes(Isa::current()?, Make { rod })
}

struct Make<'a> {
    rod: &'a RodDesign,
}

impl ForLanes for Make<'_> {
    type Output = Result<Box<dyn Foresight>>;
    fn make<R: Real>(self) -> Self::Output {
        let Make { rod } = self;
        let rods = std::slice::from_ref(rod);
        let pace = Pace::of(rods, &Arrival::default());
        let chain = Chain::new(rod, ORDER);
        let longest = LONGEST_STEP.min(RUNGE_KUTTA_STEP / fastest(rod));
        let mut ahead = Ahead::<R> {
            one: Filter::new(rods, Noise::default(), pace, Learning::default()),
            filter: Filter::new(rods, Noise::default(), pace, Learning::default()),
            shape: chain.shape(),
            limit: rod.torque_limit,
            dt: rod.control_dt,
            steps: libm::ceil(rod.control_dt / longest - 1e-9) as usize,
            up: [0.0; STATE],
            last: [[0.0; STATE]; STATE],
        };
        let k = chain.coordinates();
        ahead.up[..k].copy_from_slice(&chain.straight(PI));
        ahead.last = ahead.to_come(k)?;
        Ok(Box::new(ahead))
    }
}

struct Ahead<R> {
    /// The model, alone and in lanes.
    one: Filter<f64>,
    filter: Filter<R>,
    /// S, (n, k).
    shape: DMatrix<f64>,
    limit: f64,
    dt: f64,
    /// Runge-Kutta steps of a control period.
    steps: usize,
    /// The straight rod at pi.
    up: State<f64>,
    /// What is still to be lost after the end, a form of the distance from up: that of the regulator with the weights of the
    /// reward.
    last: [State<f64>; STATE],
}

impl<R: Real> Ahead<R> {
    /// The cost-to-go about up.
    fn to_come(&self, k: usize) -> Result<[State<f64>; STATE]> {
        let mut models = vec![Model::default()];
        let plan = Plan { actions: vec![0.0], states: vec![self.up; 2], loss: 0.0 };
        self.model(&plan, &mut models);
        let Model { a, b, qq, rr, .. } = &models[0];
        // (Coordinates that a rod of few edges does not use are left out.)
        let used: Vec<usize> = (0..k).chain(ORDER..ORDER + k).collect();
        let pick = |m: &[f64]| DMatrix::from_fn(2 * k, 2 * k, |i, j| m[used[i] * STATE + used[j]]);
        let b = DMatrix::from_fn(2 * k, 1, |i, _| b[used[i]]);
        let r = DMatrix::from_element(1, 1, *rr);
        let solution = dare(&pick(a), &b, &pick(qq), &r, None)?;
        let mut cost = [[0.0; STATE]; STATE];
        for (i, &to) in used.iter().enumerate() {
            for (j, &from) in used.iter().enumerate() {
                cost[to][from] = solution.cost[(i, j)];
            }
        }
        Ok(cost)
    }

    /// Distance from the nearest way up.
    fn off_up(&self, x: &State<f64>) -> State<f64> {
        let base: f64 = (0..ORDER).map(|j| self.one.rods().base()[j] * x[j]).sum();
        let turns = libm::round((base - PI) / (2.0 * PI));
        std::array::from_fn(|i| x[i] - (1.0 + 2.0 * turns) * self.up[i])
    }

    /// Models of all steps of a plan: the loss of a step is that of the state after it.
    fn model(&self, plan: &Plan, models: &mut Vec<Model>) {
        models.resize_with(plan.actions.len(), Model::default);
        R::run(Linearize { ahead: self, plan, models });
        let (n, k) = (self.shape.nrows(), self.shape.ncols());
        let height = 0.5 / n as f64;
        let rate = 2.0 * RATE / n as f64;
        let (mut q, mut qq) = ([0.0; STATE], [[0.0; STATE]; STATE]);
        let steps = plan.actions.len();
        for (t, model) in models.iter_mut().enumerate() {
            let x = &plan.states[t + 1];
            q.fill(0.0);
            qq.as_flattened_mut().fill(0.0);
            for i in 0..n {
                let angle: f64 = (0..k).map(|j| self.shape[(i, j)] * x[j]).sum();
                let slope = -height * sin_cos(angle).0;
                for j in 0..k {
                    q[j] += slope * self.shape[(i, j)];
                }
            }
            // (Columns of S are orthonormal. With t the unit tangent, the height lost is height |t - up|^2 / 2.)
            for j in 0..ORDER {
                q[ORDER + j] = rate * x[ORDER + j];
                qq[j][j] = height;
                qq[ORDER + j][ORDER + j] = rate;
            }
            if t + 1 == steps && steps > 1 {
                let z = self.off_up(x);
                for i in 0..STATE {
                    for j in 0..STATE {
                        q[i] += self.last[i][j] * z[j];
                        qq[i][j] += self.last[i][j];
                    }
                }
            }
            model.after(&q, &qq, plan.actions[t]);
        }
    }
}

impl Model {
    /// Takes in the loss of the state after the step, and that of the action.
    fn after(&mut self, q: &State<f64>, qq: &[State<f64>; STATE], action: f64) {
        let Model { a, b, .. } = self;
        let mut weighted = [[0.0; STATE]; STATE];
        let mut weighted_b = [0.0; STATE];
        for i in 0..STATE {
            for k in 0..STATE {
                if qq[i][k] != 0.0 {
                    for j in 0..STATE {
                        weighted[i][j] += qq[i][k] * a[k * STATE + j];
                    }
                    weighted_b[i] += qq[i][k] * b[k];
                }
            }
        }
        let (mut by_z, mut by_zz, mut mixed) =
            (vec![0.0; STATE], vec![0.0; STATE * STATE], vec![0.0; STATE]);
        let (mut r, mut rr) = (2.0 * EFFORT * action, 2.0 * EFFORT);
        for k in 0..STATE {
            for i in 0..STATE {
                let factor = a[k * STATE + i];
                by_z[i] += factor * q[k];
                mixed[i] += factor * weighted_b[k];
                for j in 0..STATE {
                    by_zz[i * STATE + j] += factor * weighted[k][j];
                }
            }
            r += b[k] * q[k];
            rr += b[k] * weighted_b[k];
        }
        (self.q, self.r, self.qq, self.s, self.rr) = (by_z, r, by_zz, mixed, rr);
    }
}

impl<R: Real> Foresight for Ahead<R> {
    fn play(&self, start: &State<f64>, steps: usize, law: Law<'_>) -> Plan {
        let mut plan = Plan { actions: vec![], states: vec![*start], loss: 0.0 };
        let mut x = *start;
        for t in 0..steps {
            let action = law(t, &x).clamp(-1.0, 1.0);
            step(&self.one, &mut x, action * self.limit, self.dt, self.steps);
            plan.loss += lost(&self.shape, &x, action);
            plan.actions.push(action);
            plan.states.push(x);
        }
        let z = self.off_up(&x);
        for i in 0..STATE {
            plan.loss += 0.5 * z[i] * (0..STATE).map(|j| self.last[i][j] * z[j]).sum::<f64>();
        }
        plan
    }

    fn improve(&self, plan: &mut Plan, policy: &mut Policy) -> bool {
        let mut models = Vec::new();
        self.model(plan, &mut models);
        sweep(&models, &plan.actions, 0.0, policy);
        match R::run(Follow { ahead: self, plan, policy }) {
            Some(better) => {
                *plan = better;
                true
            }
            None => false,
        }
    }
}

/// A control period under a torque.
#[inline(always)]
fn step<R: Real>(filter: &Filter<R>, x: &mut State<R>, torque: R, dt: f64, steps: usize) {
    let feel = Feel::one();
    for _ in 0..steps {
        filter.rods().step(x, torque, &feel, dt / steps as f64);
    }
}

/// What the task holds back for a state and an action.
#[inline(always)]
fn lost<R: Real>(shape: &DMatrix<f64>, x: &State<R>, action: R) -> R {
    let (n, k) = (shape.nrows(), shape.ncols());
    let (mut height, mut rates) = (R::zero(), R::zero());
    for i in 0..n {
        let (mut angle, mut rate) = (R::zero(), R::zero());
        for j in 0..k {
            angle += R::splat(shape[(i, j)]) * x[j];
            rate += R::splat(shape[(i, j)]) * x[ORDER + j];
        }
        height += R::one() + sin_cos(angle).1;
        rates += rate * rate;
    }
    let share = R::splat(1.0 / n as f64);
    let rates = (R::splat(RATE) * share * rates).min(R::splat(400.0 * RATE));
    R::splat(0.5) * share * height + rates + R::splat(EFFORT) * action * action
}

/// Models of eight steps at a time.
struct Linearize<'a, R> {
    ahead: &'a Ahead<R>,
    plan: &'a Plan,
    models: &'a mut [Model],
}

impl<R: Real> Kernel for Linearize<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Linearize { ahead, plan, models } = self;
        let Ahead { filter, limit, dt, .. } = ahead;
        let count = models.len();
        for first in (0..count).step_by(R::LANES) {
            let mut x = [R::zero(); STATE];
            let mut torque = R::zero();
            for lane in 0..R::LANES {
                let t = (first + lane).min(count - 1);
                for i in 0..STATE {
                    // Half-way through the step.
                    x[i].set(lane, 0.5 * (plan.states[t][i] + plan.states[t + 1][i]));
                }
                torque.set(lane, plan.actions[t] * limit);
            }
            let slope = filter.rods().slope(&x, torque, &Feel::one());
            let (middle, phi) = filter.transition(&slope);
            let pushed = filter.rods().acceleration(&x, R::splat(*limit), &Feel::one());
            let free = filter.rods().acceleration(&x, R::zero(), &Feel::one());
            let mut b = [R::zero(); STATE];
            for i in 0..STATE {
                // Simpson's rule over the period.
                for j in 0..ORDER {
                    let push = pushed[j] - free[j];
                    b[i] += (R::splat(4.0) * middle[i][ORDER + j] + phi[i][ORDER + j]) * push;
                }
                if i >= ORDER {
                    b[i] += pushed[i - ORDER] - free[i - ORDER];
                }
                b[i] *= R::splat(dt / 6.0);
            }
            for lane in 0..R::LANES.min(count - first) {
                let model = &mut models[first + lane];
                model.a.resize(STATE * STATE, 0.0);
                model.b.resize(STATE, 0.0);
                for i in 0..STATE {
                    for j in 0..STATE {
                        model.a[i * STATE + j] = phi[i][j].get(lane);
                    }
                    model.b[i] = b[i].get(lane);
                }
            }
        }
    }
}

/// Parts of a change of plan side by side; the best of them, if it is better than the plan.
struct Follow<'a, R> {
    ahead: &'a Ahead<R>,
    plan: &'a Plan,
    policy: &'a Policy,
}

impl<R: Real> Kernel for Follow<'_, R> {
    type Output = Option<Plan>;
    #[inline(always)]
    fn run(self) -> Option<Plan> {
        let Follow { ahead, plan, policy } = self;
        let Ahead { filter, shape, limit, dt, steps, up, last, .. } = ahead;
        let count = plan.actions.len();
        let part = R::from_fn(|lane| PARTS[lane % PARTS.len()]);
        let mut x = [R::zero(); STATE];
        for i in 0..STATE {
            x[i] = R::splat(plan.states[0][i]);
        }
        let mut loss = R::zero();
        let (mut actions, mut states) = (Vec::with_capacity(count), Vec::with_capacity(count + 1));
        states.push(x);
        for t in 0..count {
            let gains = &policy.feedback[t * STATE..(t + 1) * STATE];
            let mut action = R::splat(plan.actions[t]) + part * R::splat(policy.change[t]);
            for i in 0..STATE {
                action += R::splat(gains[i]) * (x[i] - R::splat(plan.states[t][i]));
            }
            let action = action.clip(-1.0, 1.0);
            step(filter, &mut x, action * R::splat(*limit), *dt, *steps);
            loss += lost(shape, &x, action);
            actions.push(action);
            states.push(x);
        }
        let mut base = R::zero();
        for j in 0..ORDER {
            base += R::splat(filter.rods().base()[j]) * x[j];
        }
        let turns = round((base - R::splat(PI)) * R::splat(0.5 / PI));
        let turned = R::one() + turns + turns;
        for i in 0..STATE {
            x[i] -= turned * R::splat(up[i]);
        }
        for i in 0..STATE {
            for j in 0..STATE {
                loss += R::splat(0.5 * last[i][j]) * x[i] * x[j];
            }
        }
        let mut best = None;
        let mut least = plan.loss;
        for lane in 0..R::LANES.min(PARTS.len()) {
            if loss.get(lane) < least {
                (best, least) = (Some(lane), loss.get(lane));
            }
        }
        let lane = best?;
        Some(Plan {
            actions: actions.iter().map(|action: &R| action.get(lane)).collect(),
            states: states
                .iter()
                .map(|state: &State<R>| std::array::from_fn(|i| state[i].get(lane)))
                .collect(),
            loss: least,
        })
    }
}
