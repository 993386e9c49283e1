//! Who may come in: the ZeroMQ authentication protocol (RFC 27), answered from the key directory at
//! every handshake.

use super::keys;
use super::rate::Rate;
use crate::metrics::Metrics;
use crate::shared::Shared;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::thread::JoinHandle;
use std::time::Instant;
use tracing::{info, warn};

/// The address that libzmq asks.
const ADDRESS: &str = "inproc://zeromq.zap.01";
/// Name of our security domain; libzmq only asks when there is one.
pub const DOMAIN: &str = "rodgym";

/// Binds the handler and starts its thread; it ends with the context. Must come before the front
/// binds, since libzmq would not ask a handler that is not there.
///
/// # Errors
/// The address is taken.
pub fn start(
    context: &zmq::Context,
    directory: PathBuf,
    shared: Arc<Shared>,
) -> Result<JoinHandle<()>, zmq::Error> {
    let socket = context.socket(zmq::REP)?;
    socket.set_linger(0)?;
    socket.bind(ADDRESS)?;
    let work = move || {
        let rates = Rates::default();
        while let Ok(request) = socket.recv_multipart(0) {
            let reply = answer(&request, &directory, &shared.metrics, &rates);
            if socket.send_multipart(reply, 0).is_err() {
                return;
            }
        }
    };
    Ok(std::thread::Builder::new().name("zap".into()).spawn(work).expect("a thread can be made"))
}

/// Strangers choose how often these lines come.
#[derive(Debug, Default)]
struct Rates {
    admitted: Rate,
    denied: Rate,
    ignored: Rate,
}

/// One decision. Frames: version, request, domain, address, identity, mechanism, credentials.
fn answer(request: &[Vec<u8>], directory: &Path, metrics: &Metrics, rates: &Rates) -> Vec<Vec<u8>> {
    let number = request.get(1).cloned().unwrap_or_default();
    let address =
        request.get(3).map(|a| String::from_utf8_lossy(a).into_owned()).unwrap_or_default();
    // Whatever goes wrong in here denies.
    let decision = catch_unwind(AssertUnwindSafe(|| decide(request, directory, rates)))
        .unwrap_or_else(|_| Err("the handler failed".into()));
    let (status, text, user) = match decision {
        Ok((name, key)) => {
            if let Some(left_out) = rates.admitted.line(Instant::now()) {
                info!(user = name, address, left_out, "admitted");
            }
            // The key goes along: a connection made with a replaced key can be told apart.
            ("200", "OK", format!("{name}/{key}"))
        }
        Err(reason) => {
            metrics.denied.fetch_add(1, Relaxed);
            if let Some(left_out) = rates.denied.line(Instant::now()) {
                warn!(address, reason, left_out, "handshake denied");
            }
            ("400", "denied", String::new())
        }
    };
    [b"1.0".to_vec(), number, status.into(), text.into(), user.into_bytes(), vec![]].into()
}

fn decide(
    request: &[Vec<u8>],
    directory: &Path,
    rates: &Rates,
) -> Result<(String, String), String> {
    let [version, _, domain, _, _, mechanism, credentials] = request else {
        return Err(format!("the request has {} frames instead of 7", request.len()));
    };
    if version != b"1.0" || domain != DOMAIN.as_bytes() || mechanism != b"CURVE" {
        return Err("only CURVE in our own domain is accepted".into());
    }
    let key = zmq::z85_encode(credentials).map_err(|e| e.to_string())?;
    let (users, problems) = keys::authorized(directory);
    for problem in problems {
        if let Some(left_out) = rates.ignored.line(Instant::now()) {
            warn!(problem, left_out, "a key file is ignored");
        }
    }
    match users.into_iter().find(|(_, user)| user.public == key) {
        Some((name, _)) => Ok((name, key)),
        None => Err(format!("key {key} is not in {}", directory.join("authorized").display())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Status and user of a request's answer. There is no such directory, so nobody is authorized.
    fn ask(frames: &[&[u8]]) -> (Vec<u8>, Vec<u8>) {
        let request: Vec<Vec<u8>> = frames.iter().map(|f| f.to_vec()).collect();
        let metrics = Metrics::default();
        let reply = answer(&request, Path::new("/nonexistent/rodgym"), &metrics, &Rates::default());
        assert_eq!(reply.len(), 6, "version, number, status, text, user, metadata");
        assert_eq!(metrics.denied.load(Relaxed), 1);
        (reply[2].clone(), reply[4].clone())
    }

    #[test]
    fn whatever_is_wrong_with_a_request_denies() {
        let key = [7u8; 32];
        let good: [&[u8]; 7] = [b"1.0", b"1", b"rodgym", b"127.0.0.1", b"", b"CURVE", &key];
        let with = |place: usize, other: &'static [u8]| {
            let mut frames = good;
            frames[place] = other;
            ask(&frames)
        };
        let denied = (b"400".to_vec(), vec![]);
        assert_eq!(ask(&good), denied, "an unreadable directory");
        assert_eq!(ask(&[]), denied);
        assert_eq!(ask(&good[..6]), denied);
        assert_eq!(with(0, b"2.0"), denied);
        assert_eq!(with(2, b"global"), denied, "another domain");
        assert_eq!(with(5, b"NULL"), denied, "no encryption");
        assert_eq!(with(6, b"not 32 bytes"), denied);
    }
}
