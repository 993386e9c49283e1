//! Builds libzmq against the libsodium of `libsodium-sys-stable`.
//!
//! The registry's zmq-sys passes no libsodium, which silently leaves CURVE out of the library.

use std::env;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    // `links = "sodium"` hands its directories over in these two variables.
    let directory = |name: &str| {
        env::var(name).unwrap_or_else(|_| panic!("libsodium-sys-stable did not set {name}"))
    };
    // The C++ compiler's remarks about foreign code are not our users' to read.
    let flags = env::var("CXXFLAGS").unwrap_or_default();
    // SAFETY: this build script has one thread here.
    unsafe { env::set_var("CXXFLAGS", format!("{flags} -w")) };
    let sodium =
        zeromq_src::LibLocation::new(directory("DEP_SODIUM_LIB"), directory("DEP_SODIUM_INCLUDE"));
    zeromq_src::Build::new().with_libsodium(Some(sodium)).build();
}
