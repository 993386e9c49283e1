//! The ZeroMQ front: a ROUTER socket with every limit set, and nothing that waits for a peer.

use super::guard::{self, Bounds};
use crate::limits::{HIGH_WATER_MARK, Limits};
use crate::memory::Charge;
use crate::transport::{Request, Transport, Waker};
use crate::wire::Frame;
use std::ffi::{c_int, c_void};
use std::io;
use std::time::Duration;

/// The only peers that this protocol has.
const PEERS: [&str; 2] = ["DEALER", "REQ"];
const HEARTBEAT_MS: i32 = 2000;
const HEARTBEAT_TIMEOUT_MS: i32 = 6000;
/// Frames of one message beyond which its connection is closed (by a libzmq without our bounds: the
/// rest is thrown away unread).
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
        // With a domain, peers below ZMTP 3 are turned away, keys or not: a web page's POST is such a one.
        front.set_zap_domain(super::zap::DOMAIN)?;
        guard::apply(
            &mut front,
            Bounds {
                parts: MOST_FRAMES as c_int,
                bytes: limits.transport_bytes as i64,
                connections: limits.connections as c_int,
            },
        );
        if let Security::Curve(secret) = security {
            front.set_curve_server(true)?;
            front.set_curve_secretkey(&zmq::z85_decode(secret).map_err(|_| zmq::Error::EINVAL)?)?;
            // Without this option libzmq admits every key while no handler is bound.
            guard::set(&mut front, zmq_sys::ZMQ_ZAP_ENFORCE_DOMAIN, 1 as c_int)?;
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

    /// One message of a peer that may speak here, if there is one.
    fn take(&mut self) -> Result<Option<Request>, zmq::Error> {
        loop {
            let peer = match self.front.recv_bytes(zmq::DONTWAIT) {
                Ok(peer) => peer,
                Err(zmq::Error::EAGAIN | zmq::Error::EINTR) => return Ok(None),
                Err(e) => return Err(e),
            };
            let (mut frames, mut user, mut known) = (Vec::new(), None, false);
            let mut part = zmq::Message::new();
            while self.front.get_rcvmore()? {
                self.front.recv(&mut part, 0)?;
                if frames.is_empty() {
                    known = part.gets("Socket-Type").is_some_and(|kind| PEERS.contains(&kind));
                    user = (self.identify)(part.gets("User-Id"));
                }
                if frames.len() < MOST_FRAMES {
                    frames.push(part.to_vec());
                }
            }
            if known {
                return Ok(Some(Request { peer, user, frames }));
            }
        }
    }
}

/// A frame in libzmq's hands, with what is given back when it lets go.
struct Lent {
    _frame: Frame,
    _charge: Option<Charge>,
}

/// Called by libzmq, on any thread, once it needs the bytes no more.
unsafe extern "C" fn give_back(_: *mut c_void, lent: *mut c_void) {
    // SAFETY: `send_shared` made this pointer from a box, and libzmq calls once.
    drop(unsafe { Box::from_raw(lent.cast::<Lent>()) });
}

/// Sends a frame without copying it: a large reply in the window and on its way is one.
fn send_shared(socket: &mut zmq::Socket, frame: Frame, charge: Option<Charge>, more: bool) -> bool {
    let flags = zmq::DONTWAIT | if more { zmq::SNDMORE } else { 0 };
    if charge.is_none() && frame.len() < 512 {
        return socket.send(&frame[..], flags).is_ok();
    }
    let (data, size) = (frame.as_ptr(), frame.len());
    let lent = Box::into_raw(Box::new(Lent { _frame: frame, _charge: charge }));
    let mut message = zmq_sys::zmq_msg_t::default();
    // SAFETY: the bytes live as long as `lent`, which `give_back` drops; libzmq only reads them. The
    // message is initialised before it is sent, and closed if libzmq did not take it.
    unsafe {
        let data = data.cast_mut().cast::<c_void>();
        if zmq_sys::zmq_msg_init_data(&raw mut message, data, size, Some(give_back), lent.cast())
            != 0
        {
            give_back(data, lent.cast());
            return false;
        }
        let sent = zmq_sys::zmq_msg_send(&raw mut message, socket.as_mut_ptr(), flags) >= 0;
        if !sent {
            zmq_sys::zmq_msg_close(&raw mut message);
        }
        sent
    }
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

    fn send(&mut self, peer: &[u8], reply: Vec<Frame>, charge: Charge) -> bool {
        if self.front.send(peer, zmq::DONTWAIT | zmq::SNDMORE).is_err() {
            return false;
        }
        let last = reply.len() - 1;
        let mut charge = Some(charge);
        reply.into_iter().enumerate().all(|(i, frame)| {
            let charge = if i == last { charge.take() } else { None };
            send_shared(&mut self.front, frame, charge, i < last)
        })
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
