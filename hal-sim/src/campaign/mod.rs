//! Campaigns inject each fault of a plan at each instant of a scenario, and give a verdict on each of these cells.
//!
//! ```text
//! file     the file format of a plan    plan     the checked plan
//! fault    its faults                   oracle   its oracles
//! master   the controller               controller  controllers in Rust
//! golden   the runs without a fault     run      rows and cells, by forking
//! rig      a run with its oracles       oracles  the oracles while a cell runs
//! observe  a run with faults            injection  a fault in a run
//! cell     cells and their results      verdict  verdicts
//! judge    a cell whose controller is outside this library
//! ```

mod cell;
mod controller;
mod fault;
mod file;
mod golden;
mod injection;
mod judge;
mod master;
mod observe;
mod oracle;
mod oracles;
mod plan;
mod rig;
mod run;
mod verdict;

#[cfg(test)]
mod plan_tests;
#[cfg(test)]
mod tests;

pub use cell::{Cell, CellResult};
pub use controller::{CONTROLLER, Cloned, Controlled, Controller, Fresh};
pub use file::schema;
pub use golden::CampaignError;
pub use judge::Judge;
pub use master::{Master, Scripted, Subject};
pub use plan::{MAX_CELLS, Plan};
pub use run::{Campaign, Row};
pub use verdict::{Limits, Observed, Verdict};
