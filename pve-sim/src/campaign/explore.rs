//! `campaign --explore`: the search for pairs of faults on all cores, until its time is over.

use std::fs::OpenOptions;
use std::io::{self, ErrorKind, Write};
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use hal_sim::campaign::{Campaign, Explorer, Find, Pair, Tried};

use super::options::CampaignOptions;
use super::plan::{Prepared, prepare};
use super::results::quoted;
use super::run::interruption;
use crate::cores::processors;
use crate::output::CommandError;

/// The seed of a search without `--seed`.
const SEED: u64 = 1;

/// Searches for pairs of faults that fail together only, and writes each as a scenario, and the summary to `out`.
/// Returns whether there is no find, and no signal has ended the search. Errors of `out` are ignored.
///
/// # Errors
/// [`CommandError`]
pub(super) fn explore(
    plan: &Path,
    seconds: u32,
    options: &CampaignOptions,
    out: &mut dyn Write,
) -> Result<bool, CommandError> {
    let end = Instant::now() + Duration::from_secs(seconds.into());
    let folder = options.finds.as_deref().unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(CommandError::Refused(format!("--finds {}: no such folder", folder.display())));
    }
    let Prepared { campaign, live, .. } = prepare(plan, None, true)?;
    if live.is_some() {
        let reason = "the controller of the plan is a program, which cannot be forked; use a plan without controller";
        return Err(CommandError::Refused(format!("--explore: {reason}")));
    }
    let jobs = options.jobs.map_or_else(processors, usize::from);
    let interrupted = interruption();
    let mut explorer = Explorer::new(&campaign, options.seed.unwrap_or(SEED));
    let mut finds = 0;
    search(&campaign, &mut explorer, jobs, end, &interrupted, &mut |find| {
        finds += 1;
        tell(find, plan, folder, out);
    })?;
    let _ = writeln!(out, "{} pairs, {} states reached", explorer.pairs, explorer.states());
    let _ = writeln!(
        out,
        "{} pairs with a fault that fails alone, {} with a fault that did not act",
        explorer.singles, explorer.not_injected
    );
    let was_interrupted = interrupted.load(Ordering::Relaxed);
    let early = if was_interrupted { " until the signal" } else { "" };
    let _ = writeln!(out, "{finds} {}{early}", if finds == 1 { "find" } else { "finds" });
    Ok(finds == 0 && !was_interrupted)
}

/// Searches in whole rounds: at least one, and none after the end or a signal. Hands over each find.
fn search(
    campaign: &Campaign<'_>,
    explorer: &mut Explorer<'_>,
    jobs: usize,
    end: Instant,
    interrupted: &AtomicBool,
    found: &mut dyn FnMut(&Find),
) -> Result<(), CommandError> {
    while !interrupted.load(Ordering::Relaxed) {
        let pairs = explorer.round();
        if pairs.is_empty() {
            let reason = "the plan has no two faults that can act together; give another kind of fault";
            return Err(CommandError::Refused(format!("--explore: {reason}")));
        }
        let tried = run(campaign, &pairs, jobs);
        for (pair, tried) in pairs.into_iter().zip(tried) {
            // To shrink a find takes time.
            if interrupted.load(Ordering::Relaxed) {
                break;
            }
            explorer.take(pair, tried).iter().for_each(&mut *found);
        }
        if Instant::now() >= end {
            break;
        }
    }
    Ok(())
}

/// Runs pairs on several threads. Returns the results in the order of the pairs.
fn run(campaign: &Campaign<'_>, pairs: &[Pair], jobs: usize) -> Vec<Tried> {
    thread::scope(|scope| {
        let parts = pairs.chunks(pairs.len().div_ceil(jobs).max(1));
        let threads: Vec<_> = parts.map(|part| scope.spawn(|| campaign.run_pairs(part))).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    })
}

/// Writes the scenario of a find to a new file, and the lines of the find to `out`.
fn tell(find: &Find, plan: &Path, folder: &Path, out: &mut dyn Write) {
    let scenario = match find.scenario.as_ref().map(|text| write(text, plan, folder)) {
        Some(Ok(path)) => format!("pve-sim scenario {} --seed {}", quoted(&path.to_string_lossy()), find.seed),
        Some(Err(error)) => error.to_string(),
        None => format!("no scenario reproduces this pair (seed {})", find.seed),
    };
    let told = writeln!(out, "FIND {}: {}\n       {scenario}", find.verdict, find.faults);
    let _ = told.and_then(|()| out.flush());
}

/// Writes a text to the first free file PLAN.find-N.toml of a folder.
fn write(text: &str, plan: &Path, folder: &Path) -> Result<PathBuf, CommandError> {
    let stem = plan.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    for number in 1_u64.. {
        let name = format!("{stem}.find-{number}.toml");
        let path = if folder == Path::new(".") { name.into() } else { folder.join(name) };
        let file = OpenOptions::new().write(true).create_new(true).open(&path);
        let written = match file {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => continue,
            file => file.and_then(|mut file| file.write_all(text.as_bytes())),
        };
        return match written {
            Ok(()) => Ok(path),
            Err(error) => {
                // A part of a scenario is of no use.
                let _ = std::fs::remove_file(&path);
                Err(CommandError::of(&path, error))
            }
        };
    }
    Err(CommandError::of(folder, io::Error::from(ErrorKind::AlreadyExists)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slow machine, whose time is over before the first pair, proves something nevertheless.
    #[test]
    fn the_first_round_is_whole_and_a_signal_ends_it() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/campaigns");
        let Prepared { campaign, .. } = prepare(&folder.join("valve-careless.toml"), None, true).expect("a plan");
        for (signal, pairs) in [(false, 64), (true, 0)] {
            let mut explorer = Explorer::new(&campaign, SEED);
            let (end, signal) = (Instant::now(), AtomicBool::new(signal));
            search(&campaign, &mut explorer, 2, end, &signal, &mut |_| ()).expect("a search");
            assert_eq!(explorer.pairs, pairs);
        }
    }

    #[test]
    fn no_file_is_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |text| write(text, Path::new("a/plan.toml"), folder.path()).expect("a file");
        assert_eq!(
            (write("one"), write("two")),
            (folder.path().join("plan.find-1.toml"), folder.path().join("plan.find-2.toml"))
        );
        assert_eq!(std::fs::read_to_string(folder.path().join("plan.find-1.toml")).expect("text"), "one");
    }

    #[test]
    fn a_folder_that_takes_no_file_is_named() {
        let folder = tempfile::tempdir().expect("a folder").path().join("away");
        let error = write("one", Path::new("plan.toml"), &folder).expect_err("no folder").to_string();
        assert!(error.contains("plan.find-1.toml: "), "{error}");
    }
}
