//! The program itself in a process of its own, and peers that speak ZMTP by hand.
#![allow(dead_code, reason = "each test file uses its part")]

use rodgym_server::wire::{self, ReplyHeader, RequestHeader};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A running server, killed when dropped.
pub struct Served {
    pub child: Child,
    /// `tcp://127.0.0.1:PORT`.
    pub address: String,
    /// `127.0.0.1:PORT` of the local port, with `--http`.
    pub http: String,
    lines: BufReader<std::process::ChildStdout>,
}

impl Served {
    pub fn start(arguments: &[&str]) -> Served {
        Served::command(Command::new(env!("CARGO_BIN_EXE_rodgym-server")), arguments)
    }

    /// With what the command sets beside (a limit of the address space, say).
    pub fn command(mut command: Command, arguments: &[&str]) -> Served {
        let mut child = command
            .args(["--bind", "tcp://127.0.0.1:0", "--log", "error"])
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program can be started");
        let lines = BufReader::new(child.stdout.take().expect("it is piped"));
        let mut served = Served { child, address: String::new(), http: String::new(), lines };
        served.address = served.line("rodgym-server listens at ");
        if arguments.contains(&"--http") {
            let page = served.line("metrics at http://");
            served.http = page.trim_end_matches("/metrics").into();
        }
        served
    }

    /// The next line of its output, without this beginning.
    pub fn line(&mut self, beginning: &str) -> String {
        let mut line = String::new();
        self.lines.read_line(&mut line).expect("text");
        let rest = line.trim_end().strip_prefix(beginning);
        rest.unwrap_or_else(|| panic!("'{line}' instead of '{beginning}'")).into()
    }

    pub fn alive(&mut self) -> bool {
        self.child.try_wait().expect("it is our child").is_none()
    }

    pub fn kill(mut self) -> Option<i32> {
        self.child.kill().expect("it is our child");
        self.child.wait().expect("it is our child").code()
    }

    /// Resident memory [bytes].
    #[cfg(target_os = "linux")]
    pub fn memory(&self) -> u64 {
        let path = format!("/proc/{}/status", self.child.id());
        let text = std::fs::read_to_string(path).expect("it lives");
        let line = text.lines().find(|l| l.starts_with("VmRSS:")).expect("Linux tells");
        line.split_whitespace().nth(1).expect("a number").parse::<u64>().expect("a number") * 1024
    }

    /// A connection without ZeroMQ.
    pub fn raw(&self) -> TcpStream {
        let host = self.address.trim_start_matches("tcp://");
        let stream = TcpStream::connect(host).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_secs(5))).expect("an option");
        stream.set_write_timeout(Some(Duration::from_secs(5))).expect("an option");
        stream
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A greeting of ZMTP 3.0 for this mechanism.
pub fn greeting(mechanism: &str) -> Vec<u8> {
    let mut bytes = vec![0xff, 0, 0, 0, 0, 0, 0, 0, 0, 0x7f, 3, 0];
    bytes.extend(mechanism.bytes());
    bytes.resize(64, 0);
    bytes
}

/// READY with these properties, as a command frame.
pub fn ready(properties: &[(&str, &[u8])]) -> Vec<u8> {
    let mut body = b"\x05READY".to_vec();
    for (name, value) in properties {
        body.push(name.len() as u8);
        body.extend(name.bytes());
        body.extend((value.len() as u32).to_be_bytes());
        body.extend(*value);
    }
    frame(4, &body)
}

/// A frame: flags 1 more, 4 command; the long form where it is needed.
pub fn frame(flags: u8, body: &[u8]) -> Vec<u8> {
    let mut bytes = if body.len() < 256 {
        vec![flags, body.len() as u8]
    } else {
        let mut head = vec![flags | 2];
        head.extend((body.len() as u64).to_be_bytes());
        head
    };
    bytes.extend(body);
    bytes
}

/// Sends it, and tells whether the other side then hangs up (within 5 s).
pub fn hangs_up(mut stream: TcpStream, bytes: &[u8]) -> bool {
    let _ = stream.write_all(bytes);
    let mut buffer = [0; 4096];
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => return true,
            Ok(_) => {}
            Err(e) => return e.kind() == std::io::ErrorKind::ConnectionReset,
        }
    }
}

/// A header as it travels.
pub fn header(op: &str, sid: Option<&str>, seq: Option<u64>, p: Value) -> RequestHeader {
    let p = p.as_object().expect("parameters are a map").clone();
    RequestHeader { v: 1, op: op.into(), rid: 7, sid: sid.map(Into::into), seq, arr: vec![], p }
}

/// Asks over a ZeroMQ socket; `None`: no answer within `wait`.
pub fn ask(socket: &zmq::Socket, request: &RequestHeader, wait: Duration) -> Option<ReplyHeader> {
    socket.send(wire::encode(request), zmq::DONTWAIT).expect("room in the queue");
    let end = Instant::now() + wait;
    loop {
        let left = end.saturating_duration_since(Instant::now());
        if socket.poll(zmq::POLLIN, left.as_millis() as i64).expect("a socket") == 0 {
            return None;
        }
        let frames = socket.recv_multipart(0).expect("it is there");
        let reply = wire::decode_reply(&frames[0]).expect("a reply");
        if reply.rid == request.rid {
            return Some(reply);
        }
    }
}

/// A client that has connected; `id` is a routing id of its own.
pub fn client(address: &str, id: Option<&[u8]>) -> zmq::Socket {
    let socket = zmq::Context::new().socket(zmq::DEALER).expect("a socket");
    socket.set_linger(0).expect("an option");
    if let Some(id) = id {
        socket.set_identity(id).expect("an option");
    }
    socket.connect(address).expect("an address");
    socket
}

/// Whether a new client is served.
pub fn serves(address: &str) -> bool {
    let socket = client(address, None);
    ask(&socket, &header("ping", None, None, json!({})), Duration::from_secs(5))
        .is_some_and(|reply| reply.ok)
}
