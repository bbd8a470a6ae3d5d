//! Reads the scenarios of a command line, runs them on all cores and reports them in order.

mod junit;

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, mpsc};
use std::thread;

use hal_sim::scenario::{Outcome, ReadError, Scenario};

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

/// The reason why the scenarios did not run or the JUnit file was not written.
#[derive(Debug, thiserror::Error)]
pub enum BatchError {
    /// Some files cannot be read; one line for each. No scenario was run.
    #[error("{}", .0.join("\n"))]
    Unreadable(Vec<String>),
    /// The file of `--junit` cannot be written.
    #[error("--junit {file}: {1}", file = .0.display())]
    Junit(PathBuf, #[source] io::Error),
}

struct Named<'a> {
    file: &'a Path,
    scenario: Scenario,
}

/// Reads all files, runs the scenarios and writes their outcomes to `out`; returns whether all passed. Errors of `out`
/// are ignored.
///
/// # Errors
/// [`BatchError`].
pub fn run(options: &Options, out: &mut dyn Write) -> Result<bool, BatchError> {
    let scenarios = all_or_none(options.files.iter().map(|file| read(file)))?;
    let (files, outcomes) = run_all(&scenarios, options, out);
    if let Some(path) = &options.junit {
        let report = junit::report(&files, &outcomes);
        fs::write(path, report).map_err(|error| BatchError::Junit(path.clone(), error))?;
    }
    Ok(outcomes.iter().all(Outcome::is_success))
}

/// Runs use cases and prints their traces; returns whether all passed.
///
/// # Errors
/// [`BatchError::Unreadable`]
pub fn play(cases: &[UseCase], out: &mut dyn Write) -> Result<bool, BatchError> {
    let scenarios = all_or_none(cases.iter().map(|case| parse(Path::new(case.file), case.text)))?;
    let options = Options { files: Vec::new(), junit: None, seed: 1, verbose: true };
    Ok(run_all(&scenarios, &options, out).1.iter().all(Outcome::is_success))
}

fn all_or_none<'a>(read: impl Iterator<Item = Result<Named<'a>, String>>) -> Result<Vec<Named<'a>>, BatchError> {
    let (read, refused): (Vec<_>, Vec<_>) = read.partition(Result::is_ok);
    let refused: Vec<String> = refused.into_iter().filter_map(Result::err).collect();
    if refused.is_empty() { Ok(read.into_iter().flatten().collect()) } else { Err(BatchError::Unreadable(refused)) }
}

/// Runs the scenarios and reports their outcomes; returns their files and outcomes.
fn run_all(scenarios: &[Named<'_>], options: &Options, out: &mut dyn Write) -> (Vec<String>, Vec<Outcome>) {
    let mut outcomes = Vec::with_capacity(scenarios.len());
    let files: Vec<String> = scenarios.iter().map(|named| named.file.display().to_string()).collect();
    over_the_cores(scenarios, options, |outcome| {
        let _ = tell(out, &files[outcomes.len()], &outcome);
        outcomes.push(outcome);
    });
    let failed = outcomes.iter().filter(|outcome| !outcome.is_success()).count();
    let _ = writeln!(out, "{} passed, {failed} failed", outcomes.len() - failed).and_then(|()| out.flush());
    (files, outcomes)
}

fn read(file: &Path) -> Result<Named<'_>, String> {
    let text = fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))?;
    parse(file, &text)
}

fn parse<'a>(file: &'a Path, text: &str) -> Result<Named<'a>, String> {
    let scenario = Scenario::parse(text).map_err(|ReadError { line, reason }| {
        let line = line.map_or_else(String::new, |line| format!("{line}:"));
        format!("{}:{line} {reason}", file.display())
    })?;
    Ok(Named { file, scenario })
}

/// Runs scenarios on one thread per core, and passes their outcomes to `tell` in order.
fn over_the_cores(scenarios: &[Named<'_>], options: &Options, tell: impl FnMut(Outcome)) {
    let threads = thread::available_parallelism().map_or(1, usize::from).min(scenarios.len());
    let (senders, receivers): (Vec<_>, Vec<_>) = scenarios.iter().map(|_| mpsc::channel()).unzip();
    let jobs = &Mutex::new(scenarios.iter().zip(senders));
    let next = || jobs.lock().unwrap_or_else(PoisonError::into_inner).next();
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(move || {
                while let Some((named, sender)) = next() {
                    let _ = sender.send(run_one(&named.scenario, options));
                }
            });
        }
        receivers.into_iter().filter_map(|outcome| outcome.recv().ok()).for_each(tell);
    });
}

fn run_one(scenario: &Scenario, options: &Options) -> Outcome {
    if options.verbose { scenario.run_traced(options.seed) } else { scenario.run(options.seed) }
}

fn tell(out: &mut dyn Write, file: &str, outcome: &Outcome) -> io::Result<()> {
    let verdict = if outcome.is_success() { "ok   " } else { "FAIL " };
    write!(out, "{}{verdict}{file}: {outcome}\n{}", outcome.trace(), outcome.failures(file))
}
