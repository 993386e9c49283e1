//! The program `rodgym-server`; `rodgym serve` is the same code.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(rodgym_server::net::cli::main(std::env::args_os().skip(1)))
}
