//! What a change of a fin's material, water or hull does at the moments of a tape: the balance of forces in dual numbers,
//! whose directions are those of the parameters, with the motion as it was.

use crate::fin::Body;
use crate::fin::motion::Instant;
use crate::fluid::terms::Momentum;
use crate::lane::{Dual, Lanewise, Real};
use crate::solver::{Move, Tape};
use crate::vec2::Vec2;

/// Changes at one moment; only the slopes count.
#[derive(Clone, Debug)]
pub(super) struct Effect {
    /// Of the residual on every node.
    pub residual: Vec<Vec2<Dual>>,
    /// Of the water's momentum.
    pub momentum: Vec<Vec2<Dual>>,
    /// Of resistive and shed thrust.
    pub resistance: Dual,
    pub shed: Dual,
    /// Of the hull's balance, without what stands in `residual`.
    pub hull: Dual,
}

/// Changes at every moment of a tape.
pub(super) fn effects(body: &Body<Dual>, tape: &Tape) -> Vec<Effect> {
    let nodes = body.nodes();
    let (mut at, mut start) = (Instant::<Dual>::new(nodes), Instant::<Dual>::new(nodes));
    let pivot = body.design.geometry.pivot;
    let effect = |(i, way): (usize, &Move)| {
        let Move::Stage { stage, .. } = way else { unreachable!("fins are stepped implicitly") };
        let ((x, v), earlier) = (tape.moment(i), &tape.more(i)[1..]);
        fill(&mut at.x, x);
        fill(&mut at.v, v);
        fill(&mut start.v, earlier);
        let mut residual = vec![Vec2::zero(); nodes];
        let rate = Dual::constant(stage.rate);
        let loads = body.elements().balance(&start, rate, &mut at, &mut residual);
        let (speed, before) = (at.v[pivot].x, start.v[pivot].x);
        let hull = body.hull_mass * rate * (speed - before) + body.hull_drag * speed.abs() * speed;
        Effect {
            residual,
            momentum: at.p.clone(),
            resistance: loads.resistive_thrust,
            shed: loads.shed_thrust,
            hull,
        }
    };
    tape.moves().iter().enumerate().map(effect).collect()
}

/// The water's momentum in a motion, in dual numbers.
pub(super) fn momentum(body: &Body<Dual>, x: &[Vec2<f64>], v: &[Vec2<f64>]) -> Vec<Vec2<Dual>> {
    let mut at = Instant::<Dual>::new(x.len());
    fill(&mut at.x, x);
    fill(&mut at.v, v);
    body.elements().gather_water(&at.x, &at.v, &mut Momentum(&mut at.p));
    at.p
}

fn fill(to: &mut [Vec2<Dual>], from: &[Vec2<f64>]) {
    for (to, from) in to.iter_mut().zip(from) {
        to.pair(from, &mut |to: &mut Dual, from: &f64| *to = Dual::constant(*from));
    }
}
