//! Frames that faults hold back between the application and its CAN controller.

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;
use protocol_core::time::{Instant, NEVER, after};

use super::faults::Handed;
use super::transmit::Transmit;

/// The maximum number of delayed frames of a device or gateway, which keeps further frames.
const MAX: usize = 256;

/// Delayed frames, in the order in which the application sent them.
#[derive(Clone, Debug, Default)]
pub(super) struct DelayedFrames(Vec<Delayed>);

/// A delayed frame.
#[derive(Clone, Copy, Debug)]
struct Delayed {
    frame: Frame,
    wait: Wait,
    /// Whether later frames with the same identifier may overtake this frame.
    is_overtaken: bool,
    /// The frame behind it was swapped with it.
    is_next: bool,
    /// A copy, which the application has not sent.
    is_copy: bool,
}

/// The event that a delayed frame waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wait {
    /// An instant.
    Until(Instant),
    /// Room in the controller.
    Room,
    /// The next frame of its sender, or an instant.
    Next(Instant),
    /// The end of the frame before it on the bus.
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

    /// Returns whether the sender has to keep further frames.
    pub(super) const fn is_full(&self) -> bool {
        self.0.len() >= MAX
    }

    /// Returns whether no frame of the application waits.
    pub(super) fn is_idle(&self) -> bool {
        self.0.iter().all(|delayed| delayed.is_copy)
    }

    /// Drops all frames.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Drops the frames of these identifiers that wait for room, as those in a transmit buffer; frames that a fault still
    /// delays go on, unless everything is aborted.
    pub(super) fn abort(&mut self, which: Filter) {
        let is_all = which == Filter::ALL;
        self.0.retain(|delayed| !which.passes(&delayed.frame) || !(is_all || delayed.wait == Wait::Room));
    }

    /// Returns whether a new frame has to wait behind a delayed frame.
    pub(super) fn holds_back(&self, frame: &Frame) -> bool {
        self.0.iter().any(|delayed| match delayed.wait {
            Wait::Until(_) | Wait::Room => delayed.frame.key() == frame.key() && !delayed.is_overtaken,
            Wait::Next(_) => false,
            Wait::Sent => true,
        })
    }

    /// Delays a frame. It waits behind earlier ones of its identifier, unless they are overtaken.
    pub(super) fn add(&mut self, handed: Handed, now: Instant) {
        let Handed { frame, late, is_overtaken, is_copy, swaps } = handed;
        let due = after(now, late);
        let last = self.0.iter().filter_map(|delayed| match delayed.wait {
            Wait::Until(due) if delayed.frame.key() == frame.key() && !delayed.is_overtaken => Some(due),
            _ => None,
        });
        let wait = match swaps {
            Some(within) => Wait::Next(after(due, within)),
            None => Wait::Until(last.max().map_or(due, |last| last.max(due))),
        };
        self.0.push(Delayed { frame, wait, is_overtaken, is_next: false, is_copy });
    }

    /// Returns the place of the frame that waits for the next one of its sender.
    pub(super) fn swapped(&self) -> Option<usize> {
        self.0.iter().position(|delayed| matches!(delayed.wait, Wait::Next(_)))
    }

    /// Puts a swapped frame behind the next one of its sender, which is at place `next` if it is delayed itself.
    pub(super) fn follow(&mut self, swapped: usize, next: usize) {
        if let Some(next) = self.0.get_mut(next) {
            next.is_next = true;
        }
        let swapped = Delayed { wait: Wait::Sent, ..self.0.remove(swapped) };
        self.0.insert(next.min(self.0.len()), swapped);
    }

    /// Hands over the due frames that the controller accepts; returns whether it accepted any.
    pub(super) fn release(&mut self, transmit: &mut Transmit, now: Instant) -> bool {
        let (mut place, mut has_released) = (0, false);
        while let Some(delayed) = self.0.get(place).copied() {
            let is_due = match delayed.wait {
                Wait::Until(due) | Wait::Next(due) => due <= now,
                Wait::Room => true,
                Wait::Sent => transmit.is_empty() && !self.0[..place].iter().any(|earlier| earlier.is_next),
            };
            if !is_due && delayed.wait == Wait::Sent {
                // All later frames wait behind it.
                break;
            }
            if !is_due {
                place += 1;
            } else if let Ok(overtaken) = transmit.put(delayed.frame) {
                has_released = true;
                self.0.remove(place);
                if let Some(frame) = overtaken {
                    let room = Delayed { frame, wait: Wait::Room, is_overtaken: false, is_next: false, is_copy: false };
                    self.0.insert(0, room);
                    place += 1;
                }
            } else {
                self.0[place].wait = Wait::Room;
                place += 1;
            }
        }
        has_released
    }

    /// Returns the next scheduled handover; frames that wait for a free mailbox are not considered.
    pub(super) fn next_due(&self) -> Instant {
        let dues =
            self.0.iter().take_while(|delayed| delayed.wait != Wait::Sent).filter_map(|delayed| match delayed.wait {
                Wait::Until(due) | Wait::Next(due) => Some(due),
                Wait::Room | Wait::Sent => None,
            });
        dues.min().unwrap_or(NEVER)
    }
}
