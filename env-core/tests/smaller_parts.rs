//! Implicit steps that do not converge are taken again in smaller parts: as the parts alone would be, in
//! each lane by itself, with nothing changed where even the smallest fail.

use rodgym_core::fin::{Body, Design, Geometry, Parameters};
use rodgym_core::fluid::Hydrodynamics;
use rodgym_core::lane::{Lanes, Lanewise, Mask, Real};
use rodgym_core::rod::{Motion, Rod, Uniform};
use rodgym_core::seed::Stream;
use rodgym_core::solver::{Constant, Integrator, Scheme};
use rodgym_core::vec2::Vec2;

const NODES: usize = 7;

fn rod() -> Rod<f64> {
    Uniform {
        nodes: NODES,
        length: 0.3,
        width: 0.007,
        density: 1500.0,
        youngs_modulus: 1e7,
        damping: 0.02,
        bending_damping: 5e-4,
        gravity: 9.81,
    }
    .rod()
}

/// A hanging rod whose nodes fly apart at random.
fn torn(seed: u64) -> Motion<f64> {
    let (mut stream, rod) = (Stream::new(seed), rod());
    let mut motion = Motion::new(NODES);
    for i in 1..NODES {
        motion.x[i] = motion.x[i - 1] - Vec2::new(0.0, rod.rest[i - 1]);
        motion.v[i] = Vec2::new(stream.uniform(-30.0, 30.0), stream.uniform(-30.0, 30.0));
    }
    motion
}

fn bits(motion: &Motion<f64>) -> Vec<u64> {
    let mut bits = vec![];
    motion.visit(&mut |x| bits.push(x.to_bits()));
    bits
}

fn advance(scheme: Scheme, dt: f64, steps: usize, motion: &mut Motion<f64>) -> bool {
    Integrator::new(scheme, dt, NODES).advance_one(&rod(), motion, 0.05, steps)
}

#[test]
fn a_step_that_fails_is_taken_as_its_halves() {
    for scheme in [Scheme::Implicit, Scheme::BackwardEuler] {
        let mut as_halves = 0;
        for seed in 0..200 {
            let (mut whole, mut halves) = (torn(seed), torn(seed));
            assert!(advance(scheme, 5e-3, 1, &mut whole), "{scheme:?}, {seed}");
            // A step of 5 ms that succeeds at once ends elsewhere than two of 2.5 ms.
            let sound = advance(scheme, 2.5e-3, 2, &mut halves);
            as_halves += usize::from(sound && bits(&whole) == bits(&halves));
        }
        assert!(as_halves > 20, "{scheme:?}: {as_halves} of 200");
    }
}

#[test]
fn each_lane_is_repaired_by_itself() {
    const W: usize = 8;
    for scheme in [Scheme::Verlet, Scheme::Implicit, Scheme::BackwardEuler] {
        let (steps, dt) = if scheme == Scheme::Verlet { (10, 5e-4) } else { (1, 5e-3) };
        let (mut rods, mut motions) = (Rod::<Lanes<W>>::new(NODES), Motion::new(NODES));
        let mut singles: Vec<_> = (0..W as u64).map(torn).collect();
        // One that no step can save.
        singles[3].v[4].x = f64::NAN;
        for (lane, single) in singles.iter_mut().enumerate() {
            Integrator::<f64>::prepare(scheme, &rod(), single);
            rods.set_lane(lane, &rod());
            motions.set_lane(lane, single);
        }
        let drive = Constant(Lanes::<W>::splat(0.05));
        let sound = Integrator::new(scheme, dt, NODES).advance(&rods, &mut motions, &drive, steps);
        for (lane, single) in singles.iter_mut().enumerate() {
            let alone = advance(scheme, dt, steps, single);
            let mut together = Motion::new(NODES);
            motions.read_lane(lane, &mut together);
            assert_eq!(sound.get(lane), alone, "{scheme:?}, lane {lane}");
            assert_eq!(alone, lane != 3, "{scheme:?}, lane {lane}");
            assert_eq!(bits(&together), bits(single), "{scheme:?}, lane {lane}");
        }
    }
}

/// A straight fin whose nodes behind the driven edge fly apart at random, at up to `speed` \[m/s\] a component.
fn torn_fin<R: Real>(fin: &mut Body<R>, lane: usize, speed: f64, seed: u64) {
    fin.begin(lane, &Parameters::default(), 0.1);
    let (mut stream, single) = (Stream::new(seed), fin.lane(lane));
    let free = single.design.geometry.pivot + 2;
    let mut draw = |i| {
        let v = Vec2::new(stream.uniform(-speed, speed), stream.uniform(-speed, speed));
        if i < free { Vec2::zero() } else { v }
    };
    let velocities: Vec<_> = (0..fin.nodes()).map(&mut draw).collect();
    fin.set_motion(lane, &single.now.x, &velocities, 0.1);
}

fn fins<R: Real>(physics_dt: f64) -> Body<R> {
    Body::new(Design {
        geometry: Geometry::thesis(),
        hydrodynamics: Hydrodynamics::Lighthill,
        scheme: Scheme::BackwardEuler,
        physics_dt,
        free_swimming: false,
    })
    .unwrap()
}

/// Every number of a fin but its loads.
fn fin_bits(fin: &mut Body<f64>) -> Vec<u64> {
    fin.loads = Default::default();
    let mut bits = vec![];
    fin.visit(&mut |x| bits.push(x.to_bits()));
    bits
}

#[test]
fn a_fin_s_step_that_fails_is_taken_as_its_halves() {
    let mut as_halves = 0;
    for seed in 0..200 {
        let (mut whole, mut halves) = (fins::<f64>(4e-3), fins::<f64>(2e-3));
        torn_fin(&mut whole, 0, 20.0, seed);
        torn_fin(&mut halves, 0, 20.0, seed);
        assert!(whole.step(0.11), "{seed}");
        let first = halves.step(0.1 + 0.5 * (0.11 - 0.1)).then_some(halves.loads.thrust);
        if let (Some(first), true) = (first, halves.step(0.11)) {
            let mean = 0.5 * first + 0.5 * halves.loads.thrust;
            let thrust = whole.loads.thrust;
            // What was one step ago is one whole step ago.
            halves.past = whole.past.clone();
            if fin_bits(&mut whole) == fin_bits(&mut halves) {
                as_halves += 1;
                // (A half may have been halved itself: the mean of means is rounded otherwise.)
                assert!((thrust - mean).abs() <= 1e-12 * mean.abs(), "{seed}: {thrust}, {mean}");
            }
        }
    }
    assert!(as_halves > 20, "{as_halves} of 200");
}

#[test]
fn each_lane_of_fins_is_repaired_by_itself() {
    const W: usize = 8;
    let mut lost = 0;
    for block in 0..10 {
        let mut fins_together = fins::<Lanes<W>>(0.04);
        let mut alone: Vec<_> = (0..W).map(|_| fins::<f64>(0.04)).collect();
        for (lane, single) in alone.iter_mut().enumerate() {
            let seed = (W * block + lane) as u64;
            torn_fin(&mut fins_together, lane, 300.0, seed);
            torn_fin(single, 0, 300.0, seed);
        }
        let sound = fins_together.step(Lanes::splat(0.11));
        for (lane, single) in alone.iter_mut().enumerate() {
            let before = fin_bits(single);
            let taken = single.step(0.11);
            assert_eq!(sound.get(lane), taken, "lane {lane} of block {block}");
            let after = fin_bits(single);
            if !taken {
                lost += 1;
                assert_eq!(after, before, "lane {lane} of block {block} was given up");
            }
            assert_eq!(
                fin_bits(&mut fins_together.lane(lane)),
                after,
                "lane {lane} of block {block}"
            );
        }
    }
    assert!((1..W * 5).contains(&lost), "{lost} of {} could not be saved", 10 * W);
}
