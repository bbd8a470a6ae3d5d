//! Reads the scenarios of a command line, runs them on all cores and reports them in order.

mod junit;

use std::convert::Infallible;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use hal_sim::scenario::{Outcome, ReadError, Scenario};
use hal_sim::text::in_one_line;

use crate::cores::{in_order, processors};
use crate::output::CommandError;
use crate::use_case::UseCase;

/// The options of `scenario`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// The files, in the order of the report.
    pub files: Vec<PathBuf>,
    /// The JUnit file for CI, if any.
    pub junit: Option<PathBuf>,
    /// The seed of all random values.
    pub seed: u64,
    /// Whether the trace of each scenario is printed.
    pub verbose: bool,
}

/// Reads all files, runs the scenarios and writes their outcomes to `out`; returns whether all passed. No scenario runs
/// if a file cannot be read. Errors of `out` are ignored.
///
/// # Errors
/// [`CommandError`]
pub fn run(options: &Options, out: &mut dyn Write) -> Result<bool, CommandError> {
    let scenarios = all_or_none(options.files.iter().map(|file| read(file)))?;
    let files: Vec<String> = options.files.iter().map(|file| shown(file)).collect();
    let outcomes = run_all(scenarios, &files, options.seed, options.verbose, out)?;
    if let Some(path) = &options.junit {
        let report = junit::report(&files, &outcomes);
        fs::write(path, report).map_err(|error| CommandError::unwritten("--junit", path, &error))?;
    }
    Ok(outcomes.iter().all(Outcome::is_success))
}

/// Runs use cases and prints their traces; returns whether all passed.
///
/// # Errors
/// [`CommandError`]
pub fn play(cases: &[UseCase], out: &mut dyn Write) -> Result<bool, CommandError> {
    let scenarios = all_or_none(cases.iter().map(|case| parse(Path::new(case.file), case.text)))?;
    let files: Vec<String> = cases.iter().map(|case| case.file.to_owned()).collect();
    Ok(run_all(scenarios, &files, 1, true, out)?.iter().all(Outcome::is_success))
}

fn all_or_none(read: impl Iterator<Item = Result<Scenario, String>>) -> Result<Vec<Scenario>, CommandError> {
    let (read, refused): (Vec<_>, Vec<_>) = read.partition(Result::is_ok);
    let refused: Vec<String> = refused.into_iter().filter_map(Result::err).collect();
    match refused.is_empty() {
        true => Ok(read.into_iter().flatten().collect()),
        false => Err(CommandError::Refused(refused.join("\n"))),
    }
}

fn read(file: &Path) -> Result<Scenario, String> {
    let text = fs::read_to_string(file).map_err(|error| format!("{}: {error}", shown(file)))?;
    parse(file, &text)
}

fn parse(file: &Path, text: &str) -> Result<Scenario, String> {
    Scenario::parse(text).map_err(|ReadError { line, reason }| {
        let line = line.map_or_else(String::new, |line| format!("{line}:"));
        format!("{}:{line} {reason}", shown(file))
    })
}

/// Returns the name of a file in messages and reports.
fn shown(file: &Path) -> String {
    in_one_line(&file.display().to_string())
}

/// Runs the scenarios of files, and reports and returns their outcomes.
fn run_all(
    scenarios: Vec<Scenario>,
    files: &[String],
    seed: u64,
    verbose: bool,
    out: &mut dyn Write,
) -> Result<Vec<Outcome>, CommandError> {
    let mut outcomes: Vec<Outcome> = Vec::with_capacity(files.len());
    let run = move |it: Scenario| if verbose { it.run_traced(seed) } else { it.run(seed) };
    let take = |outcome| {
        let _ = tell(out, &files[outcomes.len()], &outcome);
        outcomes.push(outcome);
        Ok::<(), Infallible>(())
    };
    in_order(scenarios, processors(), run, &AtomicBool::new(false), take, || {})
        .map_err(|_| CommandError::Failed("defect of pve-sim: a scenario panicked".to_owned()))?;
    let failed = outcomes.iter().filter(|outcome| !outcome.is_success()).count();
    let _ = writeln!(out, "{} passed, {failed} failed", outcomes.len() - failed).and_then(|()| out.flush());
    Ok(outcomes)
}

fn tell(out: &mut dyn Write, file: &str, outcome: &Outcome) -> io::Result<()> {
    let verdict = if outcome.is_success() { "ok   " } else { "FAIL " };
    write!(out, "{}{verdict}{file}: {outcome}\n{}", outcome.trace(), outcome.failures(file))
}
