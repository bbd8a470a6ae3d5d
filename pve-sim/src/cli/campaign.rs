//! The options of `campaign`.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueHint};
use hal_sim::campaign;

use super::{Request, UsageError};
use crate::campaign::{CellOptions, ExploreOptions, MergeOptions, Reports, RunOptions, Shard, Which};
use crate::run::seed;

/// The arguments of `campaign`.
#[derive(Args, Debug)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true, disable_help_subcommand = true)]
pub(super) struct CampaignArgs {
    #[command(subcommand)]
    command: Option<CampaignCommand>,

    /// The plan; docs/campaigns.md describes its format
    #[arg(value_name = "PLAN.toml", value_hint = ValueHint::FilePath, required_unless_present = "schema")]
    plan: Option<PathBuf>,

    /// Replace the seeds of the plan with one seed: 0–18446744073709551615
    #[arg(long, value_name = "N", value_parser = seed)]
    seed: Option<u64>,

    /// Run N rows at once [default: the number of processors]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,

    /// Run part K of N; `pve-sim campaign merge` joins the results
    #[arg(long, value_name = "K/N")]
    shard: Option<Shard>,

    /// Keep the complete rows in the results file, and run the others
    #[arg(long)]
    resume: bool,

    /// Run each cell from 0 ms instead of from a copy of the run without a fault; the verdicts are the same
    #[arg(long)]
    no_fork: bool,

    /// Run one cell alone, given by its number or ROW@MICROSECONDS, and print its explained trace
    #[arg(long, value_name = "CELL", conflicts_with_all = ["jobs", "shard", "resume", "no_fork", "results", "html", "csv", "json", "junit"])]
    cell: Option<Which>,

    /// Print the cells of the grid, one JSON value per line, and run none
    #[arg(long, conflicts_with_all = ["cell", "jobs", "shard", "resume", "no_fork", "results", "html", "csv", "json", "junit"])]
    list: bool,

    /// Search for pairs of faults that fail together only, for this time: 1–86400. --seed is the seed of the search
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(1..=86400), conflicts_with_all = ["cell", "list", "shard", "resume", "no_fork", "results", "html", "csv", "json", "junit"])]
    explore: Option<u32>,

    /// The folder for the scenarios of --explore, PLAN.find-N.toml [default: the current folder]
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath, requires = "explore")]
    finds: Option<PathBuf>,

    /// The results file, one JSON value per line [default: PLAN.results.jsonl, in the current folder]
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    results: Option<PathBuf>,

    #[command(flatten)]
    reports: ReportArgs,

    /// Print the format of a plan as a JSON schema, for editors
    #[arg(long, exclusive = true)]
    schema: bool,
}

#[derive(Debug, Subcommand)]
enum CampaignCommand {
    /// Joins the results of shards, and reports them; exit 1 if a limit is broken or a row is missing
    Merge(MergeArgs),
}

/// The arguments of `campaign merge`.
#[derive(Args, Debug)]
struct MergeArgs {
    /// The results files of the shards
    #[arg(value_name = "RESULTS", required = true, value_hint = ValueHint::FilePath)]
    files: Vec<PathBuf>,

    /// Write the joined results to FILE
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    results: Option<PathBuf>,

    #[command(flatten)]
    reports: ReportArgs,
}

/// The files of the reports.
#[derive(Args, Debug)]
struct ReportArgs {
    /// Write an HTML page with the matrix, reaction times and traces to FILE
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help_heading = "Reports")]
    html: Option<PathBuf>,

    /// Write the results to FILE as CSV, a line for each cell
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help_heading = "Reports")]
    csv: Option<PathBuf>,

    /// Write all results to FILE as one JSON document
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help_heading = "Reports")]
    json: Option<PathBuf>,

    /// Write the results to FILE as JUnit XML, a test case for each fault
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help_heading = "Reports")]
    junit: Option<PathBuf>,
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
fn check(reports: &Reports, results: Option<&Path>, inputs: &[PathBuf]) -> Result<(), UsageError> {
    let results = results.map(|path| ("--results", path));
    let outputs: Vec<(&str, &Path)> = reports.files().chain(results).collect();
    for (place, (option, path)) in outputs.iter().enumerate() {
        let is_toml = path.extension().is_some_and(|end| end == "toml");
        let is_same = |other: &Path| file(other) == file(path);
        let is_taken =
            inputs.iter().any(|input| is_same(input)) || outputs[..place].iter().any(|(_, other)| is_same(other));
        if is_toml || is_taken {
            let why = if is_toml { "a .toml file is a plan or a scenario" } else { "this file is given twice" };
            return Err(UsageError(format!("{option} {}: {why}; use a different file", path.display())));
        }
    }
    Ok(())
}

impl From<ReportArgs> for Reports {
    fn from(ReportArgs { html, csv, json, junit }: ReportArgs) -> Self {
        Self { html, csv, json, junit }
    }
}

impl TryFrom<CampaignArgs> for Request {
    type Error = UsageError;

    fn try_from(args: CampaignArgs) -> Result<Self, UsageError> {
        if args.schema {
            return Ok(Self::Print(campaign::schema()));
        }
        if let Some(CampaignCommand::Merge(MergeArgs { files, results, reports })) = args.command {
            let reports = reports.into();
            check(&reports, results.as_deref(), &files)?;
            return Ok(Self::Merge(MergeOptions { files, results, reports }));
        }
        let Some(plan) = args.plan else { return Err(UsageError("campaign needs PLAN.toml".to_owned())) };
        let (seed, shard) = (args.seed, args.shard);
        if args.list {
            return Ok(Self::Cells(plan, seed));
        }
        if let Some(seconds) = args.explore {
            let (jobs, finds) = (args.jobs.map(usize::from), args.finds.unwrap_or_else(|| ".".into()));
            return Ok(Self::Explore(ExploreOptions { plan, seed, seconds, jobs, finds }));
        }
        if let Some(which) = args.cell {
            return Ok(Self::Cell(CellOptions { plan, seed, which }));
        }
        let results = args.results.unwrap_or_else(|| {
            let name = plan.file_stem().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            let shard = shard.map_or_else(String::new, |shard| format!(".{}", shard.to_string().replace('/', "-of-")));
            format!("{name}{shard}.results.jsonl").into()
        });
        let reports = args.reports.into();
        check(&reports, Some(&results), std::slice::from_ref(&plan))?;
        let (jobs, forked) = (args.jobs.map(usize::from), !args.no_fork);
        Ok(Self::Campaign(RunOptions { plan, seed, jobs, shard, resume: args.resume, forked, results, reports }))
    }
}
