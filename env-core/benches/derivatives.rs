//! What derivatives of a control step cost, beside central differences in eight lanes and beside the step alone, in one
//! run: `cargo bench -p rodgym-core --bench derivatives`.

use rodgym_core::catalog::{MakeOptions, make};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};
use rodgym_core::fin::{BareFin, Body};
use rodgym_core::isa::{ForLanes, Isa, with_lanes};
use rodgym_core::lane::{Kernel, Lanewise, Mask, Real};
use rodgym_core::pendulum::BarePendulum;
use rodgym_core::rod::{Motion, Rod, Uniform};
use rodgym_core::simulation::Simulation;
use rodgym_core::solver::{Constant, Integrator, Scheme};
use rodgym_core::watch::Watch;
use serde_json::{Map, json};
use std::hint::black_box;
use std::time::Instant;

const NODES: usize = 7;
const CONTROL: f64 = 0.01;
const TORQUE: f64 = 0.02;

/// The median time of a call \[us\]. (Each by itself: on a busy machine a long run of calls waits for others.)
fn median(mut call: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..201)
        .map(|_| {
            let began = Instant::now();
            call();
            began.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn rod() -> Rod<f64> {
    Uniform {
        nodes: NODES,
        length: 0.3,
        width: 0.007,
        density: 1500.0,
        youngs_modulus: 1e7,
        damping: 0.0,
        bending_damping: 5e-4,
        gravity: 9.81,
    }
    .rod()
}

/// Runs of a control step in lanes: two for every number of the state and for the torque.
struct Differences {
    scheme: Scheme,
    dt: f64,
    start: Motion<f64>,
    states: usize,
}

struct Runs<'a, R: Real> {
    rods: &'a Rod<R>,
    integrator: &'a mut Integrator<R>,
    motions: &'a mut [Motion<R>],
    steps: usize,
}

impl<R: Real> Kernel for Runs<'_, R> {
    type Output = bool;
    #[inline(always)]
    fn run(self) -> bool {
        let mut sound = true;
        for motion in self.motions {
            let drive = Constant(R::splat(TORQUE));
            sound &= self.integrator.advance(self.rods, motion, &drive, self.steps).all();
        }
        sound
    }
}

impl ForLanes for Differences {
    type Output = f64;
    fn make<R: Real>(self) -> f64 {
        let Differences { scheme, dt, start, states } = self;
        let mut rods = Rod::<R>::new(NODES);
        let mut wide = Motion::<R>::new(NODES);
        for lane in 0..R::LANES {
            rods.set_lane(lane, &rod());
            wide.set_lane(lane, &start);
        }
        let blocks = (2 * (states + 1)).div_ceil(R::LANES);
        let mut starts = vec![wide; blocks];
        for (i, motion) in starts.iter_mut().enumerate() {
            for lane in 0..R::LANES {
                let x = motion.x[1 + i % (NODES - 1)].x.get(lane);
                motion.x[1 + i % (NODES - 1)].x.set(lane, x + 1e-7 * lane as f64);
            }
        }
        let mut motions = starts.clone();
        let mut integrator = Integrator::new(scheme, dt, NODES);
        let steps = (CONTROL / dt).round() as usize;
        median(|| {
            for (motion, start) in motions.iter_mut().zip(&starts) {
                motion.copy_from(start);
            }
            let (rods, integrator, motions) = (&rods, &mut integrator, &mut motions[..]);
            assert!(R::run(Runs { rods, integrator, motions, steps }));
        })
    }
}

/// Runs of a control step of a fin in lanes.
struct FinDifferences<'a> {
    fin: &'a Body<f64>,
    pitches: &'a [f64],
    states: usize,
}

struct FinRuns<'a, R: Real> {
    bodies: &'a mut [Body<R>],
    pitches: &'a [f64],
}

impl<R: Real> Kernel for FinRuns<'_, R> {
    type Output = bool;
    #[inline(always)]
    fn run(self) -> bool {
        let mut sound = true;
        for body in self.bodies {
            for pitch in self.pitches {
                sound &= body.step(R::splat(*pitch)).all();
            }
        }
        sound
    }
}

impl ForLanes for FinDifferences<'_> {
    type Output = f64;
    fn make<R: Real>(self) -> f64 {
        let FinDifferences { fin, pitches, states } = self;
        let mut wide = Body::<R>::new(fin.design.as_ref().clone()).expect("it is one");
        for lane in 0..R::LANES {
            wide.set_lane(lane, fin);
            let tail = wide.now.x.len() - 1;
            let y = wide.now.x[tail].y.get(lane);
            wide.now.x[tail].y.set(lane, y + 1e-7 * lane as f64);
        }
        let starts = vec![wide; (2 * (states + 1)).div_ceil(R::LANES)];
        let mut bodies = starts.clone();
        median(|| {
            for (body, start) in bodies.iter_mut().zip(&starts) {
                body.copy_from(start);
            }
            assert!(R::run(FinRuns { bodies: &mut bodies, pitches }));
        })
    }
}

/// The same for a fin that beats; the way back too.
fn fins(isa: Isa) {
    println!("\nus a control step of 40 ms of the default fin, pitched by hand");
    println!(
        "| water | stepper | step | plain | Jacobian | with 10 parameters | differences in lanes | share | way back | over plain |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (water, stepper, dt) in [
        ("lighthill", "bdf2", 4e-3),
        ("lighthill", "backward_euler", 1e-3),
        ("morison", "bdf2", 2e-3),
    ] {
        let given = json!({"hydrodynamics": water, "stepper": stepper, "physics_dt": dt});
        let mut sim = BareFin::from_keywords(given.as_object().expect("one")).expect("allowed");
        for step in 0..40 {
            sim.step(0.2 * (f64::from(step) * dt * 9.0).sin(), 1).expect("it steps");
        }
        let steps = (0.04 / dt).round() as usize;
        let pitch = sim.pitch();
        let start = sim.clone();
        let mut plain_sim = sim.clone();
        let plain = median(|| {
            plain_sim.clone_from(&start);
            plain_sim.step(pitch, steps as u64).expect("it steps");
        });
        let names: Vec<String> = sim.parameters().iter().map(|(name, _)| (*name).into()).collect();
        let n = steps as u64;
        let jacobian = |names: &[String]| {
            median(|| {
                black_box(sim.jacobian(pitch, n, names, Watch::nobody()).expect("it steps"));
            })
        };
        let (own, all) = (jacobian(&[]), jacobian(&names));
        let gradient = vec![1.0; sim.vector().expect("it has one").len()];
        let back = median(|| {
            black_box(sim.pull_back(pitch, n, &[], &gradient).expect("it steps"));
        });
        let states = gradient.len();
        let pitches = vec![pitch; steps];
        let differences =
            with_lanes(isa, FinDifferences { fin: sim.body(), pitches: &pitches, states });
        println!(
            "| {water} | {stepper} | {:.1} ms | {plain:.1} | {own:.1} | {all:.1} | {differences:.1} | {:.2} | {back:.1} | {:.1} |",
            dt * 1e3,
            own / differences,
            back / plain
        );
    }
}

/// All gradients of an episode by its actions.
fn episodes() {
    println!("\nms for the gradients of an episode's sum of rewards by all its actions");
    println!("| environment | actions | plain steps | gradients | over plain |");
    println!("|---|---|---|---|---|");
    for (id, steps) in [
        ("rodgym/PendulumSwingUp-v0", 500),
        ("rodgym/FinThrust-v0", 200),
        ("rodgym/FinEfficiency-v0", 200),
        ("rodgym/FinSwim-v0", 250),
    ] {
        let options = MakeOptions {
            id: id.into(),
            num_envs: 1,
            kwargs: Map::new(),
            autoreset_mode: AutoresetMode::Disabled,
            max_episode_steps: None,
            num_threads: 1,
        };
        let mut env = make(&options).expect("it is one");
        let mut buffer = StepBuffer::new(env.spec(), 1);
        let reset = |env: &mut Box<dyn VectorEnv>, buffer: &mut StepBuffer| {
            let options = ResetOptions::default();
            env.reset(&Seeds::Base(1), None, &options, buffer.data()).expect("it begins");
        };
        let actions: Vec<f32> = (0..steps).map(|t| (0.3 * t as f32).sin()).collect();
        let mut plain = f64::INFINITY;
        for _ in 0..7 {
            reset(&mut env, &mut buffer);
            let began = Instant::now();
            for action in &actions {
                env.step(&[*action], buffer.data()).expect("it steps");
            }
            plain = plain.min(began.elapsed().as_secs_f64() * 1e3);
        }
        reset(&mut env, &mut buffer);
        let mut own = f64::INFINITY;
        for _ in 0..7 {
            let began = Instant::now();
            black_box(env.rollout_gradient(0, &actions, &[]).expect("it steps"));
            own = own.min(began.elapsed().as_secs_f64() * 1e3);
        }
        println!("| {id} | {steps} | {plain:.2} | {own:.2} | {:.1} |", own / plain);
    }
}

fn main() {
    let isa = Isa::current().expect("it is one of this machine");
    println!("us a control step of 10 ms, {NODES} nodes, {}", isa.name());
    println!(
        "| scheme | step | plain | Jacobian | with 7 parameters | differences in lanes | share | way back | over plain |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (scheme, dt) in [
        (Scheme::Verlet, 2e-4),
        (Scheme::Verlet, 5e-4),
        (Scheme::BackwardEuler, 1e-3),
        (Scheme::Implicit, 1e-3),
        (Scheme::Bdf2, 1e-3),
        (Scheme::TrBdf2, 1e-3),
        (Scheme::Esdirk3, 1e-3),
    ] {
        let given = json!({"stepper": scheme.name(), "physics_dt": dt, "nodes": NODES});
        let mut sim = BarePendulum::new(given.as_object().expect("one")).expect("allowed");
        sim.set_angles(&[1.0, 1.1, 1.2, 1.3, 1.3, 1.2], &[3.0, 2.0, 1.0, 0.0, -1.0, -2.0])
            .expect("six edges");
        sim.step(TORQUE, 20).expect("it steps");
        let steps = (CONTROL / dt).round() as u64;
        let mut start = Motion::new(NODES);
        let state = sim.state();
        for i in 0..NODES {
            (start.x[i].x, start.x[i].y) = (state.positions[i][0], state.positions[i][1]);
            (start.v[i].x, start.v[i].y) = (state.velocities[i][0], state.velocities[i][1]);
        }
        Integrator::<f64>::prepare(scheme, &rod(), &mut start);
        let states = sim.vector().expect("it has one").len();
        let mut integrator = Integrator::<f64>::new(scheme, dt, NODES);
        let (rod, mut motion) = (rod(), start.clone());
        let plain = median(|| {
            motion.copy_from(&start);
            assert!(integrator.advance_one(&rod, &mut motion, TORQUE, steps as usize));
        });
        let names: Vec<String> = sim.parameters().iter().map(|(name, _)| (*name).into()).collect();
        let jacobian = |names: &[String]| {
            median(|| {
                black_box(sim.jacobian(TORQUE, steps, names, Watch::nobody()).expect("it steps"));
            })
        };
        let (own, all) = (jacobian(&[]), jacobian(&names));
        let gradient = vec![1.0; states];
        let back = median(|| {
            black_box(sim.pull_back(TORQUE, steps, &[], &gradient).expect("it steps"));
        });
        let differences = with_lanes(isa, Differences { scheme, dt, start, states });
        println!(
            "| {} | {:.1} ms | {plain:.1} | {own:.1} | {all:.1} | {differences:.1} | {:.2} | {back:.1} | {:.1} |",
            scheme.name(),
            dt * 1e3,
            own / differences,
            back / plain
        );
    }
    fins(isa);
    episodes();
}
