//! The ports with pending frames. The ports that may send are sorted in arbitration order; the last entry wins.

use super::PortId;

/// The contention state of a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Contends {
    /// The port has no pending frame.
    #[default]
    No,
    /// The port may not send yet: it is joining, suspended or bus-off, or its frame was queued after the bus became
    /// free.
    Waiting,
    /// The port may send as soon as the bus is free, with this arbitration key.
    Ready(u32),
}

/// The rank of a port: the arbitration key, then the port number. The lowest rank wins the arbitration.
type Rank = (u32, PortId);

#[derive(Clone, Debug, Default)]
pub(super) struct Contenders {
    /// The ports that may send, in descending order of rank: the last entry wins.
    ready: Vec<Rank>,
    /// The ports that may not send yet, unordered.
    waiting: Vec<PortId>,
}

impl Contenders {
    pub(super) const fn is_empty(&self) -> bool {
        self.ready.is_empty() && self.waiting.is_empty()
    }

    /// Returns whether any port may send as soon as the bus is free.
    pub(super) const fn is_any_ready(&self) -> bool {
        !self.ready.is_empty()
    }

    pub(super) fn waiting(&self) -> &[PortId] {
        &self.waiting
    }

    /// Changes the contention state of a port: not contending, waiting or ready.
    pub(super) fn place(&mut self, id: PortId, from: Contends, to: Contends) {
        match from {
            Contends::No => {}
            Contends::Waiting => self.waiting.retain(|other| *other != id),
            Contends::Ready(key) => drop(self.ready.remove(self.place_of((key, id)))),
        }
        match to {
            Contends::No => {}
            Contends::Waiting => self.waiting.push(id),
            Contends::Ready(key) => self.ready.insert(self.place_of((key, id)), (key, id)),
        }
    }

    /// Moves each waiting port for which `key` returns an arbitration key to the ready ports.
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

    /// Appends the ports that win the arbitration to `into`: usually one port, or several with equal keys.
    pub(super) fn winners(&self, into: &mut Vec<PortId>) {
        let Some((first, _)) = self.ready.last() else { return };
        into.extend(self.ready.iter().rev().take_while(|(key, _)| key == first).map(|(_, id)| id));
    }

    /// Returns the index of `rank` in `ready`, or the index at which to insert `rank`.
    fn place_of(&self, rank: Rank) -> usize {
        self.ready.partition_point(|other| *other > rank)
    }
}
