//! A bead on a spring along x, pushed by a force: the smallest machine.

use rodgym_core::batch::Machine;
use rodgym_core::draw::{Draw, exact_parameters};
use rodgym_core::env::{NodeState, Parameter, ResetOptions, Scene, Space};
use rodgym_core::error::{Error, Result};
use rodgym_core::keywords::{Allowed, Keyword, RANDOMIZE};
use rodgym_core::lane::{Mask, Real};
use rodgym_core::lanewise;
use rodgym_core::reader::Reader;
use rodgym_core::seed::Stream;
use rodgym_core::simulation::Simulation;
use rodgym_core::watch::Watch;
use serde_json::{Map, Value};

/// Physical parameters of an episode.
const PARAMETERS: &[Parameter] = &[Parameter {
    name: "stiffness",
    unit: "N/m",
    default: 40.0,
    low: 1.0,
    high: 1000.0,
    doc: "stiffness of the spring",
}];
/// The other keywords.
const KEYWORDS: &[Keyword] = &[
    Keyword {
        name: "control_dt",
        unit: "s",
        default: "0.02",
        allowed: Allowed::Number(1e-3, 0.1),
        doc: "duration of a step",
        bare: false,
    },
    RANDOMIZE,
];
/// Physics steps of a control step.
const SUBSTEPS: u32 = 10;
/// Force at action 1 \[N\]; the bead has 1 kg.
const FORCE: f64 = 10.0;

/// The bead as its keywords have it.
#[derive(Clone, Debug)]
pub struct Bead {
    draws: Vec<Draw>,
    control_dt: f64,
    resolved: Map<String, Value>,
}

/// Beads side by side.
#[derive(Clone, Debug)]
pub struct Plant<R: Real> {
    /// Stiffness of the spring \[N/m\].
    pub stiffness: R,
    /// Position \[m\].
    pub x: R,
    /// Velocity \[m/s\].
    pub v: R,
}
lanewise!(Plant: stiffness, x, v);

impl<R: Real> Plant<R> {
    /// One physics step (symplectic Euler) under a force \[N\].
    #[inline(always)]
    fn advance(&mut self, force: R, dt: f64) {
        self.v += (force - self.stiffness * self.x) * R::splat(dt);
        self.x += self.v * R::splat(dt);
    }
}

impl Machine for Bead {
    const NAME: &'static str = "bead";
    const METRICS: &'static [&'static str] = &["x"];
    const KEYWORDS: &'static [Keyword] = KEYWORDS;
    type Setup = ();
    type Plant<R: Real> = Plant<R>;
    type Start = Vec<Option<f64>>;

    fn new(_: &(), given: &Map<String, Value>) -> Result<Self> {
        let mut reader = Reader::new(given, PARAMETERS, KEYWORDS)?;
        let values = reader.parameters(PARAMETERS, |row| row.default)?;
        let draws = reader.draws(PARAMETERS, &values, None)?;
        let control_dt = reader.number("control_dt", 0.02)?;
        Ok(Bead { draws, control_dt, resolved: reader.resolved() })
    }

    fn observation(&self) -> Space {
        let mut space = Space::new();
        space.push(-10.0, 10.0, "x / m");
        space.push(-100.0, 100.0, "v / (m/s)");
        space
    }

    fn action(&self) -> Space {
        let mut space = Space::new();
        space.push(-1.0, 1.0, "force / 10 N");
        space
    }

    fn parameter_table(&self) -> &[Parameter] {
        PARAMETERS
    }

    fn resolved(&self) -> &Map<String, Value> {
        &self.resolved
    }

    fn control_dt(&self) -> f64 {
        self.control_dt
    }

    fn physics_dt(&self) -> f64 {
        self.control_dt / f64::from(SUBSTEPS)
    }

    fn new_plant<R: Real>(&self) -> Plant<R> {
        Plant { stiffness: R::splat(self.draws[0].bounds().0), x: R::zero(), v: R::zero() }
    }

    fn draws(&self) -> &[Draw] {
        &self.draws
    }

    fn check(&self, options: &ResetOptions, _: &[Draw]) -> Result<Self::Start> {
        if let Some(state) = &options.state {
            return Err(Error::parameter("state", state, "left out: a bead starts by itself"));
        }
        exact_parameters(&options.parameters, PARAMETERS)
    }

    fn begin<R: Real>(
        &self,
        plant: &mut Plant<R>,
        lane: usize,
        draws: &[Draw],
        stream: &mut Stream,
        start: &Self::Start,
    ) {
        let [drawn] = Draw::all(draws, stream);
        plant.stiffness.set(lane, start.first().copied().flatten().unwrap_or(drawn));
        plant.x.set(lane, stream.uniform(-1.0, 1.0));
        plant.v.set(lane, 0.0);
    }

    #[inline(always)]
    fn step<R: Real>(
        &self,
        plant: &mut Plant<R>,
        actions: &[R],
        _: R::Mask,
        _: &mut [Stream],
        _: Watch<'_>,
    ) -> R::Mask {
        let force = actions[0] * R::splat(FORCE);
        for _ in 0..SUBSTEPS {
            plant.advance(force, self.physics_dt());
        }
        R::Mask::splat(true)
    }

    #[inline(always)]
    fn metrics<R: Real>(&self, plant: &Plant<R>, metrics: &mut [R]) {
        metrics[0] = plant.x;
    }

    #[inline(always)]
    fn observe<R: Real>(&self, plant: &Plant<R>, _: R::Mask, _: &mut [Stream], seen: &mut [R]) {
        seen[0] = plant.x.clip(-10.0, 10.0);
        seen[1] = plant.v.clip(-100.0, 100.0);
    }

    fn parameters<R: Real>(&self, plant: &Plant<R>, lane: usize, out: &mut [f64]) {
        out[0] = plant.stiffness.get(lane);
    }

    fn scene<R: Real>(&self, plant: &Plant<R>, lane: usize, scene: &mut Scene) {
        scene.nodes = self.nodes(plant, lane).positions;
        scene.thickness = vec![0.02; 2];
        scene.curvature = vec![0.0; 2];
    }

    fn nodes<R: Real>(&self, plant: &Plant<R>, lane: usize) -> NodeState {
        // The wall is two metres away from where the spring is at ease.
        NodeState {
            positions: vec![[-2.0, 0.0], [plant.x.get(lane), 0.0]],
            velocities: vec![[0.0, 0.0], [plant.v.get(lane), 0.0]],
        }
    }

    fn bare(given: &Map<String, Value>) -> Result<Box<dyn Simulation>> {
        let bead = Bead::new(&(), given)?;
        Ok(bead.simulation(&bead.new_plant::<f64>(), 0))
    }

    fn simulation<R: Real>(&self, plant: &Plant<R>, lane: usize) -> Box<dyn Simulation> {
        let one = |x: R| x.get(lane);
        let plant = Plant { stiffness: one(plant.stiffness), x: one(plant.x), v: one(plant.v) };
        Box::new(BareBead { bead: self.clone(), plant, steps: 0 })
    }
}

/// One bead by itself.
#[derive(Clone, Debug)]
struct BareBead {
    bead: Bead,
    plant: Plant<f64>,
    steps: u64,
}

impl Simulation for BareBead {
    fn machine(&self) -> &'static str {
        Bead::NAME
    }

    fn resolved(&self) -> Map<String, Value> {
        self.bead.resolved.clone()
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("stiffness", self.plant.stiffness)]
    }

    fn time(&self) -> f64 {
        self.steps as f64 * self.physics_dt()
    }

    fn physics_dt(&self) -> f64 {
        Machine::physics_dt(&self.bead)
    }

    fn state(&self) -> NodeState {
        self.bead.nodes(&self.plant, 0)
    }

    fn set_state(&mut self, positions: &[[f64; 2]], velocities: &[[f64; 2]]) -> Result<()> {
        let ([[-2.0, 0.0], [x, 0.0]], [_, [v, _]]) = (positions, velocities) else {
            let allowed = "[[-2, 0], [x, 0]]";
            return Err(Error::parameter("positions", format!("{positions:?}"), allowed));
        };
        (self.plant.x, self.plant.v, self.steps) = (*x, *v, 0);
        Ok(())
    }

    fn step(&mut self, force: f64, n: u64) -> Result<()> {
        let dt = self.physics_dt();
        (0..n).for_each(|_| self.plant.advance(force, dt));
        self.steps += n;
        Ok(())
    }

    fn energies(&self) -> Vec<(&'static str, f64)> {
        let Plant { stiffness, x, v } = self.plant;
        vec![("kinetic", 0.5 * v * v), ("spring", 0.5 * stiffness * x * x)]
    }

    fn snapshot(&self) -> (Vec<f64>, u64) {
        (vec![self.plant.stiffness, self.plant.x, self.plant.v], self.steps)
    }

    fn restore(&mut self, numbers: &[f64], steps: u64) -> Result<()> {
        let &[stiffness, x, v] = numbers else {
            return Err(Error::snapshot("a bead has three numbers"));
        };
        (self.plant, self.steps) = (Plant { stiffness, x, v }, steps);
        Ok(())
    }

    fn copy(&self) -> Box<dyn Simulation> {
        Box::new(self.clone())
    }
}
