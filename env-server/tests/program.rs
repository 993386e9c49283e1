//! The program `rodgym-server` itself: keys, one line when it is ready, signals.
#![cfg(all(feature = "zmq", unix))]

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_rodgym-server"))
}

fn run(arguments: &[&str]) -> Output {
    program().args(arguments).output().expect("the program can be started")
}

/// A server that has said where it listens.
fn serving(more: &[&str]) -> Child {
    let mut child = program()
        .args(["--bind", "tcp://127.0.0.1:0", "--log", "error"])
        .args(more)
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program can be started");
    let mut line = String::new();
    BufReader::new(child.stdout.take().expect("it is piped")).read_line(&mut line).expect("text");
    assert!(line.starts_with("rodgym-server listens at tcp://127.0.0.1:"), "{line}");
    child
}

fn signal(child: &Child, signal: libc::c_int) {
    // SAFETY: the process is our child and not waited for yet.
    assert_eq!(unsafe { libc::kill(child.id() as libc::pid_t, signal) }, 0);
}

fn exit_code(mut child: Child) -> Option<i32> {
    let end = Instant::now() + Duration::from_secs(20);
    while Instant::now() < end {
        if let Some(status) = child.try_wait().expect("it is our child") {
            return status.code();
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    child.kill().expect("it is our child");
    panic!("the server did not stop");
}

#[test]
fn the_first_signal_stops_in_order() {
    for number in [libc::SIGTERM, libc::SIGINT] {
        let child = serving(&[]);
        signal(&child, number);
        assert_eq!(exit_code(child), Some(0));
    }
}

#[test]
fn the_second_signal_stops_at_once() {
    let child = serving(&[]);
    // Two of a kind could become one before they are seen.
    signal(&child, libc::SIGTERM);
    signal(&child, libc::SIGINT);
    let code = exit_code(child).expect("it exits by itself");
    assert!([128 + libc::SIGTERM, 128 + libc::SIGINT].contains(&code), "{code}");
}

#[test]
fn keys_are_made_once() {
    let home = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("program-keys");
    let _ = std::fs::remove_dir_all(&home);
    let home = home.to_str().expect("a plain path");
    let made = run(&["keygen", home]);
    assert!(made.status.success() && String::from_utf8_lossy(&made.stdout).contains("public key"));
    let again = run(&["keygen", home]);
    assert_eq!(again.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&again.stderr).contains("cannot be written"));
}

#[test]
fn what_is_not_allowed_is_refused_before_anything_is_bound() {
    for (arguments, word) in [
        (&["--bind", "tcp://0.0.0.0:0"][..], "keygen"),
        (&["--limit", "window=33"], "1 to 32"),
        (&["--limit", "windows=3"], "windows"),
        (&["--limit", "frames"], "NAME=NUMBER"),
        (&["--max-envs", "0"], "envs = 0"),
        (&["--log", "loud"], "debug or trace"),
        (&["--live"], "--http"),
        (&["--bnid", "x"], "--bnid"),
    ] {
        let refused = run(arguments);
        let text = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(1), "{arguments:?}");
        assert!(text.contains(word), "{arguments:?}: {text}");
    }
}
