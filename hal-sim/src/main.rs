//! `pve-sim`: the stand-in devices on the host. What it does is in the library; here are the exit codes.

use std::io::Write;
use std::process::ExitCode;

use hal_sim::cli::{self, Request};
use hal_sim::run;

/// Something is in the way: a port in use, a file that cannot be opened.
const FAILURE: u8 = 1;
/// Wrong usage.
const USAGE: u8 = 2;

fn main() -> ExitCode {
    match cli::parse(std::env::args_os()) {
        Ok(Request::Run(options)) => match run::run(&options) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => fail(FAILURE, &error),
        },
        Ok(Request::Print(text)) => {
            let mut stdout = std::io::stdout().lock();
            let _ = write!(stdout, "{text}").and_then(|()| stdout.flush());
            ExitCode::SUCCESS
        }
        Err(error) => fail(USAGE, &error),
    }
}

fn fail(code: u8, error: &dyn std::error::Error) -> ExitCode {
    let _ = writeln!(std::io::stderr(), "pve-sim: {error}");
    ExitCode::from(code)
}
