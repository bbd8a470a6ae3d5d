//! Frames that faults hold back between the application and its CAN controller.

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;
use protocol_core::time::{Instant, NEVER, after};

use super::faults::Handed;
use super::transmit::Transmit;

/// Delayed frames, in the order in which the application sent them.
#[derive(Clone, Debug, Default)]
pub(super) struct DelayedFrames(Vec<Delayed>);

/// A delayed frame.
#[derive(Clone, Copy, Debug)]
struct Delayed {
    frame: Frame,
    /// The time of the handover to the controller; [`NEVER`] while the frame waits for a free mailbox or for another
    /// frame.
    due: Instant,
    wait: Wait,
    /// Whether later frames with the same identifier may overtake this frame.
    is_overtaken: bool,
}

/// An additional condition for the handover.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wait {
    /// No condition.
    No,
    /// The sender hands over its next frame.
    Next,
    /// The sender's next frame has been transmitted.
    Sent,
}

impl DelayedFrames {
    pub(super) const fn len(&self) -> usize {
        self.0.len()
    }

    #[inline]
    pub(super) const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Drops all frames.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Drops the frames with these identifiers.
    pub(super) fn abort(&mut self, which: Filter) {
        self.0.retain(|delayed| !which.passes(&delayed.frame));
    }

    /// Returns whether a new frame has to wait behind a delayed frame.
    pub(super) fn holds_back(&self, frame: &Frame) -> bool {
        self.0.iter().any(|delayed| match delayed.wait {
            Wait::No => delayed.frame.key() == frame.key() && !delayed.is_overtaken,
            Wait::Next => false,
            Wait::Sent => true,
        })
    }

    /// Adds a frame. It stays behind earlier frames with the same identifier unless those may be overtaken.
    pub(super) fn add(&mut self, handed: Handed, now: Instant) {
        let Handed { frame, late, is_overtaken, swaps } = handed;
        let due = after(now, late);
        let is_ahead = |delayed: &&Delayed| {
            delayed.wait == Wait::No
                && delayed.due != NEVER
                && delayed.frame.key() == frame.key()
                && !delayed.is_overtaken
        };
        let last = self.0.iter().filter(is_ahead).map(|delayed| delayed.due).max();
        let (due, wait) = match swaps {
            Some(within) => (after(due, within), Wait::Next),
            None => (last.map_or(due, |last| last.max(due)), Wait::No),
        };
        self.0.push(Delayed { frame, due, wait, is_overtaken });
    }

    /// Returns the index of the first frame that waits for the next frame of its sender.
    pub(super) fn next_swapped(&self) -> Option<usize> {
        self.0.iter().position(|delayed| delayed.wait == Wait::Next)
    }

    /// Schedules a frame for after the transmission of the frame that was just handed over.
    pub(super) fn let_follow(&mut self, place: usize) {
        let delayed = &mut self.0[place];
        (delayed.wait, delayed.due) = (Wait::Sent, NEVER);
    }

    /// Hands over the due frames that the controller accepts; returns whether it accepted any.
    pub(super) fn release(&mut self, transmit: &mut Transmit, now: Instant) -> bool {
        let (mut place, mut has_released) = (0, false);
        while let Some(delayed) = self.0.get_mut(place) {
            let is_due = match delayed.wait {
                Wait::No => delayed.due <= now || delayed.due == NEVER,
                Wait::Next => delayed.due <= now,
                Wait::Sent => transmit.is_empty(),
            };
            if !is_due && delayed.wait == Wait::Sent {
                // All later frames wait behind this frame.
                break;
            }
            if !is_due {
                place += 1;
                continue;
            }
            if let Ok(overtaken) = transmit.put(delayed.frame) {
                has_released = true;
                self.0.remove(place);
                if let Some(frame) = overtaken {
                    self.0.insert(0, Delayed { frame, due: NEVER, wait: Wait::No, is_overtaken: false });
                    place += 1;
                }
            } else {
                (delayed.due, delayed.wait) = (NEVER, Wait::No);
                place += 1;
            }
        }
        has_released
    }

    /// Returns the next scheduled handover; frames that wait for a free mailbox are not considered.
    pub(super) fn next_due(&self) -> Instant {
        self.0.iter().map(|delayed| delayed.due).min().unwrap_or(NEVER)
    }
}
