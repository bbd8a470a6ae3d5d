//! Campaigns inject faults into runs of a scenario, and judge the reaction of the controller.
//!
//! A *cell* is one fault with one seed at one instant. A *row* has the cells of one fault with one seed. A *golden run*
//! has no fault. The *oracles* of a plan are its proof of detection and its safe state.
//!
//! ```text
//! file     the file format of a plan    plan        the checked plan
//! fault    the faults of a plan         oracle      the oracles of a plan
//! master   kinds of controllers         controller  controllers in Rust
//! golden   golden runs                  run         rows and cells
//! rig      a run with its oracles       oracles     the oracles during a run
//! observe  the observation of a run     injection   the injection of one fault
//! cell     cells and their results      verdict     verdicts
//! explore/ the search for pairs of faults
//! judge    a cell whose controller is outside this library
//! ```

mod cell;
mod controller;
mod explore;
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
mod instant_tests;
#[cfg(test)]
mod judge_tests;
#[cfg(test)]
mod oracle_tests;
#[cfg(test)]
mod plan_tests;
#[cfg(test)]
mod tests;

pub use cell::{Cell, CellResult};
pub use controller::{CONTROLLER, Controlled, Controller, InRust};
pub use explore::{Explorer, Find, Pair, Tried};
pub use file::schema;
pub use golden::CampaignError;
pub use judge::Judge;
pub use master::{Master, Scripted, Subject};
pub use plan::{MAX_CELLS, Plan};
pub use run::{Campaign, Row};
pub use verdict::{Limits, Observed, Verdict};
