//! The server over ZeroMQ: bind, authenticate, serve, stop.

pub mod cli;
pub mod guard;
pub mod http;
pub mod keys;
mod rate;
pub mod router;
pub mod signals;
pub mod zap;

use crate::limits::{HIGH_WATER_MARK, Limits};
use crate::live::Live;
use crate::memory::half_of_the_machine;
use crate::run::{Allowed, End, Setup, run};
use crate::server::Server;
use crate::shared::Shared;
use http::Http;
use router::{Identify, Router, Security};
use std::collections::HashMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, RwLock};
use std::time::{Duration, Instant};
use tracing::{info, warn};

/// Time between looks at the key directory; a removed key is out within twice this and a tick.
const KEYS_EVERY: Duration = Duration::from_secs(1);

/// How to serve.
#[derive(Clone, Debug)]
pub struct Config {
    /// `tcp://ADDRESS:PORT` (port 0: a free one) or `ipc://PATH`.
    pub bind: String,
    /// Directory with `secret.key` and `authorized/`; `None`: no encryption, nobody is asked.
    pub keys: Option<PathBuf>,
    /// Serve strangers without keys.
    pub insecure_no_auth: bool,
    /// What is granted.
    pub limits: Limits,
    /// Threads for long work; `None`: one a core but one, at least two.
    pub workers: Option<u8>,
    /// Bytes that the whole server may take; `None`: half of what the machine or its cgroup has.
    pub memory: Option<u64>,
    /// Local port for metrics and health.
    pub http: Option<SocketAddr>,
    /// Show the live page there.
    pub live: bool,
}

impl Default for Config {
    fn default() -> Self {
        Config {
            bind: "tcp://127.0.0.1:5555".into(),
            keys: None,
            insecure_no_auth: false,
            limits: Limits { threads: cores().min(THREADS), ..Limits::default() },
            workers: None,
            memory: None,
            http: None,
            live: false,
        }
    }
}

/// Users by name with their keys, as the key directory has them now.
type Users = Arc<RwLock<HashMap<String, keys::User>>>;

/// Serves until SIGTERM or SIGINT. `bound` is told the real address, and that of the local port.
///
/// # Errors
/// What keeps the server from starting, or breaks it: a sentence.
pub fn serve(config: &Config, bound: impl FnOnce(&str, Option<SocketAddr>)) -> Result<(), String> {
    if config.limits.window > HIGH_WATER_MARK as usize / 2 {
        let most = HIGH_WATER_MARK / 2;
        return Err(format!("a window of {} is refused: at most {most}", config.limits.window));
    }
    if config.keys.is_none() && !config.insecure_no_auth && !is_local(&config.bind) {
        return Err(format!(
            "{} can be reached from other machines, and no keys are configured. Make keys with \
             'rodgym-server keygen DIR', put users' public keys into DIR/authorized/NAME.key and \
             serve with --keys DIR; or allow everybody with --insecure-no-auth",
            config.bind
        ));
    }
    if config.live && config.http.is_none() {
        return Err("--live needs --http ADDRESS:PORT".into());
    }
    let signals = signals::Signals::take();
    let mut limits = config.limits.clone();
    limits.share_memory(config.memory.unwrap_or_else(half_of_the_machine), config.keys.is_some());
    limits.connections = descriptors(limits.connections);
    let shared = Arc::new(Shared::new(limits, random_hex(8)));
    let mut context = zmq::Context::new();
    if !guard::available(&context) {
        if !is_local(&config.bind) {
            return Err(format!(
                "{} can be reached from other machines, and this libzmq lacks our patches: whoever \
                 connects could end the server. Build it with env-server/zmq-sys, or serve this \
                 machine only",
                config.bind
            ));
        }
        warn!("this libzmq lacks our patches: any program of this machine can end the server");
    }
    let users = Users::default();
    let security = match &config.keys {
        None => Security::Open,
        Some(directory) => {
            if zmq::has("curve") != Some(true) {
                return Err("this libzmq has no CURVE".into());
            }
            let pair = keys::load(directory)?;
            refresh(directory, &users, &shared);
            zap::start(&context, directory.clone(), shared.clone())
                .map_err(|e| format!("the authentication handler cannot be bound: {e}"))?;
            Security::Curve(pair.secret)
        }
    };
    let ready = Arc::new(AtomicBool::new(false));
    let live = Arc::new(Live::default());
    let http = config.http.map(|address| {
        let live = config.live.then(|| live.clone());
        Http { shared: shared.clone(), ready: ready.clone(), live }.start(address)
    });
    let http = http.transpose()?;
    let with_keys = config.keys.is_some();
    let mut router = Router::bind(
        &context,
        &config.bind,
        &security,
        &shared.limits,
        identify(users.clone(), with_keys),
    )
    .map_err(|e| format!("{} cannot be bound: {e}", config.bind))?;
    info!(endpoint = router.endpoint(), curve = with_keys, epoch = shared.epoch, "serving");
    bound(router.endpoint(), http);
    ready.store(true, Relaxed);

    let stop = watch(config, users.clone(), shared.clone());
    let allowed: Allowed =
        Arc::new(move |user| !with_keys || users.read().expect("no panic").contains_key(user));
    let server = Server::new(shared.clone(), Box::new(random_id));
    let (workers, long) = threads(config.workers);
    let setup = Setup { shared: shared.clone(), server, workers, long, allowed, live, stop };
    let outcome = run(&mut router, setup).map_err(|e| e.to_string());
    info!("stopped");
    // The signals come back first: closing may wait for unsent replies (500 ms).
    drop((signals, router));
    if outcome == Ok(End::Drained) {
        // Without this the process could end before they are out: the threads of workers and of
        // authentication hold the context too, and end with it.
        let _ = context.destroy();
    }
    outcome.map(|_| ())
}

/// Threads of one step, at most, where nobody says otherwise.
const THREADS: usize = 4;

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Threads for long work, and what is long. Where there are cores to spare, it pays to hand over what
/// takes a few times the handing over; on few cores only what others would notice.
fn threads(asked: Option<u8>) -> (usize, Duration) {
    let cores = cores();
    let workers = asked.map_or((cores - 1).clamp(2, 64), |n| usize::from(n).clamp(1, 64));
    let long = if cores >= 4 { Duration::from_micros(200) } else { Duration::from_millis(4) };
    (workers, long)
}

/// Descriptors that are not for connections: key files, the local port, libzmq's own.
#[cfg(unix)]
const RESERVED: u64 = 64;

/// Allows as many descriptors as the system grants, and as many connections as fit beside the others.
#[cfg(unix)]
fn descriptors(wanted: usize) -> usize {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: both calls read or write the struct that we pass.
    let granted = unsafe {
        if libc::getrlimit(libc::RLIMIT_NOFILE, &raw mut limit) != 0 {
            return wanted;
        }
        let raised = libc::rlimit {
            rlim_cur: limit.rlim_max.min(wanted as libc::rlim_t + RESERVED as libc::rlim_t),
            rlim_max: limit.rlim_max,
        };
        if raised.rlim_cur > limit.rlim_cur
            && libc::setrlimit(libc::RLIMIT_NOFILE, &raw const raised) == 0
        {
            raised.rlim_cur
        } else {
            limit.rlim_cur
        }
    };
    let room = granted.saturating_sub(RESERVED).max(1);
    wanted.min(usize::try_from(room).unwrap_or(usize::MAX))
}

#[cfg(not(unix))]
fn descriptors(wanted: usize) -> usize {
    wanted
}

/// What the loop asks between requests: looks at the keys now and then, and at signals.
fn watch(config: &Config, users: Users, shared: Arc<Shared>) -> Box<dyn Fn() -> bool> {
    let directory = config.keys.clone();
    let warn_open = config.insecure_no_auth && directory.is_none() && !is_local(&config.bind);
    let keys_due = std::cell::Cell::new(Instant::now());
    let warning_due = std::cell::Cell::new(Instant::now());
    Box::new(move || {
        let now = Instant::now();
        if let Some(directory) = &directory
            && now >= keys_due.get()
        {
            keys_due.set(now + KEYS_EVERY);
            refresh(directory, &users, &shared);
        }
        if warn_open && now >= warning_due.get() {
            warning_due.set(now + Duration::from_secs(60));
            warn!("everybody who reaches this address may use it (--insecure-no-auth)");
        }
        signals::stop_requested()
    })
}

fn refresh(directory: &std::path::Path, users: &Users, shared: &Shared) {
    let (found, _) = keys::authorized(directory);
    let limits = found.iter().map(|(name, user)| (name.clone(), user.limits)).collect();
    *shared.users.write().expect("no panic while held") = limits;
    *users.write().expect("no panic while held") = found;
}

/// `NAME/KEY` of a connection to NAME, while that is still NAME's key.
fn identify(users: Users, with_keys: bool) -> Identify {
    Box::new(move |id| {
        if !with_keys {
            return Some("local".into());
        }
        let (name, key) = id?.split_once('/')?;
        let users = users.read().expect("no panic while held");
        users.get(name).filter(|user| user.public == key).map(|_| name.to_string())
    })
}

/// Addresses that only this machine reaches.
fn is_local(endpoint: &str) -> bool {
    if endpoint.starts_with("ipc://") {
        return true;
    }
    let Some(rest) = endpoint.strip_prefix("tcp://") else { return false };
    let host = rest.rsplit_once(':').map_or(rest, |(host, _)| host);
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

fn random_id() -> u128 {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).expect("the operating system gives random bytes");
    u128::from_ne_bytes(bytes)
}

fn random_hex(bytes: usize) -> String {
    format!("{:032x}", random_id())[..2 * bytes].into()
}
