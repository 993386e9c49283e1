//! The command line, shared by `rodgym-server` and `rodgym serve`.

use super::{Config, keys, serve};
use lexopt::prelude::*;
use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;
use tracing::Level;

/// What `--help` shows; a build of the Python extension without server shows it too.
const HELP: &str = include_str!("help.txt");

/// Less does not hold one message of the default size beside anything else.
const LEAST_MEMORY: u64 = 64 << 20;

enum Command {
    Serve(Box<Config>, Logs),
    Keygen(PathBuf),
    Show(String),
}

struct Logs {
    level: Level,
    json: bool,
}

fn level(text: &str) -> Result<Level, String> {
    text.parse().map_err(|_| format!("--log {text}: it must be error, warn, info, debug or trace"))
}

/// Runs the program; the first argument is not the program's name. Returns the exit code.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let outcome = parse(arguments).map_err(|e| e.to_string()).and_then(|command| match command {
        Command::Show(text) => {
            print!("{text}");
            Ok(())
        }
        Command::Keygen(directory) => {
            let pair = keys::generate(&directory)?;
            println!("public key {}\nin {}", pair.public, directory.join("public.key").display());
            Ok(())
        }
        Command::Serve(config, logs) => {
            start_logs(&logs);
            serve(&config, |endpoint, http| {
                // Others wait for the first line to learn the port, and may then close their end.
                let mut text = format!("rodgym-server listens at {endpoint}\n");
                if let Some(http) = http {
                    text += &format!("metrics at http://{http}/metrics\n");
                    if config.live {
                        text += &format!("live page at http://{http}/live\n");
                    }
                }
                let mut out = std::io::stdout();
                let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
            })
        }
    });
    match outcome {
        Ok(()) => 0,
        Err(text) => {
            eprintln!("rodgym-server: {text}");
            1
        }
    }
}

fn parse(arguments: impl IntoIterator<Item = OsString>) -> Result<Command, lexopt::Error> {
    let mut config = Config::default();
    let asked = std::env::var("RODGYM_LOG");
    let mut logs = Logs { level: level(asked.as_deref().unwrap_or("info"))?, json: false };
    let mut parser = lexopt::Parser::from_args(arguments);
    while let Some(argument) = parser.next()? {
        match argument {
            Value(word) if word == "keygen" => {
                let directory = PathBuf::from(parser.value()?);
                return match parser.next()? {
                    None => Ok(Command::Keygen(directory)),
                    Some(extra) => Err(extra.unexpected()),
                };
            }
            Long("bind") => config.bind = parser.value()?.string()?,
            Long("keys") => config.keys = Some(parser.value()?.into()),
            Long("insecure-no-auth") => config.insecure_no_auth = true,
            Long("http") => config.http = Some(parser.value()?.parse()?),
            Long("live") => config.live = true,
            Long("workers") => config.workers = Some(parser.value()?.parse()?),
            Long("threads") => config.limits.set("threads", parser.value()?.parse()?)?,
            Long("max-sessions") => config.limits.set("sessions", parser.value()?.parse()?)?,
            Long("max-user-sessions") => {
                config.limits.set("sessions_per_user", parser.value()?.parse()?)?;
            }
            Long("max-envs") => config.limits.set("envs", parser.value()?.parse()?)?,
            Long("max-message-mib") => {
                let mebibytes: u32 = parser.value()?.parse()?;
                config.limits.set("message_bytes", u64::from(mebibytes) << 20)?;
            }
            Long("memory") => config.memory = Some(bytes(&parser.value()?.string()?)?),
            Long("idle-seconds") => config.limits.set("idle_seconds", parser.value()?.parse()?)?,
            Long("limit") => {
                let text = parser.value()?.string()?;
                let (name, value) = text
                    .split_once('=')
                    .ok_or_else(|| format!("--limit {text} is not of the form NAME=NUMBER"))?;
                let value = value.parse().map_err(|_| format!("--limit {text}: not a number"))?;
                config.limits.set(name, value)?;
            }
            Long("log") => logs.level = level(&parser.value()?.string()?)?,
            Long("log-json") => logs.json = true,
            Short('h') | Long("help") => return Ok(Command::Show(HELP.into())),
            Short('V') | Long("version") => {
                let text = concat!("rodgym-server ", env!("CARGO_PKG_VERSION"), ", protocol 1\n");
                return Ok(Command::Show(text.into()));
            }
            other => return Err(other.unexpected()),
        }
    }
    Ok(Command::Serve(Box::new(config), logs))
}

/// A number of bytes such as `512M` or `4G`.
fn bytes(text: &str) -> Result<u64, String> {
    let (number, unit) = match text.char_indices().last() {
        Some((at, 'K' | 'k')) => (&text[..at], 1 << 10),
        Some((at, 'M' | 'm')) => (&text[..at], 1 << 20),
        Some((at, 'G' | 'g')) => (&text[..at], 1 << 30),
        _ => (text, 1u64),
    };
    let bytes = number.parse::<u64>().ok().and_then(|n| n.checked_mul(unit));
    match bytes {
        Some(bytes) if bytes >= LEAST_MEMORY => Ok(bytes),
        _ => Err(format!(
            "--memory {text}: it must be a number of bytes such as 512M or 4G, at least 64M"
        )),
    }
}

/// Logs go to stderr; a second server in one process keeps the first one's.
fn start_logs(logs: &Logs) {
    let builder = tracing_subscriber::fmt()
        .with_max_level(logs.level)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
        .with_target(false);
    let _ = if logs.json { builder.json().try_init() } else { builder.try_init() };
}
