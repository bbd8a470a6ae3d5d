//! The due times of the devices, and the search for the earliest.

use protocol_core::time::{Instant, NEVER};

/// The due times of all devices, as a tournament tree. The earliest due time wins; among equal times, the lowest device
/// number. A new due time replays only the matches of its device.
#[derive(Clone, Debug, Default)]
pub(super) struct Agenda {
    /// The due time of each device, by number.
    due: Vec<Instant>,
    /// The winner of each match, indexed as in a heap: the final at 1, the semi-finals at 2 and 3, and so on. The last
    /// entries are the devices themselves, or [`NOBODY`].
    winners: Vec<usize>,
    /// The winner of the final and its due time, cached because every event needs the due time.
    next: Option<(Instant, usize)>,
}

const NOBODY: usize = usize::MAX;

impl Agenda {
    /// Adds a device without a due time.
    pub(super) fn add(&mut self) {
        self.due.push(NEVER);
        let places = self.due.len().next_power_of_two();
        if self.winners.len() < 2 * places {
            self.winners = vec![NOBODY; 2 * places];
            (0..self.due.len()).for_each(|node| self.enter(node));
        } else {
            self.enter(self.due.len() - 1);
        }
    }

    pub(super) fn set(&mut self, node: usize, due: Instant) {
        if self.due[node] != due {
            self.due[node] = due;
            self.play(node);
        }
    }

    pub(super) fn next(&self) -> Instant {
        self.next.map_or(NEVER, |(due, _)| due)
    }

    /// Returns the next device that is due by `now`.
    pub(super) fn due_by(&self, now: Instant) -> Option<usize> {
        self.next.filter(|(due, _)| *due <= now).map(|(_, node)| node)
    }

    fn enter(&mut self, node: usize) {
        let place = self.winners.len() / 2 + node;
        self.winners[place] = node;
        self.play(node);
    }

    /// Replays the matches of a device after its due time has changed.
    fn play(&mut self, node: usize) {
        let mut place = (self.winners.len() / 2 + node) / 2;
        while place > 0 {
            let (left, right) = (self.winners[2 * place], self.winners[2 * place + 1]);
            self.winners[place] = if self.due_of(right) < self.due_of(left) { right } else { left };
            place /= 2;
        }
        let winner = self.winners[1];
        self.next = Some((self.due_of(winner), winner));
    }

    fn due_of(&self, node: usize) -> Instant {
        self.due.get(node).copied().unwrap_or(NEVER)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// For any due times set in any order, the earliest is next; among equal times, the lowest number.
        #[test]
        fn the_earliest_is_next(sets in prop::collection::vec((0..40_usize, 0..20_u64), 0..200)) {
            let mut agenda = Agenda::default();
            prop_assert_eq!((agenda.next(), agenda.due_by(NEVER)), (NEVER, None));
            let mut due: Vec<Instant> = Vec::new();
            for (node, ticks) in sets {
                while due.len() <= node {
                    agenda.add();
                    due.push(NEVER);
                }
                due[node] = if ticks == 0 { NEVER } else { Instant::from_ticks(ticks) };
                agenda.set(node, due[node]);
                let earliest = due.iter().copied().min().unwrap_or(NEVER);
                prop_assert_eq!(agenda.next(), earliest);
                let first = due.iter().position(|other| *other == earliest).filter(|_| earliest != NEVER);
                prop_assert_eq!(agenda.due_by(Instant::from_ticks(20)), first);
            }
        }
    }
}
