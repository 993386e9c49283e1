//! Gaits of the fin: commands that are known beforehand, and one that is chosen by what the fin feels like.

mod adaptive;
mod feel;
mod gait;
mod play;

pub use adaptive::GaitAdaptive;
pub use gait::Gait;
