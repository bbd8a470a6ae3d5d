//! Frames delayed between the application and its CAN controller.

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;
use protocol_core::time::{Instant, NEVER, after};

use super::faults::{FaultId, Handed};
use super::transmit::Transmit;

/// The maximum number of delayed frames from a device or gateway. The application must keep further frames.
const MAX: usize = 256;

/// The maximum number of delayed frames including copies; further copies are not sent.
const MAX_COPIES: usize = 4096;

/// The maximum number of pending answers from a slow application (A); further answers are dropped.
const MAX_ANSWERS: usize = 32;

/// Delayed frames, in the order in which the application sent them.
#[derive(Clone, Debug, Default)]
pub(super) struct DelayedFrames(Vec<Delayed>);

#[derive(Clone, Copy, Debug)]
struct Delayed {
    handed: Handed,
    wait: Wait,
    /// True if this frame must be sent before the frame with which it was swapped.
    is_next: bool,
}

impl Delayed {
    const fn new(handed: Handed, wait: Wait) -> Self {
        Self { handed, wait, is_next: false }
    }

    /// Returns whether a fault delays the frame. The application considers such a frame sent. All other frames are slow
    /// answers, or wait for a free mailbox.
    fn is_sent(&self) -> bool {
        !self.handed.is_own && self.wait != Wait::Room
    }

    /// Returns whether later frames with the same identifier as `frame` must not overtake this frame.
    fn precedes(&self, frame: &Frame) -> bool {
        self.handed.frame.key() == frame.key() && !self.handed.is_overtaken
    }
}

/// The condition for the handover of a delayed frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wait {
    /// A point in time.
    Until(Instant),
    /// A free mailbox in the controller.
    Room,
    /// The sender's next frame, or this time at the latest. The fault swaps the two frames.
    Next(Instant, FaultId),
    /// The transmission of the frame with which this frame was swapped.
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

    /// Returns whether the maximum number of frames is delayed; copies do not count.
    pub(super) fn is_full(&self) -> bool {
        self.0.len() >= MAX && self.0.iter().filter(|delayed| !delayed.handed.is_copy).count() >= MAX
    }

    /// Returns whether the maximum number of answers from a slow application is pending.
    pub(super) fn is_full_of_answers(&self) -> bool {
        self.0.len() >= MAX_ANSWERS && self.0.iter().filter(|delayed| delayed.handed.is_own).count() >= MAX_ANSWERS
    }

    /// Returns whether the application has no pending frame here: no slow answer, and no frame that waits for a free
    /// mailbox. Frames delayed by a fault do not count, because the application considers them sent.
    pub(super) fn is_idle(&self) -> bool {
        self.0.iter().all(|delayed| delayed.handed.is_copy || delayed.is_sent())
    }

    /// Takes the frames that a fault delays, and drops all other frames.
    pub(super) fn take_away(&mut self) -> Self {
        Self(std::mem::take(&mut self.0).into_iter().filter(Delayed::is_sent).collect())
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Drops the frames that pass `which` and wait for a free mailbox, because the application expects them to be in a
    /// mailbox. All other delayed frames are dropped only by [`Filter::ALL`].
    pub(super) fn abort(&mut self, which: Filter) {
        let is_all = which == Filter::ALL;
        self.0.retain(|delayed| !which.passes(&delayed.handed.frame) || !(is_all || delayed.wait == Wait::Room));
    }

    /// Returns whether a new frame must queue behind a delayed frame.
    pub(super) fn holds_back(&self, frame: &Frame) -> bool {
        self.0.iter().any(|delayed| match delayed.wait {
            Wait::Until(_) | Wait::Room => delayed.precedes(frame),
            Wait::Next(..) => false,
            Wait::Sent => true,
        })
    }

    /// Delays a frame. Its handover follows the handover of earlier frames with the same identifier, unless these
    /// frames may be overtaken.
    pub(super) fn add(&mut self, handed: Handed, now: Instant) {
        if handed.is_copy && self.0.len() >= MAX_COPIES {
            return;
        }
        let due = after(now, handed.late);
        let last = self.0.iter().filter_map(|delayed| match delayed.wait {
            Wait::Until(due) if delayed.precedes(&handed.frame) => Some(due),
            _ => None,
        });
        let wait = match handed.swaps {
            Some((within, fault)) => Wait::Next(after(due, within), fault),
            None => Wait::Until(last.max().map_or(due, |last| last.max(due))),
        };
        self.0.push(Delayed::new(handed, wait));
    }

    /// Queues a frame for a free mailbox.
    pub(super) fn queue(&mut self, frame: &Frame) {
        self.0.push(Delayed::new(Handed::at_once(frame), Wait::Room));
    }

    /// Returns the index of the frame to be swapped with the sender's next frame, and the fault that swaps the frames.
    pub(super) fn swapped(&self) -> Option<(usize, FaultId)> {
        self.0.iter().enumerate().find_map(|(place, delayed)| match delayed.wait {
            Wait::Next(_, fault) => Some((place, fault)),
            _ => None,
        })
    }

    /// Places the frame at index `swapped` after the sender's next frame. `next` is the index of the next frame if a
    /// fault delays it, otherwise the number of delayed frames.
    pub(super) fn follow(&mut self, swapped: usize, next: usize) {
        if let Some(next) = self.0.get_mut(next) {
            next.is_next = true;
        }
        let swapped = Delayed { wait: Wait::Sent, ..self.0.remove(swapped) };
        self.0.insert(next.min(self.0.len()), swapped);
    }

    /// Hands the due frames to the controller; a refused frame waits for a free mailbox. Returns whether any frame was
    /// accepted.
    pub(super) fn release(&mut self, transmit: &mut Transmit, now: Instant) -> bool {
        let (mut place, mut has_released) = (0, false);
        while let Some(delayed) = self.0.get(place).copied() {
            let is_due = match delayed.wait {
                Wait::Until(due) | Wait::Next(due, _) => due <= now,
                Wait::Room => true,
                Wait::Sent => transmit.is_empty() && !self.0[..place].iter().any(|earlier| earlier.is_next),
            };
            if !is_due && delayed.wait == Wait::Sent {
                // A swapped frame blocks all later frames.
                break;
            }
            if !is_due {
                place += 1;
            } else if let Ok(overtaken) = transmit.put(delayed.handed.frame) {
                has_released = true;
                self.0.remove(place);
                if let Some(frame) = overtaken {
                    self.0.insert(0, Delayed::new(Handed::at_once(&frame), Wait::Room));
                    place += 1;
                }
            } else {
                self.0[place].wait = Wait::Room;
                place += 1;
            }
        }
        has_released
    }

    /// Returns the time of the next handover. Frames that wait for a free mailbox or behind a swapped frame are not
    /// considered.
    pub(super) fn next_due(&self) -> Instant {
        let dues =
            self.0.iter().take_while(|delayed| delayed.wait != Wait::Sent).filter_map(|delayed| match delayed.wait {
                Wait::Until(due) | Wait::Next(due, _) => Some(due),
                Wait::Room | Wait::Sent => None,
            });
        dues.min().unwrap_or(NEVER)
    }
}
