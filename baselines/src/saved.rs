//! Controllers in files: what a design came to, so that it runs where nothing is designed.
//!
//! A file holds every number of a design as it is. A motor's controller that reads it needs no Riccati equation and no search,
//! and takes the same bits as the desk on which it was made.
//!
//! Layout, little-endian: `RODLAW`, version (u16), length of the payload (u32), payload (postcard: name, target as JSON, the
//! design's own bytes), CRC-32 of all before it.

use crate::controller::Controller;
use crate::error::{Result, parameter, unsaved};
use crate::registry::{self, Target};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

const MAGIC: &[u8; 6] = b"RODLAW";
/// Rises whenever the numbers of any law change their layout or their meaning.
const VERSION: u16 = 1;
const HEADER: usize = 6 + 2 + 4;

/// A controller from a file.
pub struct Saved {
    /// Its name in the registry.
    pub name: String,
    /// What it was designed for.
    pub target: Target,
    /// The law.
    pub law: Box<dyn Controller>,
}

#[derive(Serialize, Deserialize)]
struct Payload {
    name: String,
    target: String,
    numbers: Vec<u8>,
}

/// A controller's file.
///
/// # Errors
/// A law that cannot be saved.
pub fn encode(name: &str, target: &Target, law: &dyn Controller) -> Result<Vec<u8>> {
    let reader = registry::entries().into_iter().find(|entry| entry.name == name);
    let numbers = law.numbers().filter(|_| reader.is_some_and(|entry| entry.read.is_some()));
    let Some(numbers) = numbers else {
        return Err(parameter("controller", name, "one that can be saved"));
    };
    let target = serde_json::to_string(target).map_err(unsaved)?;
    let payload = Payload { name: name.into(), target, numbers };
    let payload = postcard::to_allocvec(&payload).map_err(unsaved)?;
    let mut bytes = Vec::with_capacity(HEADER + payload.len() + 4);
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(&(payload.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&payload);
    bytes.extend_from_slice(&crc32fast::hash(&bytes).to_le_bytes());
    Ok(bytes)
}

/// The controller of a file.
///
/// # Errors
/// Not such a file, another version, damage, a law that this program does not have.
pub fn decode(bytes: &[u8]) -> Result<Saved> {
    if bytes.len() < HEADER + 4 || &bytes[..6] != MAGIC {
        let size = bytes.len();
        return Err(unsaved(format!("{size} bytes that do not begin with RODLAW")));
    }
    let version = u16::from_le_bytes([bytes[6], bytes[7]]);
    if version != VERSION {
        return Err(unsaved(format!("it has version {version}, and this library reads {VERSION}")));
    }
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
    let end = bytes.len() - 4;
    if HEADER + word(8) as usize != end {
        return Err(unsaved(format!("{} bytes, but its header says otherwise", bytes.len())));
    }
    if crc32fast::hash(&bytes[..end]) != word(end) {
        return Err(unsaved("its checksum does not fit: it was damaged"));
    }
    let Payload { name, target, numbers } = read(&bytes[HEADER..end])?;
    let entries = registry::entries();
    let reader = entries.iter().find(|entry| entry.name == name).and_then(|entry| entry.read);
    let Some(reader) = reader else {
        return Err(unsaved(format!("it holds a \"{name}\", which this program cannot read")));
    };
    let target = serde_json::from_str(&target).map_err(unsaved)?;
    Ok(Saved { law: reader(&numbers)?, name, target })
}

/// The bytes of a design.
pub fn written<T: Serialize>(design: &T) -> Option<Vec<u8>> {
    postcard::to_allocvec(design).ok()
}

/// A design from the bytes that `written` made of it.
///
/// # Errors
/// Bytes of something else.
pub fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<T> {
    let (design, rest) = postcard::take_from_bytes(bytes).map_err(unsaved)?;
    if rest.is_empty() {
        Ok(design)
    } else {
        Err(unsaved(format!("{} bytes too many", rest.len())))
    }
}
