//! Runs campaigns on all cores, keeps the results in a file, and writes the reports.
//!
//! ```text
//! options  the options                        command   executes the options
//! plan     the plan and its golden runs       progress  the progress line
//! run      runs the rows of a plan            results   results files, row by row
//! cell     runs one cell alone                manifest  plan, version and machine of results
//! merge    joins the results of shards        reports/  the reports: page, CSV, JSON, JUnit, summary
//! explore  the search for pairs of faults     live      a cell whose controller is a program
//! program  a controller program               process   started processes, with their children
//! ```

mod cell;
mod command;
mod explore;
mod live;
mod manifest;
mod merge;
mod options;
mod plan;
mod process;
mod program;
mod progress;
mod reports;
mod results;
mod run;

#[cfg(test)]
mod tests;

pub use cell::{CellOptions, judged};
pub use command::run;
pub use options::{CampaignOptions, Which};
