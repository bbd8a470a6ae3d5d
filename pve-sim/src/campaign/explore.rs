//! `campaign --explore`: the search for pairs of faults on all cores, until its time is over.

use std::fs::OpenOptions;
use std::io::{self, ErrorKind, Write};
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use hal_sim::campaign::{Campaign, Explorer, Find, Pair, Tried};

use super::CampaignError;
use super::plan::{Prepared, prepare};
use super::results::{ResultsError, quoted};
use super::run::on_signal;

/// The seed of a search without `--seed`.
const SEED: u64 = 1;

/// The options of `campaign --explore`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExploreOptions {
    /// The plan.
    pub plan: PathBuf,
    /// The seed of the search; by default 1. The runs have the seeds of the plan.
    pub seed: Option<u64>,
    /// The duration of the search in seconds.
    pub seconds: u32,
    /// The number of runs at once; by default the number of processors.
    pub jobs: Option<usize>,
    /// The folder for the scenarios of the finds.
    pub finds: PathBuf,
}

/// Searches for pairs of faults that fail together only, and writes each as a scenario, and the summary to `out`.
/// Returns whether there is no find. A signal ends the search early. Errors of `out` are ignored.
///
/// # Errors
/// [`CampaignError`]
pub fn explore(options: &ExploreOptions, out: &mut dyn Write) -> Result<bool, CampaignError> {
    let end = Instant::now() + Duration::from_secs(options.seconds.into());
    if !options.finds.is_dir() {
        return Err(CampaignError::Refused(format!("--finds {}: no such folder", options.finds.display())));
    }
    let Prepared { campaign, live, .. } = prepare(&options.plan, None, true)?;
    if live.is_some() {
        let reason = "the controller of the plan is a program, which cannot be forked; use a plan without controller";
        return Err(CampaignError::Refused(format!("--explore: {reason}")));
    }
    let jobs = options.jobs.unwrap_or_else(|| thread::available_parallelism().map_or(1, usize::from));
    let was_interrupted = Arc::new(AtomicBool::new(false));
    let flag = was_interrupted.clone();
    on_signal(move || flag.store(true, Ordering::Relaxed));
    let mut explorer = Explorer::new(&campaign, options.seed.unwrap_or(SEED));
    let mut finds = 0;
    search(&campaign, &mut explorer, jobs, end, &was_interrupted, &mut |find| {
        finds += 1;
        tell(find, options, out)
    })?;
    let _ = writeln!(out, "{} pairs, {} states reached", explorer.pairs(), explorer.states());
    let _ = writeln!(
        out,
        "{} pairs with a fault that fails alone, {} with a fault that did not act",
        explorer.singles(),
        explorer.not_injected()
    );
    let early = if was_interrupted.load(Ordering::Relaxed) { " until the signal" } else { "" };
    let _ = writeln!(out, "{finds} {}{early}", if finds == 1 { "find" } else { "finds" });
    Ok(finds == 0)
}

/// Searches in whole rounds: at least one, and none after the end or a signal. Hands over each find.
fn search(
    campaign: &Campaign<'_>,
    explorer: &mut Explorer<'_>,
    jobs: usize,
    end: Instant,
    was_interrupted: &AtomicBool,
    found: &mut dyn FnMut(&Find) -> Result<(), CampaignError>,
) -> Result<(), CampaignError> {
    while !was_interrupted.load(Ordering::Relaxed) {
        let pairs = explorer.round();
        if pairs.is_empty() {
            let reason = "the plan has no two faults that can act together; give another kind of fault";
            return Err(CampaignError::Refused(format!("--explore: {reason}")));
        }
        let tried = run(campaign, &pairs, jobs);
        for (pair, tried) in pairs.into_iter().zip(tried) {
            // To shrink a find takes time.
            if was_interrupted.load(Ordering::Relaxed) {
                break;
            }
            explorer.take(pair, tried).map_or(Ok(()), |find| found(&find))?;
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

/// Writes the scenario of a find to a new file, and its lines to `out`.
fn tell(find: &Find, options: &ExploreOptions, out: &mut dyn Write) -> Result<(), CampaignError> {
    let _ = writeln!(out, "FIND {}: {}", find.verdict, find.faults);
    let _ = match &find.scenario {
        Some(text) => {
            let path = write(text, &options.plan, &options.finds)?;
            writeln!(out, "       pve-sim scenario {} --seed {}", quoted(&path.to_string_lossy()), find.seed)
        }
        None => writeln!(out, "       no scenario reproduces this pair (seed {})", find.seed),
    }
    .and_then(|()| out.flush());
    Ok(())
}

/// Writes a text to the first free file PLAN.find-N.toml of a folder.
fn write(text: &str, plan: &Path, folder: &Path) -> Result<PathBuf, ResultsError> {
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
                Err(ResultsError::new(&path, error))
            }
        };
    }
    Err(ResultsError::new(folder, io::Error::from(ErrorKind::AlreadyExists)))
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
            search(&campaign, &mut explorer, 2, end, &signal, &mut |_| Ok(())).expect("a search");
            assert_eq!(explorer.pairs(), pairs);
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
