//! What the node owes to the bus: news, of each kind one frame at most, and answers in their order.

use heapless::Vec;

use crate::frame::Frame;

/// A frame that tells a state, the most urgent in arbitration first. It is rendered when the controller can take it, so it
/// tells the state of that instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum News {
    /// The product's report.
    Report = 1,
    /// The claim, or the cannot-claim.
    Claim = 2,
    /// DM1.
    Dm1 = 4,
    /// DM2.
    Dm2 = 8,
    /// The next frame of a broadcast in packets.
    Packet = 16,
}

impl News {
    /// All kinds.
    pub(super) const ALL: [Self; 5] = [Self::Report, Self::Claim, Self::Dm1, Self::Dm2, Self::Packet];
}

/// A set of news.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct NewsSet(u8);

impl NewsSet {
    pub(super) const EMPTY: Self = Self(0);

    #[inline]
    pub(super) const fn is_empty(self) -> bool {
        self.0 == 0
    }

    #[inline]
    pub(super) const fn contains(self, news: News) -> bool {
        self.0 & news as u8 != 0
    }

    #[inline]
    pub(super) const fn insert(&mut self, news: News) {
        self.0 |= news as u8;
    }

    #[inline]
    pub(super) const fn remove(&mut self, news: News) {
        self.0 &= !(news as u8);
    }

    /// Returns the most urgent of them.
    #[inline]
    pub(super) fn first(self) -> Option<News> {
        News::ALL.into_iter().find(|news| self.contains(*news))
    }

    /// Returns this set without all but one kind.
    #[inline]
    pub(super) const fn only(self, news: News) -> Self {
        Self(self.0 & news as u8)
    }
}

/// How many answers can wait: two askers get one of each service.
const ANSWERS: usize = 8;

/// The answers that wait. They do not go stale; when there is no room, the newest is dropped and counted.
#[derive(Debug, Default)]
pub(super) struct Answers {
    waiting: Vec<Frame, ANSWERS>,
}

impl Answers {
    /// Appends an answer. Returns whether there was room.
    #[must_use]
    pub(super) fn push(&mut self, frame: Frame) -> bool {
        self.waiting.push(frame).is_ok()
    }

    /// Takes back the answer that was popped last. Returns whether there was still room for all.
    #[must_use]
    pub(super) fn take_back(&mut self, frame: Frame) -> bool {
        let had_room = !self.waiting.is_full();
        if !had_room {
            self.waiting.pop();
        }
        // There is room.
        let _ = self.waiting.insert(0, frame);
        had_room
    }

    /// Returns the most urgent answer, the oldest among equals.
    #[inline]
    pub(super) fn first(&self) -> Option<&Frame> {
        self.waiting.iter().min_by_key(|frame| frame.arbitration())
    }

    /// Takes the [first](Self::first) answer.
    pub(super) fn pop(&mut self) -> Option<Frame> {
        let first = *self.first()?;
        let position = self.waiting.iter().position(|frame| *frame == first)?;
        Some(self.waiting.remove(position))
    }

    #[inline]
    pub(super) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Forgets all, and returns how many there were.
    pub(super) fn clear(&mut self) -> u32 {
        let count = self.waiting.len();
        self.waiting.clear();
        u32::try_from(count).unwrap_or(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::extended;

    fn frame(id: u32, tag: u8) -> Frame {
        Frame::of(extended(id).into(), &[tag]).unwrap()
    }

    #[test]
    fn urgent_answers_first_and_equals_in_order() {
        let mut answers = Answers::default();
        for (id, tag) in [(0x1BC4_18F1, 1), (0x18E8_FF83, 2), (0x1BC4_18F1, 3), (0x18E8_FF83, 4)] {
            assert!(answers.push(frame(id, tag)));
        }
        let first = answers.pop().unwrap();
        assert!(answers.take_back(first));
        for tag in [2, 4, 1, 3] {
            assert_eq!(answers.pop().map(|answer| answer.bytes()[0]), Some(tag));
        }
        assert_eq!(answers.pop(), None);
    }

    #[test]
    fn without_room_the_newest_is_dropped() {
        let mut answers = Answers::default();
        for tag in 0..8 {
            assert!(answers.push(frame(0x18E8_FF83, tag)));
        }
        assert!(!answers.push(frame(0x18E8_FF83, 8)));
        let first = answers.pop().unwrap();
        assert!(answers.push(frame(0x18E8_FF83, 9)));
        assert!(!answers.take_back(first));
        for tag in 0..8 {
            assert_eq!(answers.pop(), Some(frame(0x18E8_FF83, tag)));
        }
        assert_eq!(answers.clear(), 0);
    }
}
