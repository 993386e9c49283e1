//! All controllers by name, and the one function that makes one for an environment.

use crate::controller::Controller;
use crate::error::{Error, Result, parameter};
use crate::fin::{Gait, GaitAdaptive};
use crate::pendulum::{HybridLqr, Lqg, LqgAdaptive, Lqr, Mpc, RodDesign, ThesisLqg};
use crate::saved;
pub use crate::target::Target;
use rodgym_core::fin::cycle::Waveform;
use serde::de::DeserializeOwned;
use std::sync::{PoisonError, RwLock};

/// One controller: its name, the machine that it is for, and its design.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Name, such as `lqr`.
    pub name: &'static str,
    /// The machine that it moves.
    pub machine: &'static str,
    /// Designs it for an environment with that machine.
    pub design: Design,
    /// Reads what `Controller::numbers` of its law wrote; nothing where the law cannot be saved.
    pub read: Option<Read>,
}

/// How a controller is designed.
pub type Design = fn(&Target) -> Result<Box<dyn Controller>>;
/// How a controller is read from the bytes of its design.
pub type Read = fn(&[u8]) -> Result<Box<dyn Controller>>;

impl Entry {
    /// A controller that can be saved.
    #[must_use]
    pub const fn saved(self, read: Read) -> Self {
        Entry { read: Some(read), ..self }
    }
}

/// Our own controllers.
const OURS: &[Entry] = &[
    pendulum("lqr", |target| boxed(Lqr::for_target(rod(target)?, target.observation.size())))
        .saved(plain::<Lqr>),
    pendulum("lqr-hybrid", |target| {
        boxed(HybridLqr::for_target(rod(target)?, target.observation.size()))
    })
    .saved(plain::<HybridLqr>),
    pendulum("lqg", |target| boxed(Lqg::for_target(target)))
        .saved(|bytes| boxed(Lqg::from_numbers(bytes))),
    pendulum("lqg-adaptive", |target| boxed(LqgAdaptive::for_target(target)))
        .saved(|bytes| boxed(LqgAdaptive::from_numbers(bytes))),
    pendulum("mpc", |target| boxed(Mpc::for_target(target))),
    pendulum("thesis-lqr", |target| {
        boxed(HybridLqr::literal_for_target(rod(target)?, target.observation.size()))
    })
    .saved(plain::<HybridLqr>),
    pendulum("thesis-lqg", |target| {
        boxed(ThesisLqg::for_target(rod(target)?, target.observation.size()))
    })
    .saved(plain::<ThesisLqg>),
    fin("gait", |target| boxed(Gait::best_for_target(target))).saved(plain::<Gait>),
    fin("gait-sine", |target| boxed(Gait::for_target(Waveform::Sine, target))).saved(plain::<Gait>),
    fin("gait-square", |target| boxed(Gait::for_target(Waveform::Square, target)))
        .saved(plain::<Gait>),
    fin("gait-triangle", |target| boxed(Gait::for_target(Waveform::Triangle, target)))
        .saved(plain::<Gait>),
    fin("gait-adaptive", |target| boxed(GaitAdaptive::for_target(target)))
        .saved(plain::<GaitAdaptive>),
];

const fn pendulum(name: &'static str, design: Design) -> Entry {
    Entry { name, machine: "pendulum", design, read: None }
}

const fn fin(name: &'static str, design: Design) -> Entry {
    Entry { name, machine: "fin", design, read: None }
}

fn boxed<C: Controller + 'static>(law: Result<C>) -> Result<Box<dyn Controller>> {
    Ok(Box::new(law?))
}

/// Reads a law that is its own numbers.
fn plain<C: Controller + DeserializeOwned + 'static>(bytes: &[u8]) -> Result<Box<dyn Controller>> {
    boxed(saved::read::<C>(bytes))
}

fn rod(target: &Target) -> Result<RodDesign> {
    RodDesign::from_config(&target.config)
}

/// Controllers that other crates added.
static ADDED: RwLock<Vec<Entry>> = RwLock::new(Vec::new());

/// Every controller, ours first.
pub fn entries() -> Vec<Entry> {
    let added = ADDED.read().unwrap_or_else(PoisonError::into_inner);
    OURS.iter().chain(added.iter()).copied().collect()
}

/// Adds a controller, so that `make` and the bindings know its name.
///
/// # Errors
/// A name that is there already.
pub fn register(entry: Entry) -> Result<()> {
    let mut added = ADDED.write().unwrap_or_else(PoisonError::into_inner);
    if OURS.iter().chain(added.iter()).any(|known| known.name == entry.name) {
        return Err(parameter("name", entry.name, "the name of no controller yet"));
    }
    added.push(entry);
    Ok(())
}

/// Designs a controller for an environment.
///
/// # Errors
/// An unknown name, an environment that the controller cannot play, a design without solution.
pub fn make(name: &str, target: &Target) -> Result<Box<dyn Controller>> {
    let all = entries();
    let Some(entry) = all.iter().find(|entry| entry.name == name) else {
        let known: Vec<&str> = all.iter().map(|entry| entry.name).collect();
        return Err(parameter("controller", name, &format!("one of {}", known.join(", "))));
    };
    if entry.machine != target.machine {
        let mine = all.iter().filter(|other| other.machine == target.machine);
        let mine: Vec<&str> = mine.map(|other| other.name).collect();
        let reason = format!(
            "it is for the machine \'{}\', and this one is a \'{}\' (which has {})",
            entry.machine,
            target.machine,
            if mine.is_empty() { "no controllers".into() } else { mine.join(", ") }
        );
        return Err(Error::Unsuitable { controller: entry.name, reason });
    }
    (entry.design)(target)
}
