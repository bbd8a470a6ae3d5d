//! `pve-sim`: executes the commands and maps their results to exit codes. The library contains everything else.

use std::fmt::Display;
use std::io::{BufWriter, StdoutLock, Write};
use std::process::ExitCode;
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use hal_sim::decode::{DecodeOptions, decode};
use hal_sim::replay::{ReplayOptions, replay};
use hal_sim::text::in_one_line;
use pve_sim::batch;
use pve_sim::campaign;
use pve_sim::cli::{self, Request, SetArgs, StatusArgs};
use pve_sim::output::{CommandError, Output, outlive_file_size_limit};
use pve_sim::remote;
use pve_sim::run::{self, RunError};

/// A failure, such as a port in use or a file that cannot be opened.
const FAILURE: u8 = 1;
/// A usage error.
const USAGE: u8 = 2;

/// The time limit for writing the final error to stderr.
const WRITE_TIMEOUT: Duration = Duration::from_secs(2);

fn main() -> ExitCode {
    outlive_file_size_limit();
    match cli::parse(std::env::args_os()) {
        Ok(Request::Run(options)) => ended(run::run(&options, None)),
        Ok(Request::JudgedRun(options, cell)) => match campaign::judged(&cell, options.speed) {
            Ok(cell) => ended(run::run(&options, Some(cell))),
            Err(error) => failed(&error),
        },
        Ok(Request::UseCases(cases)) => execute(|out| batch::play(&cases, out)),
        Ok(Request::Scenarios(options)) => execute(|out| batch::run(&options, out)),
        Ok(Request::Campaign(options)) => execute(|out| campaign::run(&options, out)),
        Ok(Request::Decode(options)) => explain(&options),
        Ok(Request::Replay(options)) => compare(&options),
        Ok(Request::Set(SetArgs { http, device, words })) => match remote::set(http, &device, &words) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => fail(FAILURE, &in_one_line(&error)),
        },
        Ok(Request::Status(StatusArgs { http, device, json })) => match remote::status(http, device.as_deref(), json) {
            Ok(text) => print(&text, true),
            Err(error) => fail(FAILURE, &in_one_line(&error)),
        },
        Ok(Request::Print(text)) => print(&text, true),
        Err(error) => fail(USAGE, &error),
    }
}

/// Returns the exit code of a run.
fn ended(run: Result<bool, RunError>) -> ExitCode {
    match run {
        Ok(true) => ExitCode::SUCCESS,
        // The error was reported when it occurred.
        Ok(false) => ExitCode::from(FAILURE),
        Err(error) => fail(FAILURE, &error),
    }
}

fn stdout() -> Output<StdoutLock<'static>> {
    Output::new(std::io::stdout().lock())
}

/// Writes the complete output of a command, and returns its exit code.
fn print(text: &str, success: bool) -> ExitCode {
    let mut stdout = stdout();
    // `end` reports a write error.
    let _ = stdout.write_all(text.as_bytes());
    end(stdout, success)
}

/// Returns the exit code of a command from its result. Truncated output is a failure.
fn end(stdout: Output<impl Write>, success: bool) -> ExitCode {
    match stdout.finish() {
        Err(error) => fail(FAILURE, &format_args!("stdout: {error}")),
        Ok(()) if success => ExitCode::SUCCESS,
        Ok(()) => ExitCode::from(FAILURE),
    }
}

/// Executes a command, and returns its exit code.
fn execute(command: impl FnOnce(&mut dyn Write) -> Result<bool, CommandError>) -> ExitCode {
    let mut stdout = stdout();
    match command(&mut stdout) {
        Ok(success) => end(stdout, success),
        Err(error) => failed(&error),
    }
}

/// Reports the error of a command, and returns the exit code.
fn failed(error: &CommandError) -> ExitCode {
    match error {
        CommandError::Refused(lines) => fail(USAGE, lines),
        CommandError::Failed(reason) => fail(FAILURE, reason),
    }
}

/// Explains a recording; unreadable lines are reported on stderr.
fn explain(options: &DecodeOptions) -> ExitCode {
    let mut stdout = BufWriter::with_capacity(1 << 16, std::io::stdout().lock());
    match decode(options, &mut stdout, warn) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(FAILURE),
        Err(error) => fail(FAILURE, &error),
    }
}

/// Replays a recording; differences and the summary go to stdout, unreadable lines to stderr.
fn compare(options: &ReplayOptions) -> ExitCode {
    let outcome = match replay(options) {
        Ok(outcome) => outcome,
        Err(error) => return fail(FAILURE, &error),
    };
    outcome.unread.iter().for_each(|line| warn(line));
    print(&outcome.report(options).to_string(), outcome.is_as_logged())
}

fn warn(line: &str) {
    let _ = writeln!(std::io::stderr(), "pve-sim: {}", in_one_line(line));
}

/// Reports the lines of an error on stderr, and returns the exit code. Writes on a separate thread: a full pipe without a reader
/// must not block the exit, because signals no longer end a run.
fn fail(code: u8, error: &dyn Display) -> ExitCode {
    let error = error.to_string();
    let lines: String = error.lines().map(|line| format!("pve-sim: {}\n", in_one_line(line))).collect();
    let tell = |lines: String| std::io::stderr().write_all(lines.as_bytes());
    let (alive, ended) = channel::<()>();
    let writer = thread::Builder::new().spawn({
        let lines = lines.clone();
        move || {
            let _ = tell(lines);
            drop(alive);
        }
    });
    match writer {
        // The channel carries no message: it closes with the end of the thread.
        Ok(_) => drop(ended.recv_timeout(WRITE_TIMEOUT)),
        // The error to report may itself be that no thread can be started.
        Err(_) => drop(tell(lines)),
    }
    ExitCode::from(code)
}
