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

/// The rank of a port: the arbitration key and the port number, combined for a comparison in one step. The lowest rank
/// wins the arbitration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Rank(u64);

impl Rank {
    const fn of(key: u32, id: PortId) -> Self {
        Self((key as u64) << u32::BITS | id.0 as u64)
    }

    const fn key(self) -> u32 {
        (self.0 >> u32::BITS) as u32
    }

    const fn id(self) -> PortId {
        PortId(self.0 as u32 as usize)
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct Contenders {
    /// The ports that may send, in descending order of rank: the last entry wins.
    pub(super) ready: Vec<Rank>,
    /// The ports that may not send yet, unordered.
    pub(super) waiting: Vec<PortId>,
}

impl Contenders {
    /// Changes the contention state of a port: not contending, waiting or ready.
    pub(super) fn place(&mut self, id: PortId, from: Contends, to: Contends) {
        match from {
            Contends::No => {}
            Contends::Waiting => self.waiting.retain(|other| *other != id),
            Contends::Ready(key) => {
                let rank = Rank::of(key, id);
                // The port has usually just sent, as the last entry.
                if self.ready.last() == Some(&rank) {
                    self.ready.pop();
                } else {
                    self.ready.remove(self.place_of(rank));
                }
            }
        }
        match to {
            Contends::No => {}
            Contends::Waiting => self.waiting.push(id),
            Contends::Ready(key) => {
                let rank = Rank::of(key, id);
                self.ready.insert(self.place_of(rank), rank);
            }
        }
    }

    /// Makes each waiting port ready if `key` returns an arbitration key for it.
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
        let Some((first, others)) = self.ready.split_last() else { return };
        into.push(first.id());
        for other in others.iter().rev() {
            if other.key() != first.key() {
                break;
            }
            into.push(other.id());
        }
    }

    /// Returns the index of `rank` in `ready`, or the index at which to insert `rank`.
    fn place_of(&self, rank: Rank) -> usize {
        self.ready.partition_point(|other| *other > rank)
    }
}
