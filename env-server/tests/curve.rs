//! The libzmq in here has CURVE, whatever the registry's build would have, and admits nobody whom the
//! key directory does not name.
#![cfg(feature = "zmq")]

use rodgym_server::limits::Limits;
use rodgym_server::net::router::{Router, Security};
use rodgym_server::net::{keys, zap};
use rodgym_server::shared::Shared;
use rodgym_server::transport::Transport;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

#[test]
fn libzmq_is_new_enough_and_has_curve() {
    assert!(zmq::version() >= (4, 3, 4), "{:?}", zmq::version());
    assert_eq!(zmq::has("curve"), Some(true));
    assert_ne!(zmq::CurveKeyPair::new().expect("keys can be made").secret_key, [0; 32]);
}

/// An empty directory of this test.
fn directory(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&path);
    path
}

/// Whether a request of a client with new keys of its own arrives at a front with CURVE.
/// `authorized`: a handler is there and knows the client; `None`: no handler at all.
fn arrives(name: &str, authorized: Option<bool>) -> bool {
    let home = directory(name);
    let server = keys::generate(&home.join("server")).expect("a new directory");
    let client = keys::generate(&home.join("client")).expect("a new directory");
    if authorized == Some(true) {
        std::fs::copy(home.join("client/public.key"), home.join("server/authorized/ada.key"))
            .expect("both are there");
    }
    let context = zmq::Context::new();
    if authorized.is_some() {
        let shared = Arc::new(Shared::new(Limits::default(), "epoch"));
        zap::start(&context, home.join("server"), shared).expect("the address is free");
    }
    let (limits, security) = (Limits::default(), Security::Curve(server.secret));
    let anybody = Box::new(|_: Option<&str>| Some("anybody".to_string()));
    let mut front = Router::bind(&context, "tcp://127.0.0.1:*", &security, &limits, anybody)
        .expect("a free port");

    let decode = |key: &str| zmq::z85_decode(key).expect("a key of our own");
    let peer = zmq::Context::new().socket(zmq::DEALER).expect("a socket");
    peer.set_linger(0).expect("an option");
    peer.set_curve_serverkey(&decode(&server.public)).expect("a key");
    peer.set_curve_publickey(&decode(&client.public)).expect("a key");
    peer.set_curve_secretkey(&decode(&client.secret)).expect("a key");
    peer.connect(front.endpoint()).expect("an address");
    peer.send("hello", zmq::DONTWAIT).expect("room in the queue");
    // Those who are let in are heard at once; nobody can wait for one who never comes.
    let patience = if authorized == Some(true) { 100 } else { 10 };
    (0..patience).any(|_| front.receive(Duration::from_millis(100)).expect("it works").is_some())
}

#[test]
fn a_key_that_is_authorized_is_let_in() {
    assert!(arrives("friend", Some(true)));
}

#[test]
fn a_key_that_is_not_authorized_is_kept_out() {
    assert!(!arrives("stranger", Some(false)));
}

/// libzmq's own default admits every key then.
#[test]
fn without_an_authentication_handler_nobody_is_let_in() {
    assert!(!arrives("no-handler", None));
}
