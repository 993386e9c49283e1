//! Headers and arrays as they travel: a msgpack map, then one raw frame an array.
//!
//! Nothing here trusts the other side: sizes are checked before anything is allocated, nesting is
//! limited, alignment is never assumed. docs/protocol.md is the description for other languages.

use crate::error::{Code, Refusal};
use crate::json::Json;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::sync::Arc;

/// The protocol version that this crate speaks.
pub const VERSION: u64 = 1;

/// One frame of a reply. Shared, since the window keeps the last replies for a client that asks again.
pub type Frame = Arc<[u8]>;

/// Levels of nesting that a header may have: `p` of `make` needs five.
const MAX_DEPTH: usize = 16;

/// Name, numpy dtype string and shape of an array; its bytes are the frame of the same number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ArrayHeader(pub String, pub String, pub Vec<u64>);

/// What a client asks. Unknown keys are ignored.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RequestHeader {
    /// Protocol version.
    pub v: u64,
    /// Operation.
    pub op: String,
    /// Number that the reply repeats.
    pub rid: u64,
    /// Session, 32 hexadecimal digits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sid: Option<String>,
    /// Number of a changing call within its session, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seq: Option<u64>,
    /// Arrays that follow.
    pub arr: Vec<ArrayHeader>,
    /// Parameters of the operation.
    pub p: Map<String, Value>,
}

/// What the server answers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReplyHeader {
    /// Protocol version.
    pub v: u64,
    /// The request's number; 0 where the request could not be read.
    pub rid: u64,
    /// Whether it was done.
    pub ok: bool,
    /// Last sequence number that was carried out in the session, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seq: Option<u64>,
    /// Changes when the server restarts: all its sessions are then gone.
    pub epoch: String,
    /// Why it was not done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub err: Option<ErrorBody>,
    /// Arrays that follow.
    #[serde(default)]
    pub arr: Vec<ArrayHeader>,
    /// Results that are not arrays.
    #[serde(default)]
    pub p: Map<String, Value>,
}

/// A refusal on the wire.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorBody {
    /// Stable word, see docs/protocol.md.
    pub code: String,
    /// One sentence for people.
    pub msg: String,
    /// `never`, `same`, `new_session` or `elsewhere`.
    pub retry: String,
    /// Time to wait before a retry \[ms\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after_ms: Option<u64>,
}

impl From<&Refusal> for ErrorBody {
    fn from(refusal: &Refusal) -> Self {
        ErrorBody {
            code: refusal.code.word().into(),
            msg: refusal.msg.clone(),
            retry: refusal.retry().into(),
            after_ms: refusal.after_ms,
        }
    }
}

/// Reads a request's header.
///
/// # Errors
/// `version` for any other version, whatever else the header holds then; `bad_header` otherwise.
pub fn decode_request(bytes: &[u8], max_bytes: usize) -> Result<RequestHeader, (u64, Refusal)> {
    if bytes.len() > max_bytes {
        let text = format!("the header has {} bytes; at most {max_bytes} are allowed", bytes.len());
        return Err((0, Refusal::new(Code::BadHeader, text)));
    }
    match decode_map::<RequestHeader>(bytes) {
        Ok(header) if header.v == VERSION => Ok(header),
        Ok(header) => Err((header.rid, foreign_version(header.v))),
        // Another version may give our keys other types: its two constants are still read.
        Err(error) => match decode_map::<Constants>(bytes) {
            Ok(known) if known.v != VERSION => Err((known.rid, foreign_version(known.v))),
            Ok(known) => {
                let text = format!("the header cannot be read: {error}");
                Err((known.rid, Refusal::new(Code::BadHeader, text)))
            }
            Err(_) => {
                let text = format!("the header is not a msgpack map of this protocol: {error}");
                Err((0, Refusal::new(Code::BadHeader, text)))
            }
        },
    }
}

/// The keys whose meaning no version changes.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Constants {
    v: u64,
    rid: u64,
}

fn foreign_version(v: u64) -> Refusal {
    let text = format!(
        "protocol version {v} is not spoken here; this server speaks {VERSION} to {VERSION}"
    );
    let mut refusal = Refusal::new(Code::Version, text);
    refusal.details.insert("client".into(), vec![v, v].into());
    refusal.details.insert("server".into(), vec![VERSION, VERSION].into());
    refusal
}

fn decode_map<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    // The first byte of every msgpack map; a struct could be read from an array too.
    if !matches!(bytes.first(), Some(0x80..=0x8f | 0xde | 0xdf)) {
        return Err("the first byte does not begin a map".into());
    }
    let mut reader = rmp_serde::Deserializer::new(bytes);
    reader.set_max_depth(MAX_DEPTH);
    let Json(value) = Json::deserialize(&mut reader).map_err(|e| e.to_string())?;
    match reader.get_ref().len() {
        0 => serde_json::from_value(value).map_err(|e| e.to_string()),
        rest => Err(format!("{rest} bytes follow the map")),
    }
}

/// Writes a header, of a request or a reply.
pub fn encode<T: Serialize>(header: &T) -> Vec<u8> {
    rmp_serde::to_vec_named(header).expect("headers hold only strings, numbers, lists and maps")
}

/// Reads a reply's header, as a client does.
///
/// # Errors
/// The reason, in a sentence.
pub fn decode_reply(bytes: &[u8]) -> Result<ReplyHeader, String> {
    decode_map(bytes)
}

/// The arrays of one request, with lengths that are known to fit their shapes.
pub struct Arrays<'a> {
    items: Vec<(&'a ArrayHeader, &'a [u8])>,
}

impl<'a> Arrays<'a> {
    /// Puts descriptions and frames together.
    ///
    /// # Errors
    /// `bad_array`: another number of frames, an unknown dtype, a size that does not fit.
    pub fn new<F: AsRef<[u8]>>(
        headers: &'a [ArrayHeader],
        frames: &'a [F],
    ) -> Result<Self, Refusal> {
        let refuse = |text: String| Err(Refusal::new(Code::BadArray, text));
        if headers.len() != frames.len() {
            let (named, sent) = (headers.len(), frames.len());
            return refuse(format!("the header names {named} arrays, but {sent} frames follow it"));
        }
        let mut items = Vec::with_capacity(headers.len());
        for (header, frame) in headers.iter().zip(frames) {
            let ArrayHeader(name, dtype, shape) = header;
            let frame = frame.as_ref();
            let Some(size) = item_size(dtype) else {
                return refuse(format!("array '{name}' has dtype '{dtype}'; known are {DTYPES}"));
            };
            let bytes = shape.iter().try_fold(size, |total, &d| total.checked_mul(d));
            if bytes != Some(frame.len() as u64) {
                let got = frame.len();
                return refuse(format!(
                    "array '{name}' of dtype {dtype} and shape {shape:?} does not fit its frame of {got} bytes"
                ));
            }
            items.push((header, frame));
        }
        Ok(Arrays { items })
    }

    /// The bytes of an array that may be left out.
    ///
    /// # Errors
    /// `bad_array` if it is there with another dtype or shape.
    pub fn get(
        &self,
        name: &str,
        dtype: &str,
        shape: &[usize],
    ) -> Result<Option<&'a [u8]>, Refusal> {
        let Some((header, bytes)) = self.items.iter().find(|(h, _)| h.0 == name) else {
            return Ok(None);
        };
        if header.1 != dtype || !header.2.iter().copied().eq(shape.iter().map(|&d| d as u64)) {
            return Err(Refusal::new(
                Code::BadArray,
                format!(
                    "array '{name}' is {} {:?}, but {dtype} {shape:?} is needed",
                    header.1, header.2
                ),
            ));
        }
        Ok(Some(bytes))
    }

    /// The bytes of an array that is needed.
    ///
    /// # Errors
    /// `bad_array` if it is missing or of another dtype or shape.
    pub fn need(&self, name: &str, dtype: &str, shape: &[usize]) -> Result<&'a [u8], Refusal> {
        self.get(name, dtype, shape)?.ok_or_else(|| {
            let text = format!("array '{name}' ({dtype} {shape:?}) is missing");
            Refusal::new(Code::BadArray, text)
        })
    }

    /// All arrays whose name begins with `prefix`: rest of the name, dtype, shape and bytes.
    pub fn with_prefix(
        &self,
        prefix: &str,
    ) -> impl Iterator<Item = (&'a str, &'a str, &'a [u64], &'a [u8])> {
        self.items.iter().filter_map(move |(header, bytes)| {
            let name = header.0.strip_prefix(prefix)?;
            Some((name, header.1.as_str(), header.2.as_slice(), *bytes))
        })
    }
}

/// Element types of the protocol, as numpy writes them.
const DTYPES: &str = "<f4, <f8, <u4, <u8, |u1, |b1";

fn item_size(dtype: &str) -> Option<u64> {
    match dtype {
        "|u1" | "|b1" => Some(1),
        "<f4" | "<u4" => Some(4),
        "<f8" | "<u8" => Some(8),
        _ => None,
    }
}

/// A number that travels as little-endian bytes.
pub trait Element: bytemuck::Pod {
    /// Its numpy dtype string.
    const DTYPE: &'static str;
    /// From little-endian bytes in memory order to this machine's order, and back.
    fn swap(self) -> Self;
}

macro_rules! element {
    ($ty:ty, $dtype:literal) => {
        impl Element for $ty {
            const DTYPE: &'static str = $dtype;
            fn swap(self) -> Self {
                <$ty>::from_le_bytes(self.to_ne_bytes())
            }
        }
    };
}
element!(f32, "<f4");
element!(f64, "<f8");
element!(u32, "<u4");
element!(u64, "<u8");
element!(u8, "|u1");

/// Reads elements from bytes of any alignment, whose length is known to fit.
pub fn read<T: Element>(bytes: &[u8]) -> Vec<T> {
    bytes
        .chunks_exact(size_of::<T>())
        .map(|b| bytemuck::pod_read_unaligned::<T>(b).swap())
        .collect()
}

/// A named array for a reply.
pub fn array<T: Element>(name: &str, shape: &[usize], values: &[T]) -> (ArrayHeader, Frame) {
    let header =
        ArrayHeader(name.into(), T::DTYPE.into(), shape.iter().map(|&d| d as u64).collect());
    let frame: Frame = if cfg!(target_endian = "little") {
        bytemuck::cast_slice(values).into()
    } else {
        let swapped: Vec<T> = values.iter().map(|v| v.swap()).collect();
        bytemuck::cast_slice(&swapped).into()
    };
    (header, frame)
}
