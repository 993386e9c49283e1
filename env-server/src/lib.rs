//! Environments over the network: sessions, exactly-once steps, and the ZeroMQ front.
//!
//! `server::Server::handle` is the whole protocol as a pure function of frames; docs/protocol.md is
//! its description for other languages. The transport (`net`) needs the cargo feature `zmq`, which
//! builds libzmq with CURVE from source.

pub mod error;
mod json;
pub mod limits;
pub mod live;
pub mod memory;
pub mod metrics;
#[cfg(feature = "zmq")]
pub mod net;
pub mod pool;
pub mod run;
pub mod server;
pub mod session;
pub mod shared;
pub mod size;
pub mod transport;
pub mod window;
pub mod wire;
pub mod work;
