//! Frames delayed between the application and its CAN controller.

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, NEVER, after};

use super::fault::FaultId;
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

/// A frame on the way from the application to its controller.
#[derive(Clone, Copy, Debug)]
pub(super) struct Delayed {
    pub(super) frame: Frame,
    /// The earliest time of the handover, and the start of a wait for the sender's next frame.
    pub(super) due: Instant,
    pub(super) wait: Wait,
    /// True if later frames with the same identifier may overtake this frame.
    pub(super) is_overtaken: bool,
    /// True if the frame is a copy made by a fault.
    pub(super) is_copy: bool,
    /// The fault that counts an affected frame at the handover of this frame, its first copy.
    pub(super) counted_by: Option<FaultId>,
    /// True if the slow application itself delays the frame.
    pub(super) is_own: bool,
    /// True if this frame must be sent before the frame with which it was swapped.
    pub(super) is_next: bool,
}

/// The condition for the handover of a delayed frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wait {
    /// The time [`Delayed::due`].
    Time,
    /// A free mailbox in the controller.
    Room,
    /// The sender's next frame, or this time after [`Delayed::due`] at the latest. The fault swaps the two frames.
    Next(Duration, FaultId),
    /// The transmission of the frame with which this frame was swapped.
    Sent,
}

impl Delayed {
    /// Creates the handover of an unaffected frame.
    pub(super) const fn new(frame: Frame, due: Instant) -> Self {
        Self {
            frame,
            due,
            wait: Wait::Time,
            is_overtaken: false,
            is_copy: false,
            counted_by: None,
            is_own: false,
            is_next: false,
        }
    }

    /// Delays the handover further.
    pub(super) fn delay(&mut self, late: Duration) {
        self.due = after(self.due, late);
    }

    /// Returns the time of the handover; `None` for a frame that waits for a free mailbox or behind a swapped frame.
    fn handover(&self) -> Option<Instant> {
        match self.wait {
            Wait::Time => Some(self.due),
            Wait::Next(within, _) => Some(after(self.due, within)),
            Wait::Room | Wait::Sent => None,
        }
    }

    /// Returns whether a fault delays the frame. The application considers such a frame sent. All other frames are slow
    /// answers, or wait for a free mailbox.
    fn is_sent(&self) -> bool {
        !self.is_own && self.wait != Wait::Room
    }

    /// Returns whether later frames with the same identifier as `frame` must not overtake this frame.
    fn precedes(&self, frame: &Frame) -> bool {
        self.frame.key() == frame.key() && !self.is_overtaken
    }
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
        self.0.len() >= MAX && self.0.iter().filter(|delayed| !delayed.is_copy).count() >= MAX
    }

    /// Returns whether the maximum number of answers from a slow application is pending.
    pub(super) fn is_full_of_answers(&self) -> bool {
        self.0.iter().filter(|delayed| delayed.is_own).count() >= MAX_ANSWERS
    }

    /// Returns whether a frame that passes `which` is pending for the application: a slow answer, or a frame that waits
    /// for a free mailbox. Frames delayed by a fault do not count, because the application considers them sent.
    pub(super) fn holds(&self, which: Filter) -> bool {
        self.0.iter().any(|delayed| !delayed.is_copy && !delayed.is_sent() && which.passes(&delayed.frame))
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
        self.0.retain(|delayed| !which.passes(&delayed.frame) || !(is_all || delayed.wait == Wait::Room));
    }

    /// Returns whether a new frame must queue behind a delayed frame.
    pub(super) fn holds_back(&self, frame: &Frame) -> bool {
        self.0.iter().any(|delayed| match delayed.wait {
            Wait::Time | Wait::Room => delayed.precedes(frame),
            Wait::Next(..) => false,
            Wait::Sent => true,
        })
    }

    /// Delays a frame. Its handover follows the handover of earlier frames with the same identifier, unless these
    /// frames may be overtaken.
    pub(super) fn add(&mut self, mut delayed: Delayed) {
        if delayed.is_copy && self.0.len() >= MAX_COPIES {
            return;
        }
        if delayed.wait == Wait::Time {
            let precedes = |earlier: &&Delayed| earlier.wait == Wait::Time && earlier.precedes(&delayed.frame);
            let last = self.0.iter().filter(precedes).map(|earlier| earlier.due).max();
            delayed.due = last.map_or(delayed.due, |last| last.max(delayed.due));
        }
        self.0.push(delayed);
    }

    /// Queues a frame for a free mailbox.
    pub(super) fn queue(&mut self, frame: Frame, now: Instant) {
        self.0.push(Delayed { wait: Wait::Room, ..Delayed::new(frame, now) });
    }

    /// Returns the index of the frame to be swapped with the sender's next frame, and the fault that swaps the frames.
    pub(super) fn swapped(&self) -> Option<(usize, FaultId)> {
        self.0.iter().enumerate().find_map(|(place, delayed)| match delayed.wait {
            Wait::Next(_, fault) => Some((place, fault)),
            _ => None,
        })
    }

    /// Returns the number of frames that `fault` has affected but not yet counted: they wait for their exchange, or
    /// their first copy is pending.
    pub(super) fn uncounted(&self, fault: FaultId) -> usize {
        let is_uncounted = |delayed: &&Delayed| match delayed.wait {
            Wait::Next(_, swaps) => swaps == fault,
            _ => delayed.counted_by == Some(fault),
        };
        self.0.iter().filter(is_uncounted).count()
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

    /// Hands the due frames to the controller; a refused frame waits for a free mailbox. Calls `count` for each fault
    /// that counts an accepted frame. Returns whether any frame was accepted.
    pub(super) fn release(&mut self, transmit: &mut Transmit, now: Instant, mut count: impl FnMut(FaultId)) -> bool {
        let (mut place, mut has_released) = (0, false);
        while let Some(delayed) = self.0.get(place).copied() {
            if delayed.wait == Wait::Sent
                && (!transmit.is_empty() || self.0[..place].iter().any(|earlier| earlier.is_next))
            {
                // A swapped frame blocks all later frames.
                break;
            }
            if delayed.handover().is_some_and(|handover| handover > now) {
                place += 1;
            } else if let Ok(overtaken) = transmit.put(delayed.frame) {
                has_released = true;
                self.0.remove(place);
                delayed.counted_by.into_iter().for_each(&mut count);
                if let Some(frame) = overtaken {
                    self.0.insert(0, Delayed { wait: Wait::Room, ..Delayed::new(frame, now) });
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
    pub(super) fn next_handover(&self) -> Instant {
        let movable = self.0.iter().take_while(|delayed| delayed.wait != Wait::Sent);
        movable.filter_map(Delayed::handover).min().unwrap_or(NEVER)
    }
}
