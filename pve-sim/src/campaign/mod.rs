//! Runs campaigns on all cores, keeps the results in a file, and writes the reports.
//!
//! ```text
//! run      runs the rows of a plan            results   results files, row by row
//! cell     runs one cell alone                manifest  plan, version and machine of results
//! merge    joins the results of shards        sink/     the reports: page, CSV, JSON, JUnit, summary
//! cores    tasks on threads, in order         progress  the progress line
//! plan     the plan and its golden runs       live      a cell whose controller is a program
//! program  a controller program               process   started processes, with their children
//! explore  the search for pairs of faults
//! ```

mod cell;
mod cores;
mod explore;
mod live;
mod manifest;
mod merge;
mod plan;
mod process;
mod program;
mod progress;
mod results;
mod run;
mod sink;

#[cfg(test)]
mod tests;

use std::path::PathBuf;

pub use cell::{CellOptions, Which, judged, list, run_cell};
pub use explore::{ExploreOptions, explore};
pub use manifest::Shard;
pub use merge::{MergeOptions, merge};
pub use results::ResultsError;
pub use run::{RunOptions, run};
pub use sink::{ReportError, Reports};

/// The reason why a campaign did not run to its end.
#[derive(Debug, thiserror::Error)]
pub enum CampaignError {
    /// Wrong usage: an unreadable plan, or an unknown cell.
    #[error("{0}")]
    Refused(String),
    /// The run without a fault fails.
    #[error("{0}")]
    Golden(String),
    /// A cell whose controller is a program cannot run.
    #[error("{0}")]
    Program(String),
    /// The results or reports cannot be written or read.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// A signal ended the campaign.
    #[error("interrupted; the complete rows are in {}; the same command with --resume continues", .0.display())]
    Interrupted(PathBuf),
    /// The simulation of a row panicked: a defect of pve-sim.
    #[error("defect of pve-sim: a row panicked; the complete rows are in {}", .0.display())]
    Panicked(PathBuf),
}

impl From<ResultsError> for CampaignError {
    fn from(error: ResultsError) -> Self {
        Self::Report(error.into())
    }
}
