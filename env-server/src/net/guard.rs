//! What our libzmq has and a distribution's has not: no peer claims an id of the server's own, and what
//! peers make it hold is bounded. Without these, whoever can connect can end the process or fill its
//! memory (env-server/zmq-sys/README.md).

use std::ffi::{c_int, c_void};

/// Sets an option that crate `zmq` does not know.
///
/// # Errors
/// This libzmq does not know it either.
pub fn set<T: Copy>(socket: &mut zmq::Socket, option: u32, value: T) -> Result<(), zmq::Error> {
    // SAFETY: the socket lives, and the option reads one value of this size at the address we pass.
    let rc = unsafe {
        zmq_sys::zmq_setsockopt(
            socket.as_mut_ptr(),
            option as c_int,
            (&raw const value).cast::<c_void>(),
            size_of::<T>(),
        )
    };
    if rc == 0 { Ok(()) } else { Err(zmq::Error::EINVAL) }
}

/// What peers may make libzmq hold.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Frames of one message.
    pub parts: c_int,
    /// Bytes, for all peers of this process.
    pub bytes: i64,
    /// Connections to this process.
    pub connections: c_int,
}

/// Sets the bounds of a socket that is not bound yet; `false`: this libzmq has none.
pub fn apply(socket: &mut zmq::Socket, bounds: Bounds) -> bool {
    set(socket, zmq_sys::RODGYM_MAX_PARTS, bounds.parts).is_ok()
        && set(socket, zmq_sys::RODGYM_BYTES, bounds.bytes).is_ok()
        && set(socket, zmq_sys::RODGYM_CONNECTIONS, bounds.connections).is_ok()
}

/// Whether this libzmq is ours.
pub fn available(context: &zmq::Context) -> bool {
    let socket = context.socket(zmq::ROUTER);
    socket.is_ok_and(|mut socket| set(&mut socket, zmq_sys::RODGYM_MAX_PARTS, 1 as c_int).is_ok())
}
