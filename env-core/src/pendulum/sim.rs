//! The bare pendulum, one at a time, for people who want the physics: no motor limit, no control step.

use super::config::{Config, PARAMETERS, Sensors, Task, at, uniform};
use crate::env::{NodeState, ResetOptions};
use crate::error::{Error, Result};
use crate::keywords::{Keywords, check_names};
use crate::linear::Banded;
use crate::rod::{Energy, Motion, Rod, add_stiffness, energy};
use crate::snapshot::Numbers;
use crate::stepper::{Constant, Drive, Feedback, Integrator};
use crate::vec2::Vec2;
use serde_json::{Map, Value, json};

/// Keywords of the bare pendulum beside the rod's parameters.
const OTHERS: &[&str] = &["nodes", "stepper", "physics_dt", "thesis"];

/// A pendulum in free motion or under a base torque.
#[derive(Clone, Debug)]
pub struct Simulation {
    config: Config,
    values: Vec<f64>,
    rod: Rod<f64>,
    motion: Motion<f64>,
    integrator: Integrator<f64>,
    steps: u64,
}

/// Matrices of the motion near a state, row-major: `dz/dt = A (z - z0) + B T`, `y = C (z - z0)`.
///
/// z = displacements of the nodes after the pinned one (x, y a node) \[m\], then their velocities \[m/s\]: 4(N-1)
/// states. y = the angle of every edge \[rad\], then its rate \[rad/s\].
#[derive(Clone, Debug, PartialEq)]
pub struct Linear {
    /// Number of states.
    pub states: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// (states, states).
    pub a: Vec<f64>,
    /// (states, 1).
    pub b: Vec<f64>,
    /// (outputs, states).
    pub c: Vec<f64>,
}

impl Simulation {
    /// A pendulum that hangs at rest; keywords are the rod's parameters, `nodes`, `stepper`, `physics_dt`, `thesis`.
    ///
    /// # Errors
    /// As for the environments.
    pub fn new(given: &Map<String, Value>) -> Result<Self> {
        let rod = PARAMETERS.iter().map(|p| p.name).filter(|name| *name != "torque_limit");
        check_names(given, &rod.chain(OTHERS.iter().copied()).collect::<Vec<_>>())?;
        let mut given = given.clone();
        let asked = Keywords::new(&given, &given.keys().map(String::as_str).collect::<Vec<_>>())?
            .optional("physics_dt", 1e-7, 1.0)?;
        if let Some(dt) = asked {
            given.insert("control_dt".into(), json!(dt.max(1e-5)));
        }
        let config = Config::new(Task::SwingUp, Sensors::Full, &given)?;
        let values: Vec<f64> = config.draws.iter().map(|draw| draw.bounds().0).collect();
        let rod = uniform(config.nodes, &values).rod();
        let integrator = Integrator::new(config.scheme, config.physics_dt, config.nodes);
        let motion = Motion::new(config.nodes);
        let mut sim = Simulation { config, values, rod, motion, integrator, steps: 0 };
        let edges = sim.rod.nodes() - 1;
        sim.set_angles(&vec![0.0; edges], &vec![0.0; edges])?;
        Ok(sim)
    }

    /// Keywords as resolved, without those of the environments.
    pub fn resolved(&self) -> Map<String, Value> {
        let mut map = self.config.resolved.clone();
        map.retain(|name, _| {
            name != "torque_limit"
                && (OTHERS.contains(&name.as_str()) || PARAMETERS.iter().any(|p| p.name == name))
        });
        map
    }

    /// Sets positions \[m\] and velocities \[m/s\] of all nodes; the time goes back to 0.
    ///
    /// # Errors
    /// Wrong lengths, numbers that are not finite, coinciding neighbours, a first node that is not at
    /// rest at the origin.
    pub fn set_state(&mut self, positions: &[[f64; 2]], velocities: &[[f64; 2]]) -> Result<()> {
        let nodes = self.rod.nodes();
        for (name, list) in [("positions", positions), ("velocities", velocities)] {
            if list.len() != nodes {
                let got = format!("({}, 2)", list.len());
                let expected = format!("({nodes}, 2)");
                return Err(Error::Shape { name: name.into(), got, expected });
            }
            if let Some(bad) = list.iter().flatten().find(|x| !x.is_finite()) {
                return Err(Error::parameter(name, bad, "finite numbers"));
            }
            if list[0] != [0.0, 0.0] {
                let allowed = "(0, 0) for the first node, which is pinned";
                return Err(Error::parameter(name, format!("{:?}", list[0]), allowed));
            }
        }
        if let Some(pair) = positions.windows(2).find(|pair| pair[0] == pair[1]) {
            let allowed = "distinct for neighbouring nodes";
            return Err(Error::parameter("positions", format!("{:?}", pair[0]), allowed));
        }
        for i in 0..nodes {
            self.motion.x[i] = Vec2::new(positions[i][0], positions[i][1]);
            self.motion.v[i] = Vec2::new(velocities[i][0], velocities[i][1]);
        }
        self.restart();
        Ok(())
    }

    /// Sets angles from hanging \[rad\] and rates \[rad/s\] of all edges, at their rest lengths; the time
    /// goes back to 0.
    ///
    /// # Errors
    /// Wrong lengths or numbers that are not finite.
    pub fn set_angles(&mut self, angles: &[f64], rates: &[f64]) -> Result<()> {
        let edges = self.rod.nodes() - 1;
        for (name, list) in [("angles", angles), ("rates", rates)] {
            if list.len() != edges {
                let (got, expected) = (format!("({},)", list.len()), format!("({edges},)"));
                return Err(Error::Shape { name: name.into(), got, expected });
            }
            if let Some(bad) = list.iter().find(|x| !x.is_finite()) {
                return Err(Error::parameter(name, bad, "finite numbers"));
            }
        }
        for k in 0..edges {
            let (sin, cos) = libm::sincos(angles[k]);
            let rest = self.rod.rest[k];
            self.motion.x[k + 1] = self.motion.x[k] + Vec2::new(sin, -cos).scale(rest);
            self.motion.v[k + 1] = self.motion.v[k] + Vec2::new(cos, sin).scale(rest * rates[k]);
        }
        self.restart();
        Ok(())
    }

    fn restart(&mut self) {
        Integrator::<f64>::prepare(self.config.scheme, &self.rod, &mut self.motion);
        self.steps = 0;
    }

    /// Takes `n` physics steps under a constant base torque \[N m\]; the same bits as n steps of one.
    ///
    /// # Errors
    /// A torque that is not finite; a step that fails in the smallest parts (the state is then the one before it).
    pub fn step(&mut self, torque: f64, n: u64) -> Result<()> {
        if !torque.is_finite() {
            return Err(Error::parameter("torque", torque, "a finite number, in N m"));
        }
        self.advance(&Constant(torque), n)
    }

    /// Takes `n` physics steps under the torque `constant + gain . (theta - pi, rate)` of the state at the end of
    /// each step, solved within the implicit step: the controller of the thesis, to the letter.
    ///
    /// # Errors
    /// A gain of the wrong length, the explicit stepper, a step that fails in the smallest parts.
    pub fn step_feedback(&mut self, constant: f64, gain: &[f64], n: u64) -> Result<()> {
        let wanted = 2 * (self.rod.nodes() - 1);
        if gain.len() != wanted {
            let (got, expected) = (format!("({},)", gain.len()), format!("({wanted},)"));
            return Err(Error::Shape { name: "gain".into(), got, expected });
        }
        if let Some(bad) = gain.iter().chain([&constant]).find(|x| !x.is_finite()) {
            return Err(Error::parameter("gain", bad, "finite numbers"));
        }
        if self.config.scheme == crate::stepper::Scheme::Verlet {
            let allowed =
                "'backward_euler' or 'implicit' for step_feedback, which solves for the torque";
            return Err(Error::parameter("stepper", "verlet", allowed));
        }
        self.advance(&Feedback { constant, gain: gain.to_vec() }, n)
    }

    fn advance<D: Drive<f64>>(&mut self, drive: &D, n: u64) -> Result<()> {
        for _ in 0..n {
            if !self.integrator.advance(&self.rod, &mut self.motion, drive, 1) {
                let reason = "the step did not converge in its smallest parts".into();
                return Err(Error::Solver { time: self.time(), reason });
            }
            self.steps += 1;
        }
        Ok(())
    }

    /// Simulated time since the state was set \[s\].
    pub fn time(&self) -> f64 {
        self.steps as f64 * self.config.physics_dt
    }

    /// Physics step \[s\].
    pub fn physics_dt(&self) -> f64 {
        self.config.physics_dt
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.rod.nodes()
    }

    /// The rod's parameters, in the order of the environments' table.
    pub fn parameters(&self) -> &[f64] {
        &self.values[..at::TORQUE_LIMIT]
    }

    /// Positions and velocities.
    pub fn state(&self) -> NodeState {
        let pick = |v: &[Vec2<f64>]| v.iter().map(|p| [p.x, p.y]).collect();
        NodeState { positions: pick(&self.motion.x), velocities: pick(&self.motion.v) }
    }

    /// Angles of the edges from hanging, counter-clockwise, in (-pi, pi] \[rad\] (thesis 4.2, corrected).
    pub fn angles(&self) -> Vec<f64> {
        self.edges().map(|(e, _)| libm::atan2(e.x, -e.y)).collect()
    }

    /// Rates of the edges' angles \[rad/s\].
    pub fn rates(&self) -> Vec<f64> {
        self.edges().map(|(e, de)| e.cross(de) / e.dot(e)).collect()
    }

    fn edges(&self) -> impl Iterator<Item = (Vec2<f64>, Vec2<f64>)> {
        let Motion { x, v, .. } = &self.motion;
        (1..x.len()).map(|i| (x[i] - x[i - 1], v[i] - v[i - 1]))
    }

    /// Energies by kind \[J\].
    pub fn energy(&self) -> Energy<f64> {
        energy(&self.rod, &self.motion.x, &self.motion.v)
    }

    /// Every number that the future depends on, and the steps since the state was set; `restore` takes them.
    pub fn snapshot(&self) -> (Vec<f64>, u64) {
        (self.numbers(), self.steps)
    }

    /// Goes on where a simulation of the same keywords was at its `snapshot`.
    ///
    /// # Errors
    /// Not as many numbers as this rod has; nothing changes then.
    pub fn restore(&mut self, numbers: &[f64], steps: u64) -> Result<()> {
        self.set_numbers(numbers)?;
        self.steps = steps;
        Ok(())
    }

    /// The linear motion near the present state, for a base torque near `torque` \[N m\]. Poles and the like mean
    /// something where the state is an equilibrium; upright, every edge is a little shorter than at
    /// rest, by the weight above it, and without that gravity would not turn the rod over.
    pub fn linearize(&self, torque: f64) -> Linear {
        let nodes = self.rod.nodes();
        let n = 2 * (nodes - 1);
        let Motion { x, v, .. } = &self.motion;
        let stiffness = |rate: f64| {
            let mut matrix = Banded::new(nodes - 1);
            add_stiffness(&self.rod, x, v, torque, rate, 1, &mut matrix);
            matrix
        };
        let (k, kd) = (stiffness(0.0), stiffness(1.0));
        let states = 2 * n;
        let mut a = vec![0.0; states * states];
        let mut b = vec![0.0; states];
        let mut c = vec![0.0; n * states];
        for i in 0..n {
            a[i * states + n + i] = 1.0;
            let inverse = self.rod.inverse_mass[i / 2 + 1];
            for j in 0..n {
                a[(n + i) * states + j] = -inverse * k.get(i, j);
                a[(n + i) * states + n + j] = -inverse * (kd.get(i, j) - k.get(i, j));
            }
        }
        for (edge, (e, de)) in self.edges().enumerate() {
            let length2 = e.dot(e);
            let slope = e.perp().scale(1.0 / length2);
            let turn = (-de.perp() - e.scale(2.0 * e.cross(de) / length2)).scale(1.0 / length2);
            if edge == 0 {
                b[n] = self.rod.inverse_mass[1] * slope.x;
                b[n + 1] = self.rod.inverse_mass[1] * slope.y;
            }
            // The edge's end is node edge + 1, at column 2 edge; its start is one node before.
            for (column, sign) in [(2 * edge, 1.0), ((2 * edge).wrapping_sub(2), -1.0)] {
                if column >= n {
                    continue;
                }
                let rates = edge + nodes - 1;
                for (offset, (s, t)) in [(slope.x, turn.x), (slope.y, turn.y)].iter().enumerate() {
                    c[edge * states + column + offset] = sign * s;
                    c[rates * states + column + offset] = sign * t;
                    c[rates * states + n + column + offset] = sign * s;
                }
            }
        }
        Linear { states, outputs: n, a, b, c }
    }
}

impl Numbers for Simulation {
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64)) {
        self.motion.visit(f);
    }
}

/// Exact starts are read alike for environments and simulations.
impl From<NodeState> for ResetOptions {
    fn from(state: NodeState) -> Self {
        let value = json!({"positions": state.positions, "velocities": state.velocities});
        ResetOptions { state: Some(value), ..ResetOptions::default() }
    }
}
