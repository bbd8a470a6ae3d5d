//! The options of `campaign`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, Subcommand, ValueHint};
use hal_sim::campaign::{Campaign, Cell as Place};
use protocol_core::time::Instant;

use super::manifest::Shard;
use super::merge::MergeOptions;
use super::reports::Reports;
use crate::run::seed;

/// The arguments of `campaign`.
#[derive(Args, Clone, Debug)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true, disable_help_subcommand = true)]
pub struct CampaignOptions {
    #[command(subcommand)]
    pub(super) command: Option<CampaignCommand>,

    /// The plan; docs/campaigns.md describes its format
    #[arg(value_name = "PLAN.toml", value_hint = ValueHint::FilePath, required_unless_present = "schema")]
    pub(super) plan: Option<PathBuf>,

    /// Replace the seeds of the plan with one seed: 0–18446744073709551615
    #[arg(long, value_name = "N", value_parser = seed)]
    pub(super) seed: Option<u64>,

    /// Run N rows at once [default: the number of processors]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) jobs: Option<u16>,

    /// Run part K of N; `pve-sim campaign merge` joins the results
    #[arg(long, value_name = "K/N")]
    pub(super) shard: Option<Shard>,

    /// Keep the complete rows in the results file, and run the others
    #[arg(long)]
    pub(super) resume: bool,

    /// Run each cell from 0 ms instead of from a copy of the run without a fault; the verdicts are the same
    #[arg(long)]
    pub(super) no_fork: bool,

    /// Run one cell alone, given by its number or ROW@MICROSECONDS, and print its explained trace
    #[arg(long, value_name = "CELL", conflicts_with_all = ["jobs", "shard", "resume", "no_fork", "results", "html", "csv", "json", "junit"])]
    pub(super) cell: Option<Which>,

    /// Print the cells of the grid, one JSON value per line, and run none
    #[arg(long, conflicts_with_all = ["cell", "jobs", "shard", "resume", "no_fork", "results", "html", "csv", "json", "junit"])]
    pub(super) list: bool,

    /// Search for pairs of faults that fail together only, for this time: 1–86400. --seed is the seed of the search
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(1..=86400), conflicts_with_all = ["cell", "list", "shard", "resume", "no_fork", "results", "html", "csv", "json", "junit"])]
    pub(super) explore: Option<u32>,

    /// The folder for the scenarios of --explore, PLAN.find-N.toml [default: the current folder]
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath, requires = "explore")]
    pub(super) finds: Option<PathBuf>,

    /// The results file, one JSON value per line [default: PLAN.results.jsonl, in the current folder]
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub(super) results: Option<PathBuf>,

    #[command(flatten)]
    pub(super) reports: Reports,

    /// Print the format of a plan as a JSON schema, for editors
    #[arg(long, exclusive = true)]
    pub(super) schema: bool,
}

#[derive(Clone, Debug, Subcommand)]
pub(super) enum CampaignCommand {
    /// Joins the results of shards, and reports them; exit 1 if a limit is broken or a row is missing
    Merge(MergeOptions),
}

/// A cell on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// A cell of the grid by its number, as in `17`.
    Number(u64),
    /// A row and an instant in microseconds, as in `3@1234000`.
    At(usize, u64),
}

impl Which {
    /// Returns the cell; `None` if the campaign has no such cell.
    pub(super) fn of(self, campaign: &Campaign<'_>) -> Option<Place> {
        match self {
            Self::Number(number) => campaign.numbered(number),
            Self::At(row, at_us) => campaign.at(row, Instant::from_micros(at_us)),
        }
    }
}

impl FromStr for Which {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let which = match text.split_once('@') {
            None => text.parse().ok().map(Self::Number),
            Some((row, at)) => row.parse().ok().zip(at.parse().ok()).map(|(row, at)| Self::At(row, at)),
        };
        which.ok_or_else(|| "must be the number of a cell, as in 17, or ROW@MICROSECONDS, as in 3@1234000".to_owned())
    }
}
