//! The ZeroMQ front: a ROUTER socket with every limit set, and nothing that waits for a peer.

use crate::limits::{HIGH_WATER_MARK, Limits};
use crate::transport::{Request, Transport, Waker};
use crate::wire::Frame;
use std::ffi::{c_int, c_void};
use std::io;
use std::time::Duration;

const HEARTBEAT_MS: i32 = 2000;
const HEARTBEAT_TIMEOUT_MS: i32 = 6000;
/// Frames of one message beyond which the rest is thrown away unread.
const MOST_FRAMES: usize = 64;

/// Maps ZeroMQ's `User-Id` to a user who is allowed now.
pub type Identify = Box<dyn Fn(Option<&str>) -> Option<String>>;

/// How the front is secured.
pub enum Security {
    /// Anybody who reaches the address.
    Open,
    /// CURVE with this secret key (Z85); the authentication handler must be bound already.
    Curve(String),
}

/// ROUTER socket and the means to wake it.
pub struct Router {
    context: zmq::Context,
    front: zmq::Socket,
    bell: zmq::Socket,
    endpoint: String,
    identify: Identify,
}

impl Router {
    /// Binds. `endpoint` may end in `:*` or `:0` for a free port.
    ///
    /// # Errors
    /// An address that cannot be bound, or a libzmq without what is needed.
    pub fn bind(
        context: &zmq::Context,
        endpoint: &str,
        security: &Security,
        limits: &Limits,
        identify: Identify,
    ) -> Result<Self, zmq::Error> {
        let mut front = context.socket(zmq::ROUTER)?;
        front.set_maxmsgsize(limits.message_bytes as i64)?;
        front.set_sndhwm(HIGH_WATER_MARK)?;
        front.set_rcvhwm(HIGH_WATER_MARK)?;
        front.set_linger(limits.linger_ms)?;
        front.set_backlog(limits.backlog)?;
        front.set_handshake_ivl(limits.handshake_ms)?;
        front.set_heartbeat_ivl(HEARTBEAT_MS)?;
        front.set_heartbeat_timeout(HEARTBEAT_TIMEOUT_MS)?;
        // A reply to a peer that is gone or does not read is an error that we count.
        front.set_router_mandatory(true)?;
        // With it, an IPv4 address would come back as ::ffff:1.2.3.4.
        front.set_ipv6(endpoint.contains('['))?;
        if let Security::Curve(secret) = security {
            front.set_curve_server(true)?;
            front.set_curve_secretkey(&zmq::z85_decode(secret).map_err(|_| zmq::Error::EINVAL)?)?;
            front.set_zap_domain(super::zap::DOMAIN)?;
            enforce_zap(&mut front)?;
        }
        let bell = context.socket(zmq::PULL)?;
        bell.set_linger(0)?;
        bell.bind("inproc://rodgym.bell")?;
        front.bind(endpoint)?;
        let endpoint = front.get_last_endpoint()?.unwrap_or_else(|_| endpoint.into());
        Ok(Router { context: context.clone(), front, bell, endpoint, identify })
    }

    /// The address with its real port.
    pub fn endpoint(&self) -> &str {
        &self.endpoint
    }

    /// One message, if there is one.
    fn take(&mut self) -> Result<Option<Request>, zmq::Error> {
        let peer = match self.front.recv_bytes(zmq::DONTWAIT) {
            Ok(peer) => peer,
            Err(zmq::Error::EAGAIN | zmq::Error::EINTR) => return Ok(None),
            Err(e) => return Err(e),
        };
        let mut frames = Vec::new();
        let mut user = None;
        let mut part = zmq::Message::new();
        while self.front.get_rcvmore()? {
            self.front.recv(&mut part, 0)?;
            if frames.is_empty() {
                user = (self.identify)(part.gets("User-Id"));
            }
            if frames.len() < MOST_FRAMES {
                frames.push(part.to_vec());
            }
        }
        Ok(Some(Request { peer, user, frames }))
    }
}

/// Without this option libzmq admits every key while no handler is bound.
fn enforce_zap(socket: &mut zmq::Socket) -> Result<(), zmq::Error> {
    let on: c_int = 1;
    // SAFETY: the socket lives, and the option reads one int at the address that we pass.
    let rc = unsafe {
        zmq_sys::zmq_setsockopt(
            socket.as_mut_ptr(),
            zmq_sys::ZMQ_ZAP_ENFORCE_DOMAIN as c_int,
            (&raw const on).cast::<c_void>(),
            size_of::<c_int>(),
        )
    };
    if rc == 0 { Ok(()) } else { Err(zmq::Error::ENOTSUP) }
}

fn broken(error: zmq::Error) -> io::Error {
    io::Error::other(format!("ZeroMQ: {error}"))
}

impl Transport for Router {
    fn receive(&mut self, timeout: Duration) -> io::Result<Option<Request>> {
        if let Some(request) = self.take().map_err(broken)? {
            return Ok(Some(request));
        }
        let mut items = [self.front.as_poll_item(zmq::POLLIN), self.bell.as_poll_item(zmq::POLLIN)];
        match zmq::poll(&mut items, timeout.as_millis() as i64) {
            Ok(_) | Err(zmq::Error::EINTR) => {}
            Err(e) => return Err(broken(e)),
        }
        while self.bell.recv_bytes(zmq::DONTWAIT).is_ok() {}
        self.take().map_err(broken)
    }

    fn send(&mut self, peer: &[u8], reply: &[Frame]) -> bool {
        let mut flags = zmq::DONTWAIT | zmq::SNDMORE;
        if self.front.send(peer, flags).is_err() {
            return false;
        }
        for (i, frame) in reply.iter().enumerate() {
            if i + 1 == reply.len() {
                flags = zmq::DONTWAIT;
            }
            if self.front.send(&frame[..], flags).is_err() {
                return false;
            }
        }
        true
    }

    fn waker(&mut self) -> io::Result<Waker> {
        let bell = self.context.socket(zmq::PUSH).map_err(broken)?;
        bell.set_linger(0).map_err(broken)?;
        bell.connect("inproc://rodgym.bell").map_err(broken)?;
        Ok(Box::new(move || {
            // A full bell is ringing already.
            let _ = bell.send(&b""[..], zmq::DONTWAIT);
        }))
    }
}
