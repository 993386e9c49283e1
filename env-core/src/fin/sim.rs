//! A single fin for people who want the physics: no task, and a servo only where it is asked for.

use super::body::Body;
use super::config::{Config, KEYWORDS, Setup};
use super::derivative::check_pitch;
use super::design::Design;
use super::geometry::Geometry;
use super::motion::Loads;
use super::parameters::Parameters;
use super::plant::Plant;
use super::servo::{Servo, Ticks};
use crate::error::{Error, Result};
use crate::fluid::Hydrodynamics;
use crate::fluid::terms::ByKind;
use crate::given::check_keywords;
use crate::keywords::bare_names;
use crate::lane::{Lanewise, Real};
use crate::rod;
use crate::scene::NodeState;
use crate::simulation::{Named, Simulation, pairs, unknown};
use crate::snapshot::Numbers;
use crate::solver::Scheme;
use crate::vec2::Vec2;
use crate::watch::Watch;
use serde_json::{Map, Value, json};

/// Forces and energies of a fin in a given motion, each apart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forces {
    /// `-dE/dx` \[N\].
    pub elastic: Vec<[f64; 2]>,
    /// Momentum p_f of the water that moves with each node \[kg m/s\].
    pub fluid_momentum: Vec<[f64; 2]>,
    /// `dT_f/dq` \[N\].
    pub fluid_gradient: Vec<[f64; 2]>,
    /// Momentum flux G off the last node \[N\].
    pub tail_flux: Vec<[f64; 2]>,
    /// Drag and friction \[N\].
    pub resistive: Vec<[f64; 2]>,
    /// Stretching and bending energy \[J\].
    pub elastic_energy: f64,
    /// Kinetic energy T_f of the moved water, relative to the flow \[J\].
    pub fluid_energy: f64,
}

/// Energies of a fin \[J\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// Kinetic energy of the fin (and of its hull, if it has one).
    pub kinetic: f64,
    /// Stretching.
    pub stretch: f64,
    /// Bending.
    pub bend: f64,
    /// Water, relative to the flow.
    pub fluid: f64,
}

/// One fin, pitched by hand or by its servo.
#[derive(Clone, Debug)]
pub struct BareFin {
    pub(super) body: Body<f64>,
    pub(super) servo: Servo<f64>,
    ticks: Ticks,
    pub(super) steps: u64,
    resolved: Map<String, Value>,
}

/// Keyword of the bare fin alone: in the environments the task says it.
const FREE_SWIMMING: &str = "free_swimming";

/// Names of the keywords that it takes: those of the environments that concern the fin and its water.
fn names() -> Vec<&'static str> {
    let mut names = bare_names(&Parameters::table(), KEYWORDS);
    names.push(FREE_SWIMMING);
    names
}

impl BareFin {
    /// A straight fin at rest, without a low-pass before its servo.
    ///
    /// # Errors
    /// A design or parameter outside its range.
    pub fn new(design: Design, parameters: Parameters) -> Result<Self> {
        parameters.check()?;
        let mut body = Body::new(design)?;
        body.begin(0, &parameters, 0.0);
        let ticks = Ticks::new(body.design.physics_dt, None, 1.0);
        let servo = Servo::default();
        Ok(BareFin { body, servo, ticks, steps: 0, resolved: Map::new() })
    }

    /// The thesis' fin in the given water, stepped by BDF2 every `physics_dt` seconds.
    ///
    /// # Errors
    /// Those of `new`.
    pub fn of(
        hydrodynamics: Hydrodynamics,
        physics_dt: f64,
        parameters: Parameters,
    ) -> Result<Self> {
        let geometry = Geometry::thesis();
        let scheme = Scheme::Bdf2;
        let free_swimming = false;
        let design = Design { geometry, hydrodynamics, scheme, physics_dt, free_swimming };
        BareFin::new(design, parameters)
    }

    /// A fin of the keywords that users type: those of the environments that concern the fin and its water, and
    /// `free_swimming`, which frees its pivot along x. Values that are not given are those of the environments.
    ///
    /// # Errors
    /// Unknown keywords and values outside their ranges.
    pub fn from_keywords(given: &Map<String, Value>) -> Result<Self> {
        check_keywords(given, &names())?;
        let mut given = given.clone();
        let swims = given.remove(FREE_SWIMMING).filter(|value| !value.is_null());
        let refuse = |value: &Value| Error::parameter(FREE_SWIMMING, value, "true or false");
        let swims =
            swims.map_or(Ok(false), |value| value.as_bool().ok_or_else(|| refuse(&value)))?;
        let setup = Setup { free_swimming: swims, stiffness: None };
        // A control step of one physics step: the simulation has no other.
        let asked = given.get("physics_dt").filter(|value| !value.is_null());
        let control_dt = asked.cloned().unwrap_or(json!(0.04));
        given.insert("control_dt".into(), control_dt);
        let config = Config::new(&setup, &given)?;
        let mut parameters = Parameters::default();
        for (i, draw) in config.draws.iter().enumerate() {
            parameters.set(i, draw.bounds().0)?;
        }
        let mut fin = BareFin::new(config.design.clone(), parameters)?;
        fin.ticks = config.ticks;
        fin.resolved = resolved(&config);
        Ok(fin)
    }

    /// What runs in one lane of an environment, exactly: what the stepper remembers, servo and low-pass included.
    pub fn copy_of<R: Real>(config: &Config, plant: &Plant<R>, lane: usize) -> Self {
        let parameters = plant.body.parameters.lane(lane);
        let mut resolved = resolved(config);
        for (i, row) in Parameters::table().iter().enumerate() {
            resolved.insert(row.name.into(), json!(parameters.get(i)));
        }
        BareFin {
            body: plant.body.lane(lane),
            servo: plant.servo.lane(lane),
            ticks: config.ticks,
            steps: 0,
            resolved,
        }
    }

    /// Shape, water and stepping.
    pub fn design(&self) -> &Design {
        &self.body.design
    }

    /// The fin in its water, without its servo.
    pub fn body(&self) -> &Body<f64> {
        &self.body
    }

    /// Material and water.
    pub fn material(&self) -> &Parameters {
        &self.body.parameters
    }

    /// `n` physics steps under the servo of the environments, told this pitch \[rad\]. After `step` or `set_state`
    /// it starts at rest at the pitch that the fin has.
    ///
    /// # Errors
    /// Those of `step`.
    pub fn drive(&mut self, command: f64, n: u64) -> Result<()> {
        if !command.is_finite() {
            return Err(Error::parameter("command", command, "finite"));
        }
        for _ in 0..n {
            let mut servo = self.servo;
            servo.advance(command, &self.ticks);
            self.advance(servo.angle)?;
            self.servo = servo;
        }
        Ok(())
    }

    /// One physics step that ends at this pitch.
    fn advance(&mut self, pitch: f64) -> Result<()> {
        if !self.body.step(pitch) {
            return Err(self.failed(pitch));
        }
        self.steps += 1;
        Ok(())
    }

    /// The next step fails in its smallest parts.
    pub(super) fn failed(&self, pitch: f64) -> Error {
        let reason = format!("no solution for a step to pitch {pitch} rad");
        Error::Solver { time: self.time(), reason }
    }

    /// Lets Newton's method go on until its moves are below this share of what ends it for others: steps become a smooth
    /// function of their state, to the last digits, which small differences of them need.
    pub fn sharpen(&mut self, share: f64) {
        self.body.work.sharpness = share;
    }

    /// Physics steps that end at the given pitches \[rad\]; returns thrust \[N\], torque \[N m\], power \[W\] and
    /// y of the tail \[m\] after each.
    ///
    /// # Errors
    /// Those of `step`.
    pub fn follow(&mut self, pitches: &[f64]) -> Result<Vec<[f64; 4]>> {
        let mut trace = Vec::with_capacity(pitches.len());
        for &pitch in pitches {
            self.step(pitch, 1)?;
            let (loads, x) = (&self.body.loads, &self.body.now.x);
            trace.push([loads.thrust, loads.torque, loads.power, x[x.len() - 1].y]);
        }
        Ok(trace)
    }

    /// Node positions \[m\].
    pub fn positions(&self) -> Vec<[f64; 2]> {
        points(&self.body.now.x)
    }

    /// Node velocities \[m/s\].
    pub fn velocities(&self) -> Vec<[f64; 2]> {
        points(&self.body.now.v)
    }

    /// Pitch of the driven edge \[rad\].
    pub fn pitch(&self) -> f64 {
        self.body.pitch
    }

    /// Forces and power of the last physics step.
    pub fn loads(&self) -> &Loads<f64> {
        &self.body.loads
    }

    /// Forces and energies in any motion; the fin itself is not touched.
    ///
    /// # Errors
    /// Wrong shapes or numbers that are not finite.
    pub fn forces(&self, positions: &[[f64; 2]], velocities: &[[f64; 2]]) -> Result<Forces> {
        let (x, v) = self.body.design.check_nodes(positions, velocities)?;
        let body = &self.body;
        let still = vec![Vec2::zero(); x.len()];
        let mut elastic = still.clone();
        // Without velocity the damping vanishes, and a fin has no gravity.
        rod::forces(&body.rod, &x, &still, &mut elastic);
        let mut water = ByKind::new(x.len());
        body.elements().gather_water(&x, &v, &mut water);
        let energy = rod::energy(&body.rod, &x, &v);
        Ok(Forces {
            elastic: points(&elastic),
            fluid_momentum: points(&water.momentum),
            fluid_gradient: points(&water.gradient),
            tail_flux: points(&water.tail_flux),
            resistive: points(&water.resistance),
            elastic_energy: energy.stretch + energy.bend,
            fluid_energy: water.energy,
        })
    }

    /// Energies now.
    pub fn energy(&self) -> Energies {
        let body = &self.body;
        let (x, v) = (&body.now.x, &body.now.v);
        let energy = rod::energy(&body.rod, x, v);
        let mut water = ByKind::new(x.len());
        body.elements().gather_water(x, v, &mut water);
        let mut kinetic = energy.kinetic;
        if body.design.free_swimming {
            let speed = v[body.design.geometry.pivot].x;
            kinetic += 0.5 * body.hull_mass * speed * speed;
        }
        Energies { kinetic, stretch: energy.stretch, bend: energy.bend, fluid: water.energy }
    }
}

impl Simulation for BareFin {
    fn machine(&self) -> &'static str {
        "fin"
    }

    fn resolved(&self) -> Map<String, Value> {
        self.resolved.clone()
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        let table = Parameters::table();
        table.iter().enumerate().map(|(i, row)| (row.name, self.body.parameters.get(i))).collect()
    }

    fn time(&self) -> f64 {
        self.steps as f64 * self.body.design.physics_dt
    }

    fn physics_dt(&self) -> f64 {
        self.body.design.physics_dt
    }

    fn state(&self) -> NodeState {
        NodeState { positions: self.positions(), velocities: self.velocities() }
    }

    /// As if the fin had just been placed there. The pivot must be at the origin (unless swimming freely) and the
    /// driven edge within 1e-6 of its rest length.
    fn set_state(&mut self, positions: &[[f64; 2]], velocities: &[[f64; 2]]) -> Result<()> {
        let (x, v, pitch) = self.body.design.check_motion(positions, velocities)?;
        self.body.set_motion(0, &x, &v, pitch);
        self.servo.place(0, pitch, 0.0, pitch);
        self.steps = 0;
        Ok(())
    }

    /// Each step ends at the input, a pitch \[rad\].
    fn step(&mut self, pitch: f64, n: u64) -> Result<()> {
        check_pitch(pitch)?;
        for _ in 0..n {
            self.advance(pitch)?;
            self.servo.place(0, pitch, 0.0, pitch);
        }
        Ok(())
    }

    fn vector(&self) -> Result<Vec<f64>> {
        Ok(self.state_vector())
    }

    /// The driven node must be near where the servo's angle has it: within a tenth of its edge.
    fn set_vector(&mut self, vector: &[f64]) -> Result<()> {
        self.set_state_vector(vector)
    }

    /// The input is a pitch \[rad\], at which each step ends.
    fn jacobian(
        &self,
        pitch: f64,
        n: u64,
        parameters: &[String],
        watch: Watch<'_>,
    ) -> Result<Vec<Named>> {
        BareFin::jacobian(self, pitch, n, parameters, watch)
    }

    fn energies(&self) -> Vec<(&'static str, f64)> {
        let Energies { kinetic, stretch, bend, fluid } = self.energy();
        vec![("kinetic", kinetic), ("stretch", stretch), ("bend", bend), ("fluid", fluid)]
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
            ("loads", []) => {
                let loads = self.loads();
                [
                    ("pitch", self.pitch()),
                    ("thrust", loads.thrust),
                    ("shed_thrust", loads.shed_thrust),
                    ("resistive_thrust", loads.resistive_thrust),
                    ("mount_thrust", loads.mount_thrust),
                    ("torque", loads.torque),
                    ("power", loads.power),
                ]
                .map(|(name, value)| Named::number(name, value))
                .into()
            }
            ("forces", [x, v]) => {
                let forces = self.forces(&pairs("positions", x)?, &pairs("velocities", v)?)?;
                vec![
                    Named::nodes("elastic", &forces.elastic),
                    Named::nodes("fluid_momentum", &forces.fluid_momentum),
                    Named::nodes("fluid_gradient", &forces.fluid_gradient),
                    Named::nodes("tail_flux", &forces.tail_flux),
                    Named::nodes("resistive", &forces.resistive),
                    Named::number("elastic_energy", forces.elastic_energy),
                    Named::number("fluid_energy", forces.fluid_energy),
                ]
            }
            _ => return Err(unknown(self.machine(), question)),
        })
    }

    fn act(&mut self, command: &str, arguments: &[Vec<f64>], n: u64) -> Result<Vec<Named>> {
        match (command, arguments) {
            ("drive", [pitch]) if pitch.len() == 1 => {
                self.drive(pitch[0], n)?;
                Ok(vec![])
            }
            ("follow", [pitches]) => {
                let trace = self.follow(pitches)?;
                let column = |k: usize| trace.iter().map(|row| row[k]).collect();
                let names = ["thrust", "torque", "power", "tail"].into_iter().enumerate();
                Ok(names.map(|(k, name)| Named::vector(name, column(k))).collect())
            }
            _ => Err(unknown(self.machine(), command)),
        }
    }
}

impl Numbers for BareFin {
    /// The fin's, its servo's and the low-pass'.
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64)) {
        self.body.visit_mut(f);
        self.servo.visit_mut(f);
    }
}

/// What a configuration says of the bare fin.
fn resolved(config: &Config) -> Map<String, Value> {
    let mut map = config.resolved.clone();
    map.insert(FREE_SWIMMING.into(), json!(config.design.free_swimming));
    map.retain(|name, _| names().contains(&name.as_str()));
    map
}

fn points(vectors: &[Vec2<f64>]) -> Vec<[f64; 2]> {
    vectors.iter().map(|p| [p.x, p.y]).collect()
}
