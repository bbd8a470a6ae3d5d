//! Campaigns: each fault of a plan at each instant of a scenario, and a verdict on each of these cells.
//!
//! ```text
//! file     the file format of a plan    plan     the checked plan
//! fault    its faults                   oracle   its oracles
//! cell     cells and their results      verdict  verdicts
//! ```

#![allow(dead_code, reason = "the runs of cells follow")]

mod cell;
mod fault;
mod file;
mod oracle;
mod plan;
mod verdict;

#[cfg(test)]
mod plan_tests;

pub use cell::{Cell, CellResult};
pub use file::schema;
pub use plan::{MAX_CELLS, Plan};
pub use verdict::{Limits, Observed, Verdict};
