//! What waits to be sent: bounded, most urgent first.

use heapless::Vec;

use crate::frame::Frame;

/// How many frames can wait: an answer or two of every service, and PDOs for a bus that is busy for some milliseconds.
const CAPACITY: usize = 16;

/// Frames in the order of arbitration, first come first served among equals.
#[derive(Debug, Default)]
pub(crate) struct TxQueue {
    /// The most urgent one last.
    frames: Vec<Frame, CAPACITY>,
    dropped: u32,
}

impl TxQueue {
    /// Appends a frame. When there is no room, the least urgent one is dropped and counted.
    #[inline]
    pub(crate) fn push(&mut self, frame: Frame) {
        // Mostly nothing waits, and there is room.
        if !self.frames.is_empty() || self.frames.push(frame).is_err() {
            self.sort_in(frame);
        }
    }

    #[inline(never)]
    fn sort_in(&mut self, frame: Frame) {
        let key = frame.arbitration();
        let position = self.frames.iter().rposition(|waiting| waiting.arbitration() > key);
        self.insert(position.map_or(0, |position| position.saturating_add(1)), frame);
    }

    /// Puts a frame in the place of one with the same identifier that still waits, or appends it: of what is sent in a
    /// cycle, a bus that was blocked for a while gets the latest, not everything.
    #[inline]
    pub(crate) fn push_latest(&mut self, frame: Frame) {
        if self.frames.is_empty() || !self.replace(frame) {
            self.push(frame);
        }
    }

    #[inline(never)]
    fn replace(&mut self, frame: Frame) -> bool {
        let waiting = self.frames.iter_mut().find(|waiting| waiting.key() == frame.key());
        waiting.map(|waiting| *waiting = frame).is_some()
    }

    /// Takes back a frame that was handed out: it goes before its equals.
    pub(crate) fn give_back(&mut self, frame: Frame) {
        let key = frame.arbitration();
        let position = self.frames.iter().rposition(|waiting| waiting.arbitration() >= key);
        self.insert(position.map_or(0, |position| position.saturating_add(1)), frame);
    }

    /// The most urgent frame.
    pub(crate) fn pop(&mut self) -> Option<Frame> {
        self.frames.pop()
    }

    /// Whether nothing waits.
    pub(crate) fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Forgets all: the bus cannot be used.
    pub(crate) fn clear(&mut self) {
        self.frames.clear();
    }

    /// A frame was lost elsewhere for want of room.
    pub(crate) const fn count_dropped(&mut self) {
        self.dropped = self.dropped.saturating_add(1);
    }

    /// How many frames were dropped for want of room.
    pub(crate) const fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Puts a frame at a position; what is more urgent moves up, or, when there is no room, what is less urgent down and
    /// out.
    fn insert(&mut self, position: usize, frame: Frame) {
        let mut carried = frame;
        if self.frames.is_full() {
            self.count_dropped();
            for slot in self.frames.iter_mut().take(position).rev() {
                core::mem::swap(slot, &mut carried);
            }
        } else {
            for slot in self.frames.iter_mut().skip(position) {
                core::mem::swap(slot, &mut carried);
            }
            // There is room.
            let _ = self.frames.push(carried);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::standard;

    fn frame(id: u16, tag: u8) -> Frame {
        Frame::of(standard(id).into(), &[tag]).unwrap()
    }

    #[test]
    fn urgent_frames_first_and_equals_in_order() {
        let mut queue = TxQueue::default();
        for (id, tag) in [(0x5A0, 1), (0x1A0, 2), (0x5A0, 3), (0x1A0, 4)] {
            queue.push(frame(id, tag));
        }
        let first = queue.pop().unwrap();
        assert_eq!(first, frame(0x1A0, 2));
        queue.give_back(first);
        for (id, tag) in [(0x1A0, 2), (0x1A0, 4), (0x5A0, 1), (0x5A0, 3)] {
            assert_eq!(queue.pop(), Some(frame(id, tag)));
        }
        assert_eq!(queue.pop(), None);
    }

    #[test]
    fn the_latest_takes_the_place_of_one_that_waits() {
        let mut queue = TxQueue::default();
        queue.push_latest(frame(0x720, 1));
        queue.push(frame(0x5A0, 2));
        queue.push_latest(frame(0x720, 3));
        for expected in [frame(0x5A0, 2), frame(0x720, 3)] {
            assert_eq!(queue.pop(), Some(expected));
        }
        assert_eq!(queue.pop(), None);
    }

    #[test]
    fn a_full_queue_drops_the_least_urgent_and_counts() {
        let mut queue = TxQueue::default();
        for id in 1..=CAPACITY as u16 {
            queue.push(frame(id * 2, 0));
        }
        queue.push(frame(0x7FF, 0));
        assert_eq!(queue.dropped(), 1);
        queue.push(frame(1, 0));
        assert_eq!(queue.dropped(), 2);
        assert_eq!(queue.pop(), Some(frame(1, 0)));
        assert_eq!(std::iter::from_fn(|| queue.pop()).last(), Some(frame(CAPACITY as u16 * 2 - 2, 0)));
    }

    extern crate std;
}
