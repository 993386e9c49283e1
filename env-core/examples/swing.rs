//! Free swings from the horizontal, for `tests/long/accuracy.py`: reads rods and steppers, writes where the tip is after
//! 1 s, which share of the swing's energy is gone after 10 s, and what a second of motion costs.
//!
//! `swing limits` writes Verlet's longest step instead, for lines `youngs_modulus width length nodes bending_damping`;
//! `swing choices` writes the default scheme, its steps a second and its estimated error.
//!
//! Lines of input: `youngs_modulus width length nodes bending_damping scheme steps_a_second energy`, with `energy`
//! 1 where ten seconds are wanted. Lines of output: the same, then `x y lost cost`, where `lost` is NaN where it was not
//! wanted or the rod was given up, and `cost` is in CPU seconds a rod. Neighbouring lines of the same nodes, scheme and
//! step run side by side in lanes.

use rodgym_core::isa::{ForLanes, Isa, with_lanes};
use rodgym_core::lane::{Kernel, Lanewise, Mask, Real};
use rodgym_core::pendulum::accuracy::choose;
use rodgym_core::rod::{Motion, Rod, Uniform, energy};
use rodgym_core::solver::{Constant, Integrator, Scheme};
use rodgym_core::vec2::Vec2;
use std::io::{BufRead, Write, stdin, stdout};
use std::time::Instant;

const SCHEMES: [Scheme; 6] = [
    Scheme::Verlet,
    Scheme::BackwardEuler,
    Scheme::Implicit,
    Scheme::Bdf2,
    Scheme::TrBdf2,
    Scheme::Esdirk3,
];
const LANES: usize = 8;
/// Steps are taken in runs of this length at most.
const RUN: usize = 1000;

struct Job {
    line: String,
    rod: Uniform,
    scheme: Scheme,
    /// Steps a second.
    steps: usize,
    energy: bool,
}

fn number(fields: &[&str], i: usize) -> f64 {
    fields[i].parse().expect("a number")
}

fn rod(fields: &[&str]) -> Uniform {
    Uniform {
        nodes: number(fields, 3) as usize,
        length: number(fields, 2),
        width: number(fields, 1),
        density: 1500.0,
        youngs_modulus: number(fields, 0),
        damping: 0.0,
        bending_damping: number(fields, 4),
        gravity: 9.81,
    }
}

impl Job {
    fn read(line: String) -> Self {
        let fields: Vec<_> = line.split_whitespace().collect();
        let rod = rod(&fields);
        let named = |scheme: &&Scheme| scheme.name() == fields[5];
        let scheme = *SCHEMES.iter().find(named).expect("a scheme");
        let (steps, energy) = (number(&fields, 6) as usize, fields[7] == "1");
        Job { line, rod, scheme, steps, energy }
    }

    fn kind(&self) -> (usize, &'static str, usize, bool) {
        (self.rod.nodes, self.scheme.name(), self.steps, self.energy)
    }
}

/// Some steps of a block of rods.
struct Run<'a, R: Real>(&'a mut Integrator<R>, &'a Rod<R>, &'a mut Motion<R>, usize);

impl<R: Real> Kernel for Run<'_, R> {
    type Output = R::Mask;
    #[inline(always)]
    fn run(self) -> R::Mask {
        self.0.advance(self.1, self.2, &Constant(R::zero()), self.3)
    }
}

struct Block<'a>(&'a [Job]);

impl ForLanes for Block<'_> {
    /// Of each job: tip, lost share of the energy, cost.
    type Output = Vec<(Vec2<f64>, f64, f64)>;

    fn make<R: Real>(self) -> Self::Output {
        let Block(jobs) = self;
        let Job { rod: Uniform { nodes, .. }, scheme, steps, energy: wanted, .. } = jobs[0];
        let mut rod = Rod::<R>::new(nodes);
        let mut motion = Motion::<R>::new(nodes);
        let mut integrator = Integrator::<R>::new(scheme, 1.0 / steps as f64, nodes);
        for lane in 0..LANES {
            let one = jobs[lane.min(jobs.len() - 1)].rod.rod();
            let mut start = Motion::<f64>::new(nodes);
            for i in 1..nodes {
                start.x[i] = Vec2::new(start.x[i - 1].x + one.rest[i - 1], 0.0);
            }
            Integrator::<f64>::prepare(scheme, &one, &mut start);
            rod.set_lane(lane, &one);
            motion.set_lane(lane, &start);
            integrator.forget(lane, &motion);
        }
        let began = Instant::now();
        let mut sound = [true; LANES];
        let mut swing = |motion: &mut Motion<R>, mut left: usize| {
            while left > 0 {
                let run = left.min(RUN);
                let went = R::run(Run(&mut integrator, &rod, motion, run));
                (0..LANES).for_each(|lane| sound[lane] &= went.get(lane));
                left -= run;
            }
        };
        swing(&mut motion, steps);
        let cost = began.elapsed().as_secs_f64() / LANES as f64;
        let tips = motion.x[nodes - 1];
        if wanted {
            swing(&mut motion, 9 * steps);
        }
        let (x, v) = (&motion.x, &motion.v);
        let after = energy(&rod, x, v);
        let after = after.kinetic + after.stretch + after.bend + after.gravity;
        let of = |lane: usize| {
            // At the start the energy is 0; hanging it is `-g sum m s`.
            let one = jobs[lane].rod.rod();
            let s = |i: usize| i as f64 * one.rest[0];
            let swing: f64 = (0..nodes).map(|i| one.gravity * one.mass[i] * s(i)).sum();
            let lost = if wanted && sound[lane] { -after.get(lane) / swing } else { f64::NAN };
            let tip = Vec2::new(tips.x.get(lane), tips.y.get(lane));
            (if sound[lane] { tip } else { Vec2::new(f64::NAN, f64::NAN) }, lost, cost)
        };
        (0..jobs.len()).map(of).collect()
    }
}

fn main() {
    let isa = Isa::current().expect("RODGYM_ISA");
    let lines = stdin().lock().lines().map(|line| line.expect("text"));
    let mut out = stdout().lock();
    if let Some(word) = std::env::args().nth(1) {
        for line in lines {
            let fields: Vec<_> = line.split_whitespace().collect();
            let rod = rod(&fields);
            let limit = rod.verlet_limit();
            let answer = if word == "limits" {
                format!("{limit:.6e}")
            } else {
                let values = [
                    rod.width,
                    rod.length,
                    rod.density,
                    rod.youngs_modulus,
                    rod.damping,
                    rod.bending_damping,
                    rod.gravity,
                ];
                let bounds = values.map(|value| (value, value));
                let choice = choose(rod.nodes, &bounds, limit, 0.01);
                format!("{} {} {:.3e}", choice.scheme.name(), 100 * choice.steps, choice.error)
            };
            writeln!(out, "{line} {answer}").expect("somebody reads");
        }
        return;
    }
    let jobs: Vec<Job> = lines.map(Job::read).collect();
    for kind in jobs.chunk_by(|a, b| a.kind() == b.kind()) {
        for block in kind.chunks(LANES) {
            let results = with_lanes(isa, Block(block));
            for (job, (tip, lost, cost)) in block.iter().zip(results) {
                writeln!(out, "{} {:.15e} {:.15e} {lost:.6e} {cost:.4e}", job.line, tip.x, tip.y)
                    .and_then(|()| out.flush())
                    .expect("somebody reads");
            }
        }
    }
}
