//! What the server needs from a network, so that another transport can take ZeroMQ's place and tests
//! need none.

use crate::memory::Charge;
use crate::wire::Frame;
use std::io;
use std::time::Duration;

/// A request as it arrived.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Where the reply goes; meaningful to the transport only.
    pub peer: Vec<u8>,
    /// Who asks, as the transport's security layer knows; `None`: not allowed any more.
    pub user: Option<String>,
    /// The message.
    pub frames: Vec<Vec<u8>>,
}

/// Wakes a `Transport::receive` from another thread.
pub type Waker = Box<dyn Fn() + Send>;

/// A many-to-one message transport.
pub trait Transport {
    /// The next request; `None` after `timeout` or when woken.
    ///
    /// # Errors
    /// The transport is broken for good.
    fn receive(&mut self, timeout: Duration) -> io::Result<Option<Request>>;

    /// Sends a reply without ever waiting for the peer; `false` if it could not be delivered: the
    /// peer is gone or does not read. It may ask again. The charge lasts until the reply is out.
    fn send(&mut self, peer: &[u8], reply: Vec<Frame>, charge: Charge) -> bool;

    /// Makes a waker for another thread.
    ///
    /// # Errors
    /// No resources.
    fn waker(&mut self) -> io::Result<Waker>;
}
