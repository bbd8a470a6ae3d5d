//! Expected frames and the received frames that match them.

use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use crate::simulation::{Heard, History};
use crate::state::Pattern;

/// The expected frames of a step.
#[derive(Clone)]
pub(super) struct Frames<'a> {
    /// Each pattern, with the frame that matched it, if any.
    pub(super) wanted: Vec<(&'a Pattern, Option<Frame>)>,
    pub(super) any_order: bool,
    /// As in [`Expect::since`](super::step::Expect::since).
    pub(super) since: Option<Instant>,
    /// The number of the next event to check.
    pub(super) next: u64,
    /// The number of the event that follows the last matching frame.
    pub(super) mark: u64,
    /// The time of the last matching frame.
    pub(super) last: Instant,
}

impl Frames<'_> {
    /// Matches the frames received since the last call.
    pub(super) fn look(&mut self, history: &History) {
        if self.next == history.next() {
            return;
        }
        for heard in history.frames_since(self.next, self.since) {
            if self.claim(&heard) && self.are_all_there() {
                break;
            }
        }
        self.next = history.next();
    }

    /// Assigns a frame to an unmatched pattern. Returns whether the frame matched a pattern.
    pub(super) fn claim(&mut self, heard: &Heard) -> bool {
        let fulfils = self.take(heard.frame);
        if fulfils {
            (self.mark, self.last) = (heard.number + 1, heard.at);
        }
        fulfils
    }

    pub(super) fn are_all_there(&self) -> bool {
        self.wanted.iter().all(|(_, frame)| frame.is_some())
    }

    fn take(&mut self, frame: Frame) -> bool {
        if self.any_order {
            let mut tried = vec![false; self.wanted.len()];
            return self.place(frame, &mut tried);
        }
        let first = self.wanted.iter_mut().find(|(_, frame)| frame.is_none());
        let fulfilled = first.filter(|(pattern, _)| pattern.matches(&frame));
        fulfilled.is_some_and(|(_, place)| place.replace(frame).is_none())
    }

    /// Assigns a frame to any matching pattern. An assigned frame moves to another pattern if necessary, so that a
    /// general pattern never blocks a specific one. Returns whether the frame was assigned.
    fn place(&mut self, frame: Frame, tried: &mut [bool]) -> bool {
        for place in 0..self.wanted.len() {
            let (pattern, holder) = self.wanted[place];
            if tried[place] || !pattern.matches(&frame) {
                continue;
            }
            tried[place] = true;
            if holder.is_none_or(|holder| self.place(holder, tried)) {
                self.wanted[place].1 = Some(frame);
                return true;
            }
        }
        false
    }
}
