//! One drawing for every machine, looked up by the word that the machine has in its scenes.

use crate::past::Past;
use crate::picture::Picture;
use crate::{fin, pendulum};
use rodgym_core::env::Scene;
use rodgym_core::{Error, Result};
use std::sync::{PoisonError, RwLock};

/// How a machine is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Drawing {
    /// The machine.
    pub machine: &'static str,
    /// Width and height that suit it \[px\].
    pub size: (u32, u32),
    /// Draws a checked scene and what is remembered of the episode, at this width and height \[px\].
    pub draw: fn(&Scene, &Past, (u32, u32)) -> Picture,
}

/// Our own drawings: square for the pendulum, wide for the fin.
const OURS: &[Drawing] = &[
    Drawing { machine: "pendulum", size: (480, 480), draw: pendulum::draw },
    Drawing { machine: "fin", size: (800, 450), draw: fin::draw },
];

/// Drawings that other crates added.
static ADDED: RwLock<Vec<Drawing>> = RwLock::new(Vec::new());

/// Every drawing, ours first.
pub fn drawings() -> Vec<Drawing> {
    let added = ADDED.read().unwrap_or_else(PoisonError::into_inner);
    OURS.iter().chain(added.iter()).copied().collect()
}

/// The drawing of a machine.
///
/// # Errors
/// A machine that has none.
pub fn drawing(machine: &str) -> Result<Drawing> {
    let all = drawings();
    all.iter().find(|drawing| drawing.machine == machine).copied().ok_or_else(|| {
        let known: Vec<String> = all.iter().map(|one| format!("'{}'", one.machine)).collect();
        Error::parameter("scene.machine", machine, known.join(" or "))
    })
}

/// Adds a drawing, so that everybody who draws knows its machine.
///
/// # Errors
/// A machine that has one already.
pub fn register(drawing: Drawing) -> Result<()> {
    if drawings().iter().any(|known| known.machine == drawing.machine) {
        let allowed = "a machine that has no drawing yet";
        return Err(Error::parameter("machine", drawing.machine, allowed));
    }
    ADDED.write().unwrap_or_else(PoisonError::into_inner).push(drawing);
    Ok(())
}
