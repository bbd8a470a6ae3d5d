//! Prepares a campaign: reads the plan, and runs its scenario without a fault.

use std::fs;
use std::path::Path;

use hal_sim::campaign::{Campaign, Plan};
use hal_sim::scenario::ReadError;
use protocol_core::time::Duration;

use super::live::Live;
use super::manifest::{FORMAT, LimitsUs, Manifest, hash, machine};
use crate::output::CommandError;

/// A campaign that can run, with the manifest of its results.
pub(super) struct Prepared {
    pub(super) campaign: Campaign<'static>,
    pub(super) manifest: Manifest,
    /// The setup of the controller program, if the plan has one.
    pub(super) live: Option<Live>,
}

/// Reads a plan and runs its scenario without a fault.
pub(super) fn prepare(path: &Path, seed: Option<u64>, forked: bool) -> Result<Prepared, CommandError> {
    let name = path.display();
    let text = fs::read_to_string(path).map_err(|error| CommandError::Refused(format!("{name}: {error}")))?;
    let mut scenario = String::new();
    let read = |file: &str| {
        let text =
            fs::read_to_string(path.with_file_name("").join(file)).map_err(|error| format!("{file}: {error}"))?;
        scenario.clone_from(&text);
        Ok(text)
    };
    let plan = Plan::parse(&text, read).map_err(|ReadError { line, reason }| {
        let line = line.map_or_else(String::new, |line| format!("{line}:"));
        CommandError::Refused(format!("{name}:{line} {reason}"))
    })?;
    let plan = seed.into_iter().fold(plan, Plan::with_seed);
    let us = |time: Option<Duration>| time.map(|time| time.as_micros());
    let limits = LimitsUs {
        detected_us: us(plan.limits().detected),
        safe_us: us(plan.limits().safe),
        observe_us: plan.observe().as_micros(),
    };
    let (title, seeds) = (plan.title().to_owned(), plan.seeds().to_vec());
    // The plan lives as long as the process, because threads that are not joined use it.
    let plan: &'static Plan = Box::leak(Box::new(plan));
    let campaign = Campaign::new(plan).map_err(|error| CommandError::Failed(format!("{name}: {error}")))?;
    let campaign = if forked { campaign } else { campaign.without_forks() };
    let live =
        plan.controller().map(|(words, speed)| Live { controller: words.to_vec(), plan: path.to_owned(), seed, speed });
    let manifest = Manifest {
        format: FORMAT,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: option_env!("PVE_SIM_COMMIT").map(str::to_owned),
        plan: if cfg!(windows) {
            path.to_string_lossy().replace('\\', "/")
        } else {
            path.to_string_lossy().into_owned()
        },
        plan_hash: hash(&text, &scenario),
        title,
        seeds,
        seed,
        shard: None,
        rows: campaign.rows().len(),
        limits,
        forked: forked && live.is_none(),
        machine: machine(),
        missing: None,
    };
    Ok(Prepared { campaign, manifest, live })
}
