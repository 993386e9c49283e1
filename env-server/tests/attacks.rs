//! What has ended, filled or fooled a server of this kind, over a real port: nobody but the attacker
//! notices. docs/remote-proofs.md lists them.
#![cfg(all(feature = "zmq", unix))]

mod served;

use rodgym_server::net::keys;
use rodgym_server::wire;
use serde_json::json;
use served::*;
use std::io::Write;
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
