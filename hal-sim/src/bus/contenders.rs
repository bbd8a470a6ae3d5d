//! Who has something to send, in the order of arbitration: the winner of the bus is found at once.

use super::PortId;

/// Where a port is among the contenders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Contends {
    /// The port has nothing to send.
    #[default]
    No,
    /// The port may not send yet: it joins, is suspended or bus-off, or came after the bus was free.
    Waiting,
    /// The port may send as soon as the bus is free, at this arbitration key.
    Ready(u32),
}

/// The ports that have something to send.
#[derive(Debug, Default)]
pub(super) struct Contenders {
    /// Those that may send: the most urgent one last, of equals the one with the lowest number.
    ready: Vec<(u32, PortId)>,
    /// Those that may not send yet, in no order.
    waiting: Vec<PortId>,
}

impl Contenders {
    pub(super) const fn is_empty(&self) -> bool {
        self.ready.is_empty() && self.waiting.is_empty()
    }

    /// Whether somebody may send as soon as the bus is free.
    pub(super) const fn is_any_ready(&self) -> bool {
        !self.ready.is_empty()
    }

    /// Those that may not send yet.
    pub(super) fn waiting(&self) -> &[PortId] {
        &self.waiting
    }

    /// Moves a port from one place to another.
    pub(super) fn place(&mut self, id: PortId, from: Contends, to: Contends) {
        match from {
            Contends::No => {}
            Contends::Waiting => self.waiting.retain(|other| *other != id),
            // The winner of the bus, as a rule.
            Contends::Ready(key) if self.ready.last() == Some(&(key, id)) => drop(self.ready.pop()),
            Contends::Ready(key) => drop(self.ready.remove(self.place_of(key, id))),
        }
        match to {
            Contends::No => {}
            Contends::Waiting => self.waiting.push(id),
            Contends::Ready(key) => self.ready.insert(self.place_of(key, id), (key, id)),
        }
    }

    /// Makes those ready for which `key` gives an arbitration key.
    pub(super) fn promote(&mut self, mut key: impl FnMut(PortId) -> Option<u32>) {
        let mut place = 0;
        while let Some(id) = self.waiting.get(place).copied() {
            match key(id) {
                Some(key) => {
                    self.waiting.swap_remove(place);
                    self.place(id, Contends::No, Contends::Ready(key));
                }
                None => place += 1,
            }
        }
    }

    /// Adds those who are still sending when the identifiers are through: one, as a rule.
    pub(super) fn winners(&self, into: &mut Vec<PortId>) {
        let Some((winning, _)) = self.ready.last() else { return };
        into.extend(self.ready.iter().rev().take_while(|(key, _)| key == winning).map(|(_, id)| *id));
    }

    /// Where a contender is, or belongs.
    fn place_of(&self, key: u32, id: PortId) -> usize {
        self.ready.partition_point(|other| *other > (key, id))
    }
}
