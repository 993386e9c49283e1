//! A controller for the bead: it brakes.

use rodgym_baselines::Controller;
use rodgym_baselines::registry::Entry;

/// The controller's row.
pub const DAMPER: Entry = Entry {
    name: "damper",
    machine: "bead",
    design: |target| Ok(Box::new(Damper { size: target.observation.size() })),
    read: None,
};

/// Pushes against the velocity.
struct Damper {
    size: usize,
}

impl Controller for Damper {
    fn observation_size(&self) -> usize {
        self.size
    }

    fn state_size(&self) -> usize {
        0
    }

    fn start(&self, _: &[f32], _: &mut [f64]) {}

    fn act(&self, observation: &[f32], _: &mut [f64], action: &mut [f32]) {
        action[0] = (-observation[1]).clamp(-1.0, 1.0);
    }
}
