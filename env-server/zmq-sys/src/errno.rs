//! Error numbers: those of the platform, and libzmq's own above `ZMQ_HAUSNUMERO`.

use std::ffi::c_int;

pub use libc::{
    EACCES, EADDRINUSE, EADDRNOTAVAIL, EAGAIN, EBUSY, ECONNREFUSED, EFAULT, EHOSTUNREACH,
    EINPROGRESS, EINTR, EINVAL, EMFILE, EMSGSIZE, ENAMETOOLONG, ENETDOWN, ENOBUFS, ENODEV, ENOENT,
    ENOMEM, ENOTCONN, ENOTSOCK, ENOTSUP, EPROTO, EPROTONOSUPPORT,
};

const ZMQ_HAUSNUMERO: c_int = 156_384_712;

// What libzmq returns where a platform lacks the number of that name.
pub const ENOTSUP_ALT: c_int = ZMQ_HAUSNUMERO + 1;
pub const EPROTONOSUPPORT_ALT: c_int = ZMQ_HAUSNUMERO + 2;
pub const ENOBUFS_ALT: c_int = ZMQ_HAUSNUMERO + 3;
pub const ENETDOWN_ALT: c_int = ZMQ_HAUSNUMERO + 4;
pub const EADDRINUSE_ALT: c_int = ZMQ_HAUSNUMERO + 5;
pub const EADDRNOTAVAIL_ALT: c_int = ZMQ_HAUSNUMERO + 6;
pub const ECONNREFUSED_ALT: c_int = ZMQ_HAUSNUMERO + 7;
pub const EINPROGRESS_ALT: c_int = ZMQ_HAUSNUMERO + 8;
pub const ENOTSOCK_ALT: c_int = ZMQ_HAUSNUMERO + 9;
pub const EMSGSIZE_ALT: c_int = ZMQ_HAUSNUMERO + 10;
pub const EAFNOSUPPORT_ALT: c_int = ZMQ_HAUSNUMERO + 11;
pub const ENETUNREACH_ALT: c_int = ZMQ_HAUSNUMERO + 12;
pub const ECONNABORTED_ALT: c_int = ZMQ_HAUSNUMERO + 13;
pub const ECONNRESET_ALT: c_int = ZMQ_HAUSNUMERO + 14;
pub const ENOTCONN_ALT: c_int = ZMQ_HAUSNUMERO + 15;
pub const ETIMEDOUT_ALT: c_int = ZMQ_HAUSNUMERO + 16;
pub const EHOSTUNREACH_ALT: c_int = ZMQ_HAUSNUMERO + 17;
pub const ENETRESET_ALT: c_int = ZMQ_HAUSNUMERO + 18;

// libzmq only.
pub const EFSM: c_int = ZMQ_HAUSNUMERO + 51;
pub const ENOCOMPATPROTO: c_int = ZMQ_HAUSNUMERO + 52;
pub const ETERM: c_int = ZMQ_HAUSNUMERO + 53;
pub const EMTHREAD: c_int = ZMQ_HAUSNUMERO + 54;
