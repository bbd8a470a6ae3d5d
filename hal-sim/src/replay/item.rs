//! A frame of a replay: logged, or sent by a stand-in.

use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant};

use super::fields::Fields;

/// The longest time before or after its place in the log at which a frame is still the same one, beyond the
/// tolerance (A).
pub(super) const PATIENCE: Duration = Duration::from_secs(1);

/// A frame that was logged, or sent by a stand-in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Item {
    /// The end of the frame.
    pub(super) at: Instant,
    /// The frame.
    pub(super) frame: Frame,
    /// The entry of the log; `None` for one that was sent.
    pub(super) number: Option<u64>,
    /// The place of the stand-in that sent it; `None` for one that was logged.
    pub(super) device: Option<usize>,
    /// The fields that carry a position; none for one that was logged.
    pub(super) fields: Fields,
}

impl Item {
    /// Returns a frame of an entry of the log.
    pub(super) fn logged(at: Instant, frame: Frame, number: u64) -> Self {
        Self { at, frame, number: Some(number), device: None, fields: Fields::default() }
    }

    /// Returns a frame that a stand-in has sent.
    pub(super) fn sent(at: Instant, frame: Frame, device: usize) -> Self {
        Self { at, frame, number: None, device: Some(device), fields: Fields::default() }
    }
}
