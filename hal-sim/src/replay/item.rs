//! An item of a replay: a frame of the log or of a simulated device.

use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant};

use super::fields::Fields;

/// The longest time between a logged frame and its partner, beyond the tolerance (A).
pub(super) const PATIENCE: Duration = Duration::from_secs(1);

/// A frame of the log or of a simulated device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Item {
    /// The end of the frame.
    pub(super) at: Instant,
    /// The frame.
    pub(super) frame: Frame,
    /// The entry of the log; `None` for a frame of a simulated device.
    pub(super) number: Option<u64>,
    /// The place of the simulated device that sent the frame; `None` for a logged frame.
    pub(super) device: Option<usize>,
    /// The position fields; empty for a logged frame.
    pub(super) fields: Fields,
}

impl Item {
    /// Returns an item for a logged frame.
    pub(super) fn logged(at: Instant, frame: Frame, number: u64) -> Self {
        Self { at, frame, number: Some(number), device: None, fields: Fields::default() }
    }

    /// Returns an item for a frame of a simulated device.
    pub(super) fn sent(at: Instant, frame: Frame, device: usize) -> Self {
        Self { at, frame, number: None, device: Some(device), fields: Fields::default() }
    }
}
