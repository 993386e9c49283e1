//! Versioned bytes of one environment: physics, random stream, clock.
//!
//! Layout, little-endian: `RODGYM`, version (u16), fingerprint of the environment's id and configuration (u32),
//! length of the payload (u32), payload (postcard), CRC-32 of all before it.

use crate::draw::Draw;
use crate::error::{Error, Result};
use crate::seed::Stream;
use crate::spec::Spec;
use serde::{Deserialize, Serialize};

const MAGIC: &[u8; 6] = b"RODGYM";
const VERSION: u16 = 4;
const HEADER: usize = 6 + 2 + 4 + 4;

/// Everything that the future of one environment depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Every number of the plant, in the order of `Lanewise::visit`.
    pub numbers: Vec<f64>,
    /// Random stream.
    pub stream: Stream,
    /// Steps since the episode began.
    pub steps: u32,
    /// Whether the episode has ended and the next has not begun.
    pub ended: bool,
    /// Whether an episode has ever begun.
    pub begun: bool,
    /// Sum of rewards since the episode began.
    pub episode_return: f64,
    /// Last reward.
    pub reward: f64,
    /// Last action.
    pub action: Vec<f64>,
    /// How parameters are drawn, where a user has set that since the environment was made.
    pub draws: Option<Vec<Draw>>,
    /// Last observation.
    pub observation: Vec<f32>,
}

/// A single machine whose motion can be taken down number by number, and put back.
pub trait Numbers: Clone {
    /// Calls `f` with every number that the future depends on, always in the same order.
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64));

    /// The numbers as they are.
    fn numbers(&self) -> Vec<f64> {
        let mut numbers = Vec::new();
        self.clone().visit(&mut |x| numbers.push(*x));
        numbers
    }

    /// Puts numbers in place that a machine of the same keywords had.
    ///
    /// # Errors
    /// Not as many as this machine has, or one that is not finite; nothing changes then.
    fn set_numbers(&mut self, numbers: &[f64]) -> Result<()> {
        let (got, wanted) = (numbers.len(), self.numbers().len());
        if got != wanted {
            return Err(Error::snapshot(format!("{got} numbers, but {wanted} are needed")));
        }
        if let Some(odd) = numbers.iter().find(|number| !number.is_finite()) {
            return Err(Error::snapshot(format!("it holds {odd}, which is not finite")));
        }
        let mut next = numbers.iter();
        self.visit(&mut |x| *x = *next.next().expect("counted above"));
        Ok(())
    }
}

/// Names the kind of environment that a snapshot fits: id, version of the code's layout and configuration.
fn fingerprint(spec: &Spec) -> u32 {
    let config = serde_json::to_string(&spec.config).unwrap_or_default();
    crc32fast::hash(format!("{} {config}", spec.id).as_bytes())
}

impl Snapshot {
    /// The bytes.
    pub fn encode(&self, spec: &Spec) -> Vec<u8> {
        let payload = postcard::to_allocvec(self).expect("plain numbers can be written");
        let mut bytes = Vec::with_capacity(HEADER + payload.len() + 4);
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        bytes.extend_from_slice(&fingerprint(spec).to_le_bytes());
        bytes.extend_from_slice(&(payload.len() as u32).to_le_bytes());
        bytes.extend_from_slice(&payload);
        bytes.extend_from_slice(&crc32fast::hash(&bytes).to_le_bytes());
        bytes
    }

    /// Reads bytes that `encode` wrote for the same kind of environment.
    ///
    /// # Errors
    /// Not a snapshot, a foreign version, damage, another kind of environment.
    pub fn decode(bytes: &[u8], spec: &Spec) -> Result<Snapshot> {
        let refuse = |reason: String| Err(Error::snapshot(reason));
        if bytes.len() < HEADER + 4 || &bytes[..6] != MAGIC {
            return refuse(format!("{} bytes that do not begin with RODGYM", bytes.len()));
        }
        let word = |at: usize| {
            u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes were taken"))
        };
        let version = u16::from_le_bytes([bytes[6], bytes[7]]);
        if version != VERSION {
            return refuse(format!("version {version}, but this library reads {VERSION}"));
        }
        let end = bytes.len() - 4;
        if HEADER + word(12) as usize != end {
            return refuse(format!("{} bytes, but its header says otherwise", bytes.len()));
        }
        if crc32fast::hash(&bytes[..end]) != word(end) {
            return refuse("its checksum does not fit: it was damaged".into());
        }
        if word(8) != fingerprint(spec) {
            return refuse(format!("it is not of {} with this configuration", spec.id));
        }
        postcard::from_bytes(&bytes[HEADER..end]).or_else(|error| refuse(error.to_string()))
    }
}
