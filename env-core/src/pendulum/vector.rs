//! The state of a pendulum as one vector.

use super::sim::BarePendulum;
use crate::directions::check_size;
use crate::error::{Error, Result};
use crate::lane::Real;
use crate::rod::Motion;
use crate::solver::{Past, Scheme};
use crate::vec2::Vec2;

/// Numbers of the state of a rod of `nodes` nodes.
pub fn size(scheme: Scheme, nodes: usize) -> usize {
    let node =
        4 + 2 * usize::from(scheme.carries_acceleration()) + 4 * usize::from(scheme.looks_back());
    node * (nodes - 1) + usize::from(scheme.looks_back())
}

/// All that the next step depends on: positions, velocities; of schemes that carry it the acceleration without what the
/// base torque does; of one that looks back positions and velocities a step before, and 1 where these are known, else 0.
/// (x, y) a node, without the first. What Newton's method guesses from is no part of it.
pub fn vector<R: Real>(scheme: Scheme, motion: &Motion<R>, past: &Past<R, Motion<R>>) -> Vec<R> {
    let mut all = Vec::with_capacity(size(scheme, motion.x.len()));
    let mut add = |list: &[Vec2<R>]| all.extend(list[1..].iter().flat_map(|p| [p.x, p.y]));
    add(&motion.x);
    add(&motion.v);
    if scheme.carries_acceleration() {
        let mut free = motion.a.clone();
        free[1] = free[1] - free[0];
        add(&free);
    }
    if scheme.looks_back() {
        add(&past.before.x);
        add(&past.before.v);
        all.push(past.known);
    }
    all
}

/// Puts such numbers in place, as many as `size` says.
pub fn set_vector<R: Real>(
    scheme: Scheme,
    from: &[R],
    motion: &mut Motion<R>,
    past: &mut Past<R, Motion<R>>,
) {
    let mut rest = from.iter();
    let mut take = |list: &mut [Vec2<R>]| {
        list[0] = Vec2::zero();
        for (to, (x, y)) in
            list[1..].iter_mut().zip(std::iter::from_fn(|| rest.next().zip(rest.next())))
        {
            *to = Vec2::new(*x, *y);
        }
    };
    take(&mut motion.x);
    take(&mut motion.v);
    motion.a.fill(Vec2::zero());
    if scheme.carries_acceleration() {
        take(&mut motion.a);
    }
    motion.a_before.copy_from_slice(&motion.a);
    if scheme.looks_back() {
        take(&mut past.before.x);
        take(&mut past.before.v);
        past.before.a.fill(Vec2::zero());
        past.before.a_before.fill(Vec2::zero());
        past.known = from[from.len() - 1];
    }
}

/// Memory for the numbers of a state.
pub fn empty<R: Real>(scheme: Scheme, nodes: usize) -> (Motion<R>, Past<R, Motion<R>>) {
    let memory = |kept| if kept { Motion::new(nodes) } else { Motion::default() };
    (Motion::new(nodes), Past::new(scheme, memory))
}

impl BarePendulum {
    /// See `vector`.
    pub fn state_vector(&self) -> Vec<f64> {
        vector(self.config.scheme, &self.motion, &self.integrator.past)
    }

    /// Sets the whole state; the time goes back to 0.
    ///
    /// # Errors
    /// Not as many numbers as the state has, or none that it can have; nothing changes then.
    pub fn set_state_vector(&mut self, from: &[f64]) -> Result<()> {
        let scheme = self.config.scheme;
        let wanted = size(scheme, self.nodes());
        check_size("x", from, wanted)?;
        if let Some(bad) = from.iter().find(|x| !x.is_finite()) {
            return Err(Error::parameter("x", bad, "finite numbers"));
        }
        let mut before = [0.0, 0.0];
        for place in from[..2 * (self.nodes() - 1)].as_chunks::<2>().0 {
            if *place == before {
                let allowed =
                    "distinct for neighbouring nodes, the first of which is at the origin";
                return Err(Error::parameter("x", format!("{place:?}"), allowed));
            }
            before = *place;
        }
        if scheme.looks_back() && ![0.0, 1.0].contains(&from[wanted - 1]) {
            let allowed = "0 or 1 as its last number, which says whether the step before is known";
            return Err(Error::parameter("x", from[wanted - 1], allowed));
        }
        set_vector(scheme, from, &mut self.motion, &mut self.integrator.past);
        self.steps = 0;
        Ok(())
    }
}
