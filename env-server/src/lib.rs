//! Environments over the network: sessions, exactly-once steps, and the ZeroMQ front.
//!
//! `server::Server::handle` is the whole protocol as a pure function of frames; docs/protocol.md is
//! its description for other languages. The transport (`net`) needs the cargo feature `zmq`, which
//! builds libzmq with CURVE from source.

pub mod error;
pub mod limits;
pub mod live;
pub mod metrics;
#[cfg(feature = "zmq")]
pub mod net;
pub mod run;
pub mod server;
pub mod session;
pub mod shared;
pub mod transport;
pub mod window;
pub mod wire;
