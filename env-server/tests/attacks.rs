//! What has ended, filled or fooled a server of this kind, over a real port: nobody but the attacker
//! notices. docs/remote-proofs.md lists them.
#![cfg(all(feature = "zmq", unix))]

mod served;

use rodgym_server::net::keys;
use rodgym_server::wire;
use serde_json::json;
use served::*;
use std::io::{Read, Write};
use std::path::PathBuf;
use std::time::Duration;

/// The counter from which an unseeded libzmq numbers its peers: what `rand()` gives first.
const FIRST: u32 = 0x6b8b_4567;

/// Ids of the server's own, around those that it will give next.
fn own_ids() -> impl Iterator<Item = [u8; 5]> {
    (0..40u32).map(|i| {
        let [a, b, c, d] = FIRST.wrapping_add(i).to_be_bytes();
        [0, a, b, c, d]
    })
}

#[test]
fn a_peer_that_claims_the_servers_own_ids_ends_nobody_but_itself() {
    let mut server = Served::start(&[]);
    let claims: Vec<zmq::Socket> = own_ids().map(|id| client(&server.address, Some(&id))).collect();
    let ping = header("ping", None, None, json!({}));
    for claim in &claims[..2] {
        let patience = Duration::from_millis(300);
        assert!(ask(claim, &ping, patience).is_none(), "it was let in");
    }
    for _ in 0..50 {
        assert!(serves(&server.address));
    }
    assert!(server.alive());
    // Any other id may be claimed, as protocol.md says (though it advises against it).
    let named = client(&server.address, Some(b"ada"));
    assert!(ask(&named, &ping, Duration::from_secs(5)).is_some());
}

/// The same with keys, where authentication has a socket of its own.
#[test]
fn with_keys_claimed_ids_end_nobody_either() {
    let home = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("claimed-ids");
    let _ = std::fs::remove_dir_all(&home);
    let pair = keys::generate(&home.join("server")).expect("a new directory");
    let mine = keys::generate(&home.join("ada")).expect("a new directory");
    std::fs::copy(home.join("ada/public.key"), home.join("server/authorized/ada.key"))
        .expect("both are there");
    let mut server = Served::start(&["--keys", home.join("server").to_str().expect("text")]);
    let decode = |key: &str| zmq::z85_decode(key).expect("a key of our own");
    let with_keys = |id: Option<&[u8]>| {
        let socket = zmq::Context::new().socket(zmq::DEALER).expect("a socket");
        socket.set_linger(0).expect("an option");
        if let Some(id) = id {
            socket.set_identity(id).expect("an option");
        }
        socket.set_curve_serverkey(&decode(&pair.public)).expect("a key");
        socket.set_curve_publickey(&decode(&mine.public)).expect("a key");
        socket.set_curve_secretkey(&decode(&mine.secret)).expect("a key");
        socket.connect(&server.address).expect("an address");
        socket
    };
    let ping = header("ping", None, None, json!({}));
    let claims: Vec<zmq::Socket> = own_ids().map(|id| with_keys(Some(&id))).collect();
    assert!(ask(&claims[0], &ping, Duration::from_millis(300)).is_none(), "it was let in");
    for _ in 0..20 {
        assert!(ask(&with_keys(None), &ping, Duration::from_secs(5)).is_some_and(|r| r.ok));
    }
    assert!(server.alive());
}

/// A browser sends a form to any port. Read as ZMTP 1.0, "P" would be a frame of 79 bytes, and what a
/// page writes into the body would be requests of this user.
#[test]
fn a_web_pages_post_is_no_request() {
    let mut server = Served::start(&[]);
    let nonce = "ab".repeat(16);
    let p = json!({"id": "rodgym/PendulumBalance-v0", "nonce": nonce});
    let request = wire::encode(&header("make", None, None, p));
    let head = "POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://evil.example\r\n\
                Content-Type: text/plain\r\nContent-Length: 4096\r\n\r\n";
    // Frames of ZMTP 1.0 (length, flags, body), at every offset at which the reader may arrive.
    for shift in 0..90 {
        let mut bytes = head.as_bytes().to_vec();
        bytes.extend(vec![1u8; shift]);
        for _ in 0..4 {
            bytes.push(request.len() as u8 + 1);
            bytes.push(0);
            bytes.extend(&request);
        }
        assert!(hangs_up(server.raw(), &bytes), "shift {shift}");
    }
    let asker = client(&server.address, None);
    let stats = ask(&asker, &header("stats", None, None, json!({})), Duration::from_secs(5));
    assert_eq!(stats.expect("it is served").p["sessions"], 0);
    assert!(server.alive());
}

#[test]
fn older_protocols_are_hung_up_on() {
    let server = Served::start(&[]);
    // ZMTP 1.0 without a revision: a routing id of no bytes, then a message.
    assert!(hangs_up(server.raw(), b"\x01\x00\x05\x00ping"));
    // Revisions 1.0 (0) and 2.0 (1) behind a signature; 5 is a DEALER.
    for revision in [0, 1] {
        let mut bytes = vec![0xff, 0, 0, 0, 0, 0, 0, 0, 1, 0x7f, revision, 5, 0, 0];
        bytes.extend(frame(0, &wire::encode(&header("ping", None, None, json!({})))));
        assert!(hangs_up(server.raw(), &bytes), "revision {revision}");
    }
    assert!(serves(&server.address));
}

#[test]
fn a_handshake_without_or_with_a_wrong_socket_type_is_hung_up_on() {
    let server = Served::start(&[]);
    let wrong: [&[(&str, &[u8])]; 7] = [
        &[],
        &[("Identity", b"")],
        &[("Socket-Type", b"")],
        &[("Socket-Type", b"PUSH")],
        &[("Socket-Type", b"DEALERS")],
        &[("Socket-Type", b"DEALER"), ("Socket-Type", b"SUB")],
        &[("Socket-Type", b"DEALER"), ("Identity", b"\0\x6b\x8b\x45\x69")],
    ];
    for properties in wrong {
        let bytes = [greeting("NULL"), ready(properties)].concat();
        assert!(hangs_up(server.raw(), &bytes), "{properties:?}");
    }
    // The same by hand, but right, is served; heartbeats come by themselves.
    let mut right = server.raw();
    let bytes = [greeting("NULL"), ready(&[("Socket-Type", b"DEALER")])].concat();
    right.write_all(&bytes).expect("it listens");
    assert!(serves(&server.address));
}

/// Properties of a peer that is let in.
const DEALER: &[(&str, &[u8])] = &[("Socket-Type", b"DEALER")];

/// A connection without ZeroMQ that has shaken hands.
fn admitted(server: &Served) -> std::net::TcpStream {
    let mut stream = server.raw();
    stream.write_all(&[greeting("NULL"), ready(DEALER)].concat()).expect("it listens");
    // Its greeting (64 bytes) and READY: only then may a message follow.
    let mut answer = [0; 64 + 2 + 41];
    stream.read_exact(&mut answer).expect("it answers");
    stream
}

/// The head of a long frame; its body is for the caller to send or not.
fn promise(flags: u8, bytes: u64) -> Vec<u8> {
    [&[flags | 2][..], &bytes.to_be_bytes()].concat()
}

/// A bystander who steps: it must go on whatever others do.
struct Bystander {
    socket: zmq::Socket,
    sid: String,
    seq: u64,
}

impl Bystander {
    fn new(address: &str) -> Self {
        let socket = client(address, None);
        let p = json!({"id": "rodgym/PendulumBalance-v0", "nonce": "1".repeat(32)});
        let wait = Duration::from_secs(20);
        let made = ask(&socket, &header("make", None, None, p), wait).expect("an answer");
        assert!(made.ok, "{:?}", made.err);
        let sid: String = made.p["sid"].as_str().expect("text").into();
        let reset = header("reset", Some(&sid), Some(1), json!({"seed": 1}));
        assert!(ask(&socket, &reset, wait).expect("an answer").ok);
        Bystander { socket, sid, seq: 1 }
    }

    fn step(&mut self) {
        self.seq += 1;
        let (array, frame) = wire::array("action", &[1, 1], &[0.1f32]);
        let mut step = header("step", Some(&self.sid), Some(self.seq), json!({}));
        step.arr.push(array);
        let frames = [wire::encode(&step), frame.to_vec()];
        self.socket.send_multipart(frames, zmq::DONTWAIT).expect("room in the queue");
        assert!(self.socket.poll(zmq::POLLIN, 20_000).expect("a socket") > 0, "it is not served");
        let reply = self.socket.recv_multipart(0).expect("it is there");
        let reply = wire::decode_reply(&reply[0]).expect("a reply");
        assert!(reply.ok && reply.seq == Some(self.seq), "{reply:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn unfinished_hellos_hold_next_to_nothing() {
    let server = Served::start(&[]);
    let mut bystander = Bystander::new(&server.address);
    let before = server.memory();
    // A command of 16 MB, as a stranger may begin it, and three of them sent.
    let hello = [greeting("NULL"), promise(4, 16_000_000)].concat();
    let peers: Vec<_> = (0..100)
        .map(|_| {
            let mut stream = server.raw();
            let _ = stream.write_all(&hello);
            let _ = stream.write_all(&vec![7; 3_000_000]);
            stream
        })
        .collect();
    bystander.step();
    assert!(server.memory() < before + (60 << 20), "{} MiB", server.memory() >> 20);
    for stream in peers {
        assert!(hangs_up(stream, b""));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_message_of_many_frames_is_hung_up_on() {
    let server = Served::start(&[]);
    let mut bystander = Bystander::new(&server.address);
    let before = server.memory();
    // 30 MB of empty frames, each with more to come.
    assert!(hangs_up(admitted(&server), &[1u8, 0].repeat(15_000_000)));
    // 40 frames of 1 MB: few, but more than a message may have in all.
    let frame = [promise(1, 1 << 20), vec![7; 1 << 20]].concat();
    assert!(hangs_up(admitted(&server), &frame.repeat(40)));
    bystander.step();
    assert!(server.memory() < before + (100 << 20), "{} MiB", server.memory() >> 20);
}

#[cfg(target_os = "linux")]
#[test]
fn what_all_peers_send_together_is_bounded_and_small_requests_go_on() {
    // A quarter of it is the transport's: 64 MiB, of which large frames may have 48.
    let server = Served::start(&["--memory", "256M"]);
    let mut bystander = Bystander::new(&server.address);
    let before = server.memory();
    let mut peers = Vec::new();
    for _ in 0..40 {
        let mut stream = admitted(&server);
        let _ = stream.write_all(&promise(0, 12_000_000));
        let _ = stream.write_all(&vec![7; 11_000_000]);
        peers.push(stream);
        bystander.step();
    }
    assert!(server.memory() < before + (120 << 20), "{} MiB", server.memory() >> 20);
    assert!(serves(&server.address));
}

/// Everything that takes memory, at once, under a limit of the address space: nothing aborts.
#[cfg(target_os = "linux")]
#[test]
fn under_a_limit_of_the_address_space_the_server_lives_on() {
    use std::os::unix::process::CommandExt;
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_rodgym-server"));
    // SAFETY: between fork and exec only setrlimit is called, which may be.
    unsafe {
        command.pre_exec(|| {
            let most = libc::rlimit { rlim_cur: 2 << 30, rlim_max: 2 << 30 };
            match libc::setrlimit(libc::RLIMIT_AS, &raw const most) {
                0 => Ok(()),
                _ => Err(std::io::Error::last_os_error()),
            }
        });
    }
    let more = ["--memory", "512M", "--max-user-sessions", "200"];
    let mut server = Served::command(command, &more);
    let mut bystander = Bystander::new(&server.address);
    let wait = Duration::from_secs(30);
    // Batches until memory is refused, by name and with the number.
    let maker = client(&server.address, None);
    let make = |i: u32| {
        let kwargs = json!({"nodes": 101, "physics_dt": 0.01});
        let p = json!({"id": "rodgym/PendulumSwingUp-v0", "num_envs": 512, "kwargs": kwargs,
                       "nonce": format!("{i:032x}")});
        ask(&maker, &header("make", None, None, p), wait).expect("an answer")
    };
    let refused = (2..200).map(make).find_map(|reply| reply.err).expect("memory ends");
    assert_eq!(refused.code, "limit");
    assert!(refused.msg.contains("bytes of memory"), "{}", refused.msg);
    bystander.step();
    // Unfinished messages, and replies that nobody reads.
    let mut peers = Vec::new();
    for i in 0..60 {
        let mut stream = admitted(&server);
        if i % 2 == 0 {
            let _ = stream.write_all(&promise(0, 15_000_000));
            let _ = stream.write_all(&vec![7; 14_000_000]);
        } else {
            let list = frame(0, &wire::encode(&header("list", None, None, json!({}))));
            let _ = stream.write_all(&list.repeat(3000));
        }
        peers.push(stream);
        bystander.step();
    }
    assert!(server.alive());
    assert!(serves(&server.address));
}

#[test]
fn more_connections_than_there_are_places_keep_nobody_out_who_is_in() {
    let mut server = Served::start(&["--limit", "connections=20"]);
    let mut bystander = Bystander::new(&server.address);
    let idle: Vec<_> = (0..100).map(|_| server.raw()).collect();
    bystander.step();
    // Those beyond the limit are closed at once, the others when their time for a handshake is over.
    for stream in idle {
        assert!(hangs_up(stream, b""));
    }
    bystander.step();
    assert!(serves(&server.address), "there is room again");
    assert!(server.alive());
}

/// A batch whose step takes about a second.
fn heavy(server: &Served) -> (zmq::Socket, String) {
    let socket = client(&server.address, None);
    let kwargs = json!({"nodes": 1001, "control_dt": 0.2, "physics_dt": 1e-4});
    let p = json!({"id": "rodgym/PendulumSwingUp-v0", "kwargs": kwargs, "nonce": "2".repeat(32)});
    let wait = Duration::from_secs(30);
    let made = ask(&socket, &header("make", None, None, p), wait).expect("an answer");
    assert!(made.ok, "{:?}", made.err);
    let sid: String = made.p["sid"].as_str().expect("text").into();
    let reset = header("reset", Some(&sid), Some(1), json!({"seed": 1}));
    assert!(ask(&socket, &reset, wait).expect("an answer").ok);
    (socket, sid)
}

fn send_step(socket: &zmq::Socket, sid: &str, seq: u64) {
    let (array, frame) = wire::array("action", &[1, 1], &[0.1f32]);
    let mut step = header("step", Some(sid), Some(seq), json!({}));
    step.arr.push(array);
    socket.send_multipart([wire::encode(&step), frame.to_vec()], 0).expect("room in the queue");
}

fn replies(socket: &zmq::Socket) -> bool {
    socket.poll(zmq::POLLIN, 0).expect("a socket") > 0
}

#[test]
fn others_are_served_while_a_long_step_is_computed() {
    let server = Served::start(&[]);
    let mut bystander = Bystander::new(&server.address);
    let (socket, sid) = heavy(&server);
    for seq in 2..5 {
        send_step(&socket, &sid, seq);
    }
    // Fifty steps of another, all of them done before the first long one is.
    for _ in 0..50 {
        bystander.step();
    }
    assert!(!replies(&socket), "that step was not long");
    // What waited for its session comes in order.
    for seq in 2..5 {
        assert!(socket.poll(zmq::POLLIN, 60_000).expect("a socket") > 0);
        let reply = socket.recv_multipart(0).expect("it is there");
        assert_eq!(wire::decode_reply(&reply[0]).expect("a reply").seq, Some(seq));
    }
}

#[test]
fn a_signal_during_a_long_step_ends_the_server_in_order() {
    let mut server = Served::start(&[]);
    let (socket, sid) = heavy(&server);
    send_step(&socket, &sid, 2);
    std::thread::sleep(Duration::from_millis(100));
    // SAFETY: the process is our child and not waited for yet.
    assert_eq!(unsafe { libc::kill(server.child.id() as libc::pid_t, libc::SIGTERM) }, 0);
    // The step is finished first: it is in flight.
    assert!(socket.poll(zmq::POLLIN, 30_000).expect("a socket") > 0);
    assert_eq!(server.child.wait().expect("it is our child").code(), Some(0));
}

#[test]
fn slow_sockets_do_not_silence_the_local_port() {
    let server = Served::start(&["--http", "127.0.0.1:0"]);
    let connect = || {
        let stream = std::net::TcpStream::connect(&server.http).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_secs(5))).expect("an option");
        stream
    };
    let mut slow: Vec<_> = (0..200).map(|_| connect()).collect();
    for stream in &mut slow {
        let _ = stream.write_all(b"GET /heal");
    }
    let mut text = String::new();
    let mut stream = connect();
    stream.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").expect("it reads");
    stream.read_to_string(&mut text).expect("it answers");
    assert!(text.starts_with("HTTP/1.1 200"), "{text}");
    // A head of any length has its Host read, or is refused.
    let filler = format!("X: {}\r\n", "y".repeat(9000));
    let mut stream = connect();
    let head = format!("GET /metrics HTTP/1.1\r\n{filler}Host: evil.example\r\n\r\n");
    stream.write_all(head.as_bytes()).expect("it reads");
    let mut answer = [0; 12];
    stream.read_exact(&mut answer).expect("it answers");
    assert_eq!(&answer, b"HTTP/1.1 431");
}

#[test]
fn the_address_of_the_live_page_is_told() {
    let mut server = Served::start(&["--http", "127.0.0.1:0", "--live"]);
    let page = server.line("live page at http://");
    assert_eq!(page, format!("{}/live", server.http));
}
