//! The bare pendulum, one at a time: no motor limit, no control step.

use super::Linear;
use super::config::{Config, KEYWORDS, PARAMETERS, Setup, at, uniform};
use super::plant::Plant;
use crate::error::{Error, Result};
use crate::given::check_keywords;
use crate::keywords::bare_names;
use crate::lane::{Lanewise, Real};
use crate::reader::Reader;
use crate::rod::{Energy, Motion, Rod, energy};
use crate::scene::NodeState;
use crate::simulation::{Named, Simulation, unknown};
use crate::snapshot::Numbers;
use crate::solver::{Constant, Drive, Feedback, Integrator, Scheme};
use crate::vec2::Vec2;
use crate::watch::Watch;
use serde_json::{Map, Value, json};

/// Names of the keywords that it takes: those of the environments that concern the rod.
fn names() -> Vec<&'static str> {
    bare_names(&PARAMETERS[..at::TORQUE_LIMIT], KEYWORDS)
}

/// Refuses a torque that is not finite.
pub(super) fn check_torque(torque: f64) -> Result<()> {
    if torque.is_finite() {
        return Ok(());
    }
    Err(Error::parameter("torque", torque, "a finite number, in N m"))
}

/// A pendulum in free motion or under a base torque.
#[derive(Clone, Debug)]
pub struct BarePendulum {
    pub(super) config: Config,
    pub(super) values: Vec<f64>,
    pub(super) rod: Rod<f64>,
    pub(super) motion: Motion<f64>,
    pub(super) integrator: Integrator<f64>,
    pub(super) steps: u64,
}

impl BarePendulum {
    /// A pendulum that hangs at rest; keywords are the rod's parameters, `nodes`, `stepper`, `physics_dt`, `thesis`.
    ///
    /// # Errors
    /// As for the environments.
    pub fn new(given: &Map<String, Value>) -> Result<Self> {
        check_keywords(given, &names())?;
        let mut given = given.clone();
        // A control step of one physics step: the simulation has no other.
        if let Some(dt) = Reader::new(&given, PARAMETERS, KEYWORDS)?.asked("physics_dt")? {
            given.insert("control_dt".into(), json!(dt.max(1e-5)));
        }
        let config = Config::new(&Setup::default(), &given)?;
        let values: Vec<f64> = config.draws.iter().map(|draw| draw.bounds().0).collect();
        let rod = uniform(config.nodes, &values).rod();
        let mut sim = BarePendulum::at_rest(config, values, rod);
        let edges = sim.rod.nodes() - 1;
        sim.set_angles(&vec![0.0; edges], &vec![0.0; edges])?;
        Ok(sim)
    }

    /// What runs in one lane of an environment, exactly.
    pub fn copy_of<R: Real>(config: &Config, plant: &Plant<R>, lane: usize) -> Self {
        let values: Vec<f64> = plant.parameters.iter().map(|value| value.get(lane)).collect();
        let mut config = config.clone();
        for (row, value) in PARAMETERS.iter().zip(&values) {
            config.resolved.insert(row.name.into(), json!(value));
        }
        let rod = Rod::new(config.nodes);
        let mut sim = BarePendulum::at_rest(config, values, rod);
        plant.rod.read_lane(lane, &mut sim.rod);
        plant.motion.read_lane(lane, &mut sim.motion);
        plant.integrator.read_lane(lane, &mut sim.integrator);
        sim
    }

    fn at_rest(config: Config, values: Vec<f64>, rod: Rod<f64>) -> Self {
        let integrator = Integrator::new(config.scheme, config.physics_dt, config.nodes);
        let motion = Motion::new(config.nodes);
        BarePendulum { config, values, rod, motion, integrator, steps: 0 }
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.rod.nodes()
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
        self.integrator.forget(0, &self.motion);
        self.steps = 0;
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
        if self.config.scheme == Scheme::Verlet {
            let allowed =
                "'backward_euler' or 'implicit' for step_feedback, which solves for the torque";
            return Err(Error::parameter("stepper", "verlet", allowed));
        }
        self.advance(&Feedback { constant, gain: gain.to_vec() }, n)
    }

    fn advance<D: Drive<f64>>(&mut self, drive: &D, n: u64) -> Result<()> {
        for _ in 0..n {
            if !self.integrator.advance(&self.rod, &mut self.motion, drive, 1) {
                return Err(self.failed(self.steps));
            }
            self.steps += 1;
        }
        Ok(())
    }

    /// The step after so many fails in its smallest parts.
    pub(super) fn failed(&self, steps: u64) -> Error {
        let reason = "the step did not converge in its smallest parts".into();
        Error::Solver { time: steps as f64 * self.config.physics_dt, reason }
    }

    /// See `Integrator::sharpen`.
    pub fn sharpen(&mut self, share: f64) {
        self.integrator.sharpen(share);
    }

    /// Angles of the edges from hanging, counter-clockwise, in (-pi, pi] \[rad\] (thesis 4.2, corrected).
    pub fn angles(&self) -> Vec<f64> {
        self.edges().map(|(e, _)| libm::atan2(e.x, -e.y)).collect()
    }

    /// Rates of the edges' angles \[rad/s\].
    pub fn rates(&self) -> Vec<f64> {
        self.edges().map(|(e, de)| e.cross(de) / e.dot(e)).collect()
    }

    pub(super) fn edges(&self) -> impl Iterator<Item = (Vec2<f64>, Vec2<f64>)> {
        let Motion { x, v, .. } = &self.motion;
        (1..x.len()).map(|i| (x[i] - x[i - 1], v[i] - v[i - 1]))
    }

    /// Energies \[J\].
    pub fn energy(&self) -> Energy<f64> {
        energy(&self.rod, &self.motion.x, &self.motion.v)
    }
}

impl Simulation for BarePendulum {
    fn machine(&self) -> &'static str {
        "pendulum"
    }

    fn resolved(&self) -> Map<String, Value> {
        let mut map = self.config.resolved.clone();
        map.retain(|name, _| names().contains(&name.as_str()));
        map
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        let rod = PARAMETERS[..at::TORQUE_LIMIT].iter().map(|row| row.name);
        rod.zip(self.values.iter().copied()).collect()
    }

    fn time(&self) -> f64 {
        self.steps as f64 * self.config.physics_dt
    }

    fn physics_dt(&self) -> f64 {
        self.config.physics_dt
    }

    fn state(&self) -> NodeState {
        let pick = |v: &[Vec2<f64>]| v.iter().map(|p| [p.x, p.y]).collect();
        NodeState { positions: pick(&self.motion.x), velocities: pick(&self.motion.v) }
    }

    /// The first node must be at rest at the origin, and neighbours must not coincide.
    fn set_state(&mut self, positions: &[[f64; 2]], velocities: &[[f64; 2]]) -> Result<()> {
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

    /// The input is the base torque \[N m\].
    fn step(&mut self, torque: f64, n: u64) -> Result<()> {
        check_torque(torque)?;
        self.advance(&Constant(torque), n)
    }

    fn vector(&self) -> Result<Vec<f64>> {
        Ok(self.state_vector())
    }

    fn set_vector(&mut self, vector: &[f64]) -> Result<()> {
        self.set_state_vector(vector)
    }

    fn jacobian(
        &self,
        torque: f64,
        n: u64,
        parameters: &[String],
        watch: Watch<'_>,
    ) -> Result<Vec<Named>> {
        BarePendulum::jacobian(self, torque, n, parameters, watch)
    }

    fn energies(&self) -> Vec<(&'static str, f64)> {
        let Energy { kinetic, stretch, bend, gravity } = self.energy();
        vec![("kinetic", kinetic), ("stretch", stretch), ("bend", bend), ("gravity", gravity)]
    }

    fn snapshot(&self) -> (Vec<f64>, u64) {
        (self.numbers(), self.steps)
    }

    fn restore(&mut self, numbers: &[f64], steps: u64) -> Result<()> {
        self.set_numbers(numbers)?;
        self.steps = steps;
        Ok(())
    }

    fn copy(&self) -> Box<dyn Simulation> {
        Box::new(self.clone())
    }

    fn ask(&self, question: &str, arguments: &[Vec<f64>]) -> Result<Vec<Named>> {
        Ok(match (question, arguments) {
            ("angles", []) => vec![Named::vector("angles", self.angles())],
            ("rates", []) => vec![Named::vector("rates", self.rates())],
            ("linearize", [torque]) if torque.len() == 1 => {
                let Linear { states, a, b, c, .. } = self.linearize(torque[0]);
                vec![
                    Named::matrix("A", states, a),
                    Named::matrix("B", 1, b),
                    Named::matrix("C", states, c),
                ]
            }
            _ => return Err(unknown(self.machine(), question)),
        })
    }

    fn act(&mut self, command: &str, arguments: &[Vec<f64>], n: u64) -> Result<Vec<Named>> {
        match (command, arguments) {
            ("set_angles", [angles, rates]) => self.set_angles(angles, rates)?,
            ("step_feedback", [constant, gain]) if constant.len() == 1 => {
                self.step_feedback(constant[0], gain, n)?;
            }
            _ => return Err(unknown(self.machine(), command)),
        }
        Ok(vec![])
    }
}

impl Numbers for BarePendulum {
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64)) {
        self.motion.visit_mut(f);
        self.integrator.visit_mut(f);
    }
}
