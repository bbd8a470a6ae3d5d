//! Executes `campaign`.

use std::io::Write;
use std::path::{Path, PathBuf};

use hal_sim::campaign::schema;

use super::cell::{CellOptions, list, run_cell};
use super::explore::explore;
use super::merge::merge;
use super::options::{CampaignCommand, CampaignOptions};
use super::reports::Reports;
use super::run::run_campaign;
use crate::output::CommandError;

/// Executes `campaign`, and writes its output to `out`. Returns whether the campaign passed. Errors of `out` are
/// ignored.
///
/// # Errors
/// [`CommandError`]
pub fn run(options: &CampaignOptions, out: &mut dyn Write) -> Result<bool, CommandError> {
    if options.schema {
        let _ = out.write_all(schema().as_bytes());
        return Ok(true);
    }
    if let Some(CampaignCommand::Merge(options)) = &options.command {
        check(&options.reports, options.results.as_deref(), &options.files)?;
        return merge(options, out);
    }
    let Some(plan) = &options.plan else { return Err(CommandError::Refused("campaign needs PLAN.toml".to_owned())) };
    if options.list {
        return list(plan, options.seed, out);
    }
    if let Some(seconds) = options.explore {
        return explore(plan, seconds, options, out);
    }
    if let Some(which) = options.cell {
        return run_cell(&CellOptions { plan: plan.clone(), seed: options.seed, which }, out);
    }
    let results = options.results.clone().unwrap_or_else(|| {
        let name = plan.file_stem().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let shard =
            options.shard.map_or_else(String::new, |shard| format!(".{}", shard.to_string().replace('/', "-of-")));
        format!("{name}{shard}.results.jsonl").into()
    });
    check(&options.reports, Some(&results), std::slice::from_ref(plan))?;
    run_campaign(plan, &results, options, out)
}

/// Returns the absolute path of a file that may not exist yet, without links.
fn file(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        path.file_name().map_or_else(|| path.to_owned(), |name| folder.join(name))
    })
}

/// Refuses an output file that is a plan, a scenario, an input, or another output.
fn check(reports: &Reports, results: Option<&Path>, inputs: &[PathBuf]) -> Result<(), CommandError> {
    let results = results.map(|path| ("--results", path));
    let outputs: Vec<(&str, &Path)> = reports.files().chain(results).collect();
    for (place, (option, path)) in outputs.iter().enumerate() {
        let is_toml = path.extension().is_some_and(|end| end == "toml");
        let is_same = |other: &Path| file(other) == file(path);
        let is_taken =
            inputs.iter().any(|input| is_same(input)) || outputs[..place].iter().any(|(_, other)| is_same(other));
        if is_toml || is_taken {
            let why = if is_toml { "a .toml file is a plan or a scenario" } else { "this file is given twice" };
            return Err(CommandError::Refused(format!("{option} {}: {why}; use a different file", path.display())));
        }
    }
    Ok(())
}
