//! Cells of a campaign and their results.

use protocol_core::time::Instant;

use super::verdict::Verdict;

/// A cell: one fault with one seed at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cell {
    /// The number of the row, from 0.
    pub row: usize,
    /// The instant of the fault.
    pub at: Instant,
}

/// The result of a cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellResult {
    /// The number of a grid cell, counted through all rows from 0; `None` for an instant that is not on the grid.
    pub number: Option<u64>,
    /// The number of the row, from 0.
    pub row: usize,
    /// The fault in words.
    pub fault: String,
    /// The seed of the run.
    pub seed: u64,
    /// The instant of the fault, in microseconds of virtual time.
    pub at_us: u64,
    /// True if the instant is not on the grid.
    pub refined: bool,
    /// The verdict.
    pub verdict: Verdict,
    /// The time from the fault to its detection, in microseconds.
    pub detected_us: Option<u64>,
    /// The time from the fault to the safe state, in microseconds; 0 if the safe state held from the fault on.
    pub safe_us: Option<u64>,
    /// The number of frames that a communication fault affected; for a plant or power fault, 1 if the plant or the
    /// power changed.
    pub struck: u64,
}

impl CellResult {
    /// Returns the reaction time in microseconds: the later of detection and safe state. `None` if neither occurred.
    #[must_use]
    pub fn reaction_us(&self) -> Option<u64> {
        self.detected_us.max(self.safe_us)
    }

    /// Returns the cell.
    #[must_use]
    pub const fn cell(&self) -> Cell {
        Cell { row: self.row, at: Instant::from_micros(self.at_us) }
    }

    /// Returns a key that orders cells by [severity](Verdict::severity).
    #[must_use]
    pub fn severity(&self) -> (Verdict, bool, u64) {
        self.verdict.severity(self.reaction_us())
    }
}
