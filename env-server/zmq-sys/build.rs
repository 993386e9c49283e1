//! Builds libzmq 4.3.5 from the archive in `libzmq/` with our patches, against the libsodium of
//! `libsodium-sys-stable`. README.md says what the patches do and why.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};

const ARCHIVE: &str = "libzmq/libzmq-4.3.5.tar.gz";
const PATCHES: [&str; 2] = ["libzmq/0001-claimed-routing-ids.patch", "libzmq/0002-bounds.patch"];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=libzmq");
    let out = PathBuf::from(variable("OUT_DIR"));
    let source = unpack(&out);
    for name in PATCHES {
        patch(&source, name);
    }
    compile(&source, &out);
}

fn variable(name: &str) -> String {
    env::var(name).unwrap_or_else(|_| panic!("{name} is not set"))
}

/// Unpacks the archive anew: a source that was patched already cannot be patched again.
fn unpack(out: &Path) -> PathBuf {
    let source = out.join("libzmq-4.3.5");
    if source.exists() {
        fs::remove_dir_all(&source).expect("the last build's source can be removed");
    }
    let archive = fs::File::open(ARCHIVE).expect("the archive is part of this crate");
    let archive = flate2::read::GzDecoder::new(archive);
    tar::Archive::new(archive).unpack(out).expect("the archive can be unpacked");
    source
}

/// Applies a unified diff. A hunk that does not fit ends the build: a libzmq without its guards must
/// not pass for one with them.
fn patch(source: &Path, name: &str) {
    let text = fs::read_to_string(name).unwrap_or_else(|e| panic!("{name}: {e}"));
    let mut starts: Vec<usize> = text.match_indices("--- a/").map(|(at, _)| at).collect();
    starts.push(text.len());
    for part in starts.windows(2) {
        let one = diffy::Patch::from_str(&text[part[0]..part[1]])
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let file = one.modified().and_then(|f| f.strip_prefix("b/")).expect("a file of b/");
        let path = source.join(file);
        let before = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{file}: {e}"));
        let after = diffy::apply(&before, &one).unwrap_or_else(|e| panic!("{name}, {file}: {e}"));
        fs::write(&path, after).unwrap_or_else(|e| panic!("{file}: {e}"));
    }
}

fn glibc_has_strlcpy() -> bool {
    let text = cc::Build::new().file("libzmq/strlcpy.c").cargo_metadata(false).try_expand();
    text.is_ok_and(|text| String::from_utf8_lossy(&text).contains("HAS_STRLCPY"))
}

fn compile(source: &Path, out: &Path) {
    let target = variable("TARGET");
    let (windows, msvc) = (target.contains("windows"), target.contains("msvc"));
    let linux = target.contains("linux");
    let mut build = cc::Build::new();
    // The compiler's remarks about foreign code are not our users' to read.
    build.cpp(true).warnings(false).flag_if_supported("-w").out_dir(out.join("lib"));
    if !msvc {
        build.std("c++11");
    }
    build.include(source.join("include")).include(source.join("src")).include("libzmq");
    let mut files: Vec<PathBuf> = fs::read_dir(source.join("src"))
        .expect("it was just unpacked")
        .map(|entry| entry.expect("it can be listed").path())
        .filter(|path| path.extension().is_some_and(|e| e == "cpp"))
        // WebSockets: nobody here speaks them.
        .filter(|path| !path.file_name().is_some_and(|n| n.to_string_lossy().starts_with("ws")))
        .collect();
    files.sort();
    build.files(files).file("libzmq/budget.cpp");

    let mut define = |names: &[&str]| {
        for name in names {
            build.define(name, "1");
        }
    };
    define(&["ZMQ_STATIC", "ZMQ_USE_CV_IMPL_STL11", "ZMQ_USE_LIBSODIUM", "ZMQ_HAVE_CURVE"]);
    define(&["ZMQ_POLL_BASED_ON_POLL", "ZMQ_HAVE_STRUCT_SOCKADDR_UN"]);
    if windows {
        define(&["ZMQ_HAVE_WINDOWS", "ZMQ_IOTHREAD_POLLER_USE_EPOLL"]);
        build.define("_WIN32_WINNT", "0x0600");
        println!("cargo:rustc-link-lib=iphlpapi");
    } else {
        define(&["HAVE_STRNLEN", "ZMQ_HAVE_UIO", "ZMQ_HAVE_IPC"]);
        if linux {
            define(&["ZMQ_HAVE_LINUX", "ZMQ_IOTHREAD_POLLER_USE_EPOLL"]);
            // Peers of ipc:// are known to the system, and descriptors do not pass to children.
            define(&["ZMQ_HAVE_SO_PEERCRED", "ZMQ_HAVE_SOCK_CLOEXEC"]);
        } else {
            define(&["ZMQ_IOTHREAD_POLLER_USE_KQUEUE", "ZMQ_HAVE_STRLCPY"]);
        }
        if target.contains("musl") || target.contains("android") || glibc_has_strlcpy() {
            define(&["ZMQ_HAVE_STRLCPY"]);
        }
    }
    if msvc {
        build.include(source.join("builds/deprecated-msvc"));
        build.flag("/GL-").flag("/EHsc");
    } else {
        // What configure would have found is given above instead.
        fs::write(out.join("platform.hpp"), "").expect("the build directory can be written");
        build.include(out);
    }
    if msvc {
        let mut epoll = cc::Build::new();
        epoll.warnings(false).file(source.join("external/wepoll/wepoll.c")).compile("wepoll");
    }
    // `links = "sodium"` hands its directories over in these two variables.
    build.include(variable("DEP_SODIUM_INCLUDE"));
    build.compile("zmq");
    println!("cargo:rustc-link-search=native={}", variable("DEP_SODIUM_LIB"));
    let sodium = if msvc { "libsodium" } else { "sodium" };
    println!("cargo:rustc-link-lib=static={sodium}");
}
