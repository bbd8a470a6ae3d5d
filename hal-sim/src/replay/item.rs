//! An item of a replay: a frame from the log or from a simulated device.

use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant};

use super::fields::Field;

/// The maximum time between a logged frame and its partner, in addition to the tolerance (A).
pub(super) const PATIENCE: Duration = Duration::from_secs(1);

/// A frame from the log or from a simulated device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Item {
    /// The end of the frame.
    pub(super) at: Instant,
    pub(super) frame: Frame,
    /// The number of the log entry; `None` for a frame from a simulated device.
    pub(super) number: Option<u64>,
    /// The index of the simulated device that sent the frame; `None` for a log frame.
    pub(super) device: Option<usize>,
    /// The position fields; empty for a log frame.
    pub(super) fields: Vec<Field>,
}
