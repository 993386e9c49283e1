//! Any bytes on a real socket, at any point of ZMTP's handshake and behind it: nothing aborts, and a
//! bystander on the same socket is heard.
//!
//! Input: one byte that says how far the handshake is done properly, then what the peer sends.

#![no_main]

use libfuzzer_sys::fuzz_target;
use rodgym_server::limits::Limits;
use rodgym_server::net::router::{Router, Security};
use rodgym_server::transport::Transport;
use std::cell::RefCell;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration;

const READY: &[u8] = b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x06DEALER";

struct Port {
    front: Router,
    bystander: zmq::Socket,
    runs: u64,
}

thread_local! {
    static PORT: RefCell<Port> = RefCell::new(Port::open());
}

impl Port {
    fn open() -> Self {
        let context = zmq::Context::new();
        let anybody = Box::new(|_: Option<&str>| Some("anybody".to_string()));
        let limits = Limits { message_bytes: 1 << 20, ..Limits::default() };
        // A socket in the file system: runs would use up the ports of this machine.
        let path = std::env::temp_dir().join(format!("rodgym-fuzz-{}", std::process::id()));
        let address = format!("ipc://{}", path.display());
        let front = Router::bind(&context, &address, &Security::Open, &limits, anybody)
            .expect("a free address");
        let bystander = context.socket(zmq::DEALER).expect("a socket");
        bystander.connect(front.endpoint()).expect("an address");
        Port { front, bystander, runs: 0 }
    }
}

fn greeting() -> Vec<u8> {
    let mut bytes = vec![0xff, 0, 0, 0, 0, 0, 0, 0, 0, 0x7f, 3, 1];
    bytes.extend(b"NULL");
    bytes.resize(64, 0);
    bytes
}

fuzz_target!(|bytes: &[u8]| PORT.with_borrow_mut(|port| run(port, bytes)));

fn run(port: &mut Port, bytes: &[u8]) {
    let Some((stage, bytes)) = bytes.split_first() else { return };
    let address = port.front.endpoint().trim_start_matches("ipc://").to_string();
    let mut peer = UnixStream::connect(address).expect("it listens");
    peer.set_read_timeout(Some(Duration::from_millis(200))).expect("an option");
    let _ = peer.write_all(&match stage % 4 {
        0 => vec![],
        1 => greeting(),
        _ => [&greeting()[..], READY].concat(),
    });
    if stage % 4 == 3 {
        // Behind the server's own greeting and READY, messages may come.
        let _ = peer.read_exact(&mut [0; 64 + 2 + 41]);
    }
    let _ = peer.write_all(bytes);
    let _ = peer.shutdown(std::net::Shutdown::Write);
    let _ = peer.read(&mut [0; 256]);
    port.runs += 1;
    let text = port.runs.to_le_bytes();
    port.bystander.send(&text[..], 0).expect("room in the queue");
    loop {
        let request = port.front.receive(Duration::from_secs(10)).expect("it works");
        let request = request.expect("the bystander is heard");
        if request.frames == [text] {
            break;
        }
    }
}
