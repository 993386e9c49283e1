//! The second, local port: health, metrics, and the live page when it is asked for.

use crate::error::CODES;
use crate::live::Live;
use crate::metrics::Steps;
use crate::shared::Shared;
use serde_json::{Map, Value, json};
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Requests at a time; beyond that the one that has taken longest is given up for the new one.
const REQUESTS: usize = 64;
/// Pages that watch at a time.
const PAGES: usize = 16;
/// Longest request head \[bytes\].
const HEAD: usize = 8192;
/// Longest time that a request may take, but for a page that watches.
const PATIENCE: Duration = Duration::from_secs(2);
const PAGE: &str = include_str!("live.html");

/// What the port shows.
pub struct Http {
    /// Counters and the draining flag.
    pub shared: Arc<Shared>,
    /// Set once the front is bound.
    pub ready: Arc<AtomicBool>,
    /// Pictures, where the live page is on.
    pub live: Option<Arc<Live>>,
}

impl Http {
    /// Binds and serves on a thread of its own, which lives as long as the process.
    ///
    /// # Errors
    /// An address that is not of this machine's loopback, or is taken: a sentence.
    pub fn start(self, address: SocketAddr) -> Result<SocketAddr, String> {
        if !address.ip().is_loopback() {
            return Err(format!("--http {address} is refused: metrics are for this machine only"));
        }
        let listener = TcpListener::bind(address).map_err(|e| format!("--http {address}: {e}"))?;
        let bound = listener.local_addr().map_err(|e| e.to_string())?;
        let (http, open) = (Arc::new(self), Arc::new(Open::default()));
        let accept = move || {
            for stream in listener.incoming().flatten() {
                let Some(number) = open.enter(&stream) else { continue };
                let (http, leaving) = (http.clone(), open.clone());
                let answer = move || {
                    // The peer went away: nobody is left to be told.
                    let _ = http.answer(stream, &leaving, number);
                    leaving.leave(number);
                };
                if std::thread::Builder::new().name("http".into()).spawn(answer).is_err() {
                    open.leave(number);
                }
            }
        };
        let thread = std::thread::Builder::new().name("http-accept".into()).spawn(accept);
        thread.map(|_| bound).map_err(|e| e.to_string())
    }

    fn answer(&self, mut stream: TcpStream, open: &Open, number: u64) -> std::io::Result<()> {
        stream.set_write_timeout(Some(PATIENCE))?;
        let Some(text) = read_head(&mut stream)? else {
            let status = "431 Request Header Fields Too Large";
            reply(&mut stream, status, "text/plain", "the head is too long\n")?;
            // What is unread at the close would take the answer with it.
            stream.shutdown(std::net::Shutdown::Write)?;
            return std::io::copy(&mut stream.take(64 << 10), &mut std::io::sink()).map(|_| ());
        };
        let mut lines = text.lines();
        let first = lines.next().unwrap_or("");
        // A page of another site must not read this one under a name of its own.
        let hosts = lines.filter_map(|line| {
            let (name, value) = line.split_once(':')?;
            name.trim().eq_ignore_ascii_case("host").then_some(value.trim())
        });
        let local = hosts.into_iter().all(is_local);
        let mut words = first.split_whitespace();
        let (method, path) = (words.next().unwrap_or(""), words.next().unwrap_or(""));
        if !local {
            return reply(
                &mut stream,
                "403 Forbidden",
                "text/plain",
                "this port has local names only\n",
            );
        }
        if method != "GET" {
            return reply(&mut stream, "405 Method Not Allowed", "text/plain", "GET only\n");
        }
        let draining = self.shared.draining.load(Relaxed);
        match (path, &self.live) {
            ("/healthz", _) => reply(&mut stream, "200 OK", "text/plain", "ok\n"),
            ("/readyz", _) if self.ready.load(Relaxed) && !draining => {
                reply(&mut stream, "200 OK", "text/plain", "ready\n")
            }
            ("/readyz", _) => {
                reply(&mut stream, "503 Service Unavailable", "text/plain", "not ready\n")
            }
            ("/metrics", _) => {
                let text = self.shared.metrics.prometheus();
                reply(&mut stream, "200 OK", "text/plain; version=0.0.4", &text)
            }
            ("/" | "/live", Some(_)) => {
                reply(&mut stream, "200 OK", "text/html; charset=utf-8", PAGE)
            }
            ("/events", Some(live)) => {
                open.leave(number);
                match open.page() {
                    Some(_page) => self.events(&mut stream, live),
                    None => {
                        let text = "too many pages watch\n";
                        reply(&mut stream, "503 Service Unavailable", "text/plain", text)
                    }
                }
            }
            _ => reply(&mut stream, "404 Not Found", "text/plain", "not found\n"),
        }
    }

    /// Server-sent events until the page is closed or the server stops.
    fn events(&self, stream: &mut TcpStream, live: &Live) -> std::io::Result<()> {
        stream.write_all(head("200 OK", "text/event-stream", None).as_bytes())?;
        let _watcher = live.watch();
        let mut last: Option<(Instant, Steps)> = None;
        while !self.shared.draining.load(Relaxed) {
            let m = &self.shared.metrics;
            let (now, steps) = (Instant::now(), m.steps());
            let growth = last.map(|(then, before)| (now - then, steps - before));
            last = Some((now, steps));
            let refused: Map<String, Value> = CODES
                .iter()
                .map(|code| (code.word().into(), m.errors(*code)))
                .filter(|(_, count)| *count > 0)
                .map(|(word, count)| (word, count.into()))
                .collect();
            let data = json!({
                "sessions": m.sessions.load(Relaxed),
                "env_steps": steps.env_steps,
                "rate": growth.map(|(time, new)| new.env_steps as f64 / time.as_secs_f64()),
                // Mean of the batches that stepped since the last event.
                "step_seconds": growth.and_then(|(_, new)| new.mean_seconds()),
                "errors": CODES.iter().map(|code| m.errors(*code)).sum::<u64>(),
                "refused": refused,
                "replayed": m.replayed.load(Relaxed),
                "shown": live.sessions(),
            });
            write!(stream, "data: {data}\n\n")?;
            stream.flush()?;
            std::thread::sleep(Live::INTERVAL);
        }
        Ok(())
    }
}

/// The request's head, up to its empty line; `None` if it is too long.
fn read_head(stream: &mut TcpStream) -> std::io::Result<Option<String>> {
    let end = Instant::now() + PATIENCE;
    let mut head = Vec::new();
    loop {
        if head.windows(4).any(|w| w == b"\r\n\r\n") || head.windows(2).any(|w| w == b"\n\n") {
            return Ok(Some(String::from_utf8_lossy(&head).into_owned()));
        }
        if head.len() >= HEAD {
            return Ok(None);
        }
        // One time for all of it: a byte now and then does not prolong it.
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(std::io::ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(left))?;
        let mut part = [0; 1024];
        match stream.read(&mut part)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            n => head.extend_from_slice(&part[..n]),
        }
    }
}

/// Connections that are served now.
#[derive(Default)]
struct Open {
    requests: Mutex<VecDeque<(u64, TcpStream)>>,
    last: AtomicU64,
    pages: AtomicUsize,
}

impl Open {
    /// A new request; where there are too many, the oldest is cut off.
    fn enter(&self, stream: &TcpStream) -> Option<u64> {
        let handle = stream.try_clone().ok()?;
        let number = self.last.fetch_add(1, Relaxed);
        let mut requests = self.requests.lock().expect("no panic while held");
        if requests.len() >= REQUESTS
            && let Some((_, oldest)) = requests.pop_front()
        {
            let _ = oldest.shutdown(std::net::Shutdown::Both);
        }
        requests.push_back((number, handle));
        Some(number)
    }

    fn leave(&self, number: u64) {
        let mut requests = self.requests.lock().expect("no panic while held");
        requests.retain(|(known, _)| *known != number);
    }

    /// A place for a page that watches.
    fn page(&self) -> Option<Page<'_>> {
        let page = Page(&self.pages);
        (self.pages.fetch_add(1, Relaxed) < PAGES).then_some(page)
    }
}

struct Page<'a>(&'a AtomicUsize);

impl Drop for Page<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Relaxed);
    }
}

/// Names and addresses of this machine, with any port.
fn is_local(host: &str) -> bool {
    let name = if host.starts_with('[') {
        host.split_inclusive(']').next().unwrap_or("")
    } else {
        host.split(':').next().unwrap_or("")
    };
    ["localhost", "127.0.0.1", "[::1]"].contains(&name)
}

fn head(status: &str, kind: &str, length: Option<usize>) -> String {
    let length = length.map(|n| format!("Content-Length: {n}\r\n")).unwrap_or_default();
    format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\n{length}Connection: close\r\n\
         Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n\
         Content-Security-Policy: default-src 'none'; connect-src 'self'; \
         script-src 'unsafe-inline'; style-src 'unsafe-inline'; frame-ancestors 'none'\r\n\r\n"
    )
}

fn reply(stream: &mut TcpStream, status: &str, kind: &str, body: &str) -> std::io::Result<()> {
    stream.write_all(head(status, kind, Some(body.len())).as_bytes())?;
    stream.write_all(body.as_bytes())
}
