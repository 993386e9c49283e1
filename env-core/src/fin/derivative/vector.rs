//! The state of a fin as one vector.

use crate::directions::check_size;
use crate::error::{Error, Result};
use crate::fin::design::Design;
use crate::fin::motion::Instant;
use crate::fin::servo::{STAGES, Servo};
use crate::fin::{BareFin, Body};
use crate::fluid::terms::Momentum;
use crate::lane::{Lanewise, Real};
use crate::vec2::Vec2;

/// Numbers of the servo and of its low-pass.
pub(super) const SERVO: usize = 2 + 2 * STAGES;
/// How far the driven node may be from where the pitch has it, over the length of its edge.
const OFF: f64 = 0.1;

/// Numbers of a motion: positions without those that are held, and velocities.
fn motion_size(design: &Design) -> usize {
    4 * design.geometry.nodes() - 2 + usize::from(design.free_swimming)
}

/// Numbers of the state of such a fin.
pub(in crate::fin) fn size(design: &Design) -> usize {
    let back = if design.scheme.looks_back() { motion_size(design) + 1 } else { 0 };
    motion_size(design) + back + SERVO
}

/// All that the next step depends on: positions, without those of the pivot that are held; velocities; of a scheme that
/// looks back the same a step before, and 1 where these are known, else 0; angle and rate of the servo, and of each stage
/// of its low-pass. (x, y) a node. The momentum of the water follows from these.
pub(in crate::fin) fn vector<R: Real>(body: &Body<R>, servo: &Servo<R>) -> Vec<R> {
    let design = &body.design;
    let mut all = Vec::with_capacity(size(design));
    let mut add = |at: &Instant<R>| {
        for (i, p) in at.x.iter().enumerate() {
            if i != design.geometry.pivot {
                all.extend([p.x, p.y]);
            } else if design.free_swimming {
                all.push(p.x);
            }
        }
        all.extend(at.v.iter().flat_map(|p| [p.x, p.y]));
    };
    add(&body.now);
    if design.scheme.looks_back() {
        add(&body.past.before);
        all.push(body.past.known);
    }
    servo.visit(&mut |x| all.push(*x));
    all
}

/// Puts such numbers in place, as many as `size` says.
pub(in crate::fin) fn set_vector<R: Real>(from: &[R], body: &mut Body<R>, servo: &mut Servo<R>) {
    let mut rest = from.iter().copied();
    let mut next = || rest.next().expect("it has this size");
    let design = body.design.clone();
    let mut now = std::mem::take(&mut body.now);
    let mut before = std::mem::take(&mut body.past.before);
    let mut take = |at: &mut Instant<R>| {
        for (i, p) in at.x.iter_mut().enumerate() {
            *p = Vec2::zero();
            if i != design.geometry.pivot {
                *p = Vec2::new(next(), next());
            } else if design.free_swimming {
                p.x = next();
            }
        }
        at.v.iter_mut().for_each(|p| *p = Vec2::new(next(), next()));
        at.p.fill(Vec2::zero());
        body.elements().gather_water(&at.x, &at.v, &mut Momentum(&mut at.p));
    };
    take(&mut now);
    if design.scheme.looks_back() {
        take(&mut before);
    }
    (body.now, body.past.before) = (now, before);
    if design.scheme.looks_back() {
        body.past.known = next();
    }
    servo.visit_mut(&mut |x| *x = next());
    body.pitch = servo.angle;
    body.loads.visit_mut(&mut |x| *x = R::zero());
}

impl BareFin {
    /// See `vector`.
    pub fn state_vector(&self) -> Vec<f64> {
        vector(&self.body, &self.servo)
    }

    /// Sets the whole state; the time goes back to 0, and no load is known.
    ///
    /// # Errors
    /// Not as many numbers as the state has, or none that it can have; nothing changes then.
    pub fn set_state_vector(&mut self, from: &[f64]) -> Result<()> {
        let design = &self.body.design;
        check_size("x", from, size(design))?;
        if let Some(bad) = from.iter().find(|x| !x.is_finite()) {
            return Err(Error::parameter("x", bad, "finite numbers"));
        }
        let known = from[from.len() - SERVO - 1];
        if design.scheme.looks_back() && ![0.0, 1.0].contains(&known) {
            let allowed = format!(
                "0 or 1 as number {}, which says whether the step before is known",
                from.len() - SERVO - 1
            );
            return Err(Error::parameter("x", known, allowed));
        }
        let mut next = self.clone();
        set_vector(from, &mut next.body, &mut next.servo);
        let x = &next.body.now.x;
        if let Some(pair) =
            x.windows(2).find(|pair| (pair[1] - pair[0]).dot(pair[1] - pair[0]) == 0.0)
        {
            let place = format!("({}, {})", pair[0].x, pair[0].y);
            return Err(Error::parameter("x", place, "distinct for neighbouring nodes"));
        }
        let (pivot, edge) = (design.geometry.pivot, design.geometry.edge_length);
        let (sine, cosine) = libm::sincos(next.servo.angle);
        let off = x[pivot + 1] - x[pivot] - Vec2::new(cosine, sine).scale(edge);
        if libm::hypot(off.x, off.y) > OFF * edge {
            let allowed = format!(
                "within {} m of where the servo's angle {} rad has the node behind the pivot",
                OFF * edge,
                next.servo.angle
            );
            let place = format!("({}, {})", x[pivot + 1].x, x[pivot + 1].y);
            return Err(Error::parameter("x", place, allowed));
        }
        next.steps = 0;
        *self = next;
        Ok(())
    }
}
