//! The queue of memory writes. Records are written one by one, in the order of the requests (SPEC 4.5, 6).

use heapless::Vec;

use crate::memory::RecordKey;

/// The maximum number of kinds of write in a device. A valve on CANopen has this number of kinds.
/// [`Runtime`](super::runtime::Runtime) does not compile for a device with more.
pub(super) const KINDS: usize = 10;

/// The capacity of the queue: a waiting write of each kind, the write in progress, and a write [requested
/// first](Writes::request_first).
const CAPACITY: usize = KINDS + 2;

/// A write of a record. The record is encoded when the write begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Write {
    /// The record to write.
    pub record: RecordKey,
    /// The service that has requested the write.
    pub requester: Requester,
    /// A value whose meaning depends on the [`Requester`]; 0 for none.
    pub value: u8,
}

/// The service that requests a write and waits for the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Requester {
    /// The device itself. No client waits for the result.
    Device,
    /// An LSS store.
    Lss,
    /// An SDO client. The product defines the meaning of the value.
    Sdo,
    /// A UDS client. The value is the node ID or address.
    Uds,
    /// A commanded address. The value is the address.
    CommandedAddress,
    /// A DM3. The value is the set of faults to clear, as bits.
    Dm3,
}

impl Write {
    /// Creates a write without a value.
    #[must_use]
    pub const fn new(record: RecordKey, requester: Requester) -> Self {
        Self { record, requester, value: 0 }
    }

    /// Returns the write with this value.
    #[must_use]
    pub const fn with(self, value: u8) -> Self {
        Self { value, ..self }
    }

    /// Returns whether both writes are of the same kind: with the same record and the same requester.
    pub(super) fn is_like(self, other: Self) -> bool {
        self.with(0) == other.with(0)
    }
}

/// The waiting writes and the write in progress.
#[derive(Clone, Debug)]
pub struct Writes {
    queue: Vec<Write, CAPACITY, u8>,
    /// Whether the first write is in progress.
    in_flight: bool,
}

impl Writes {
    /// Creates an empty queue.
    #[must_use]
    pub const fn new() -> Self {
        Self { queue: Vec::new(), in_flight: false }
    }

    /// Appends a write, or merges it into a waiting write of the same kind. The new value then replaces the old value;
    /// the faults of two DM3s are combined. A commanded address moves to the end, because the last of several orders for
    /// the address must win. The write in progress does not change, because its record is already encoded.
    pub fn request(&mut self, write: Write) {
        let begun = usize::from(self.in_flight);
        if write.requester == Requester::CommandedAddress
            && let Some(place) = self.queue.iter().skip(begun).position(|waiting| waiting.is_like(write))
        {
            self.queue.remove(place.saturating_add(begun));
        }
        if let Some(waiting) = self.queue.iter_mut().skip(begun).find(|waiting| waiting.is_like(write)) {
            let kept = if write.requester == Requester::Dm3 { waiting.value } else { 0 };
            waiting.value = kept | write.value;
        } else {
            // Cannot fail, because there is room for every kind.
            let _ = self.queue.push(write);
        }
    }

    /// Inserts a write before all others. The write must complete a request whose first write has just ended.
    pub fn request_first(&mut self, write: Write) {
        let _ = self.queue.insert(0, write);
    }

    /// Returns the next write and marks it as in progress. Returns `None` while another write is in progress.
    pub fn begin(&mut self) -> Option<Write> {
        let next = self.queue.first().filter(|_| !self.in_flight)?;
        self.in_flight = true;
        Some(*next)
    }

    /// Ends the write in progress and returns it. Returns `None` if no write of this record is in progress.
    pub fn end(&mut self, record: RecordKey) -> Option<Write> {
        let first = self.queue.first()?;
        if !self.in_flight || first.record != record {
            return None;
        }
        self.in_flight = false;
        Some(self.queue.remove(0))
    }

    /// Returns whether an equal write is waiting or in progress.
    #[must_use]
    pub fn contains(&self, write: Write) -> bool {
        self.queue.contains(&write)
    }

    /// Returns the write in progress and the waiting writes.
    pub fn iter(&self) -> impl Iterator<Item = &Write> {
        self.queue.iter()
    }

    /// Returns whether no write is waiting or in progress.
    #[inline]
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.queue.is_empty()
    }
}

impl Default for Writes {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAVE: Write = Write::new(RecordKey::Parameters, Requester::Sdo);
    const LOG: Write = Write::new(RecordKey::FaultLog, Requester::Device);

    #[test]
    fn writes_of_one_kind_wait_once_and_keep_their_turn() {
        let mut writes = Writes::new();
        for ticket in 0..100 {
            writes.request(SAVE.with(ticket));
            writes.request(LOG);
        }
        assert_eq!(writes.end(RecordKey::Parameters), None, "it has not begun");
        assert_eq!(writes.begin(), Some(SAVE.with(99)));
        assert_eq!(writes.begin(), None, "one at a time");
        assert_eq!(writes.end(RecordKey::FaultLog), None, "not in flight");
        // The record in progress is older than this request.
        writes.request(SAVE.with(100));
        assert_eq!(writes.end(RecordKey::Parameters), Some(SAVE.with(99)));
        assert_eq!(writes.begin(), Some(LOG));
        assert_eq!(writes.end(RecordKey::FaultLog), Some(LOG));
        assert!(!writes.is_idle());
        assert_eq!(writes.begin(), Some(SAVE.with(100)));
        assert_eq!(writes.end(RecordKey::Parameters), Some(SAVE.with(100)));
        assert!(writes.is_idle());
    }

    #[test]
    fn one_record_for_two_requesters_is_written_twice() {
        let mut writes = Writes::new();
        writes.request(LOG);
        writes.request(Write::new(RecordKey::FaultLog, Requester::Sdo));
        assert_eq!(writes.begin(), Some(LOG));
        assert_eq!(writes.end(RecordKey::FaultLog), Some(LOG));
        assert!(!writes.contains(LOG));
        assert!(writes.iter().any(|waiting| waiting.requester == Requester::Sdo));
    }

    #[test]
    fn the_last_of_several_orders_for_the_address_wins() {
        let mut writes = Writes::new();
        let order = |requester, address| Write::new(RecordKey::LocalLayer, requester).with(address);
        writes.request(LOG);
        assert_eq!(writes.begin(), Some(LOG));
        for order in [
            order(Requester::CommandedAddress, 0x85),
            order(Requester::Uds, 0x86),
            order(Requester::CommandedAddress, 0x87),
        ] {
            writes.request(order);
        }
        assert_eq!(writes.end(RecordKey::FaultLog), Some(LOG));
        for order in [order(Requester::Uds, 0x86), order(Requester::CommandedAddress, 0x87)] {
            assert_eq!(writes.begin(), Some(order));
            assert_eq!(writes.end(RecordKey::LocalLayer), Some(order));
        }
        assert!(writes.is_idle());
    }

    #[test]
    fn of_two_dm3s_that_wait_one_write_clears_the_faults_of_both() {
        let mut writes = Writes::new();
        let dm3 = Write::new(RecordKey::FaultLog, Requester::Dm3);
        writes.request(dm3.with(0b01));
        assert_eq!(writes.begin(), Some(dm3.with(0b01)));
        writes.request(dm3.with(0b011));
        writes.request(dm3.with(0b110));
        assert_eq!(writes.end(RecordKey::FaultLog), Some(dm3.with(0b01)));
        assert_eq!(writes.begin(), Some(dm3.with(0b111)));
    }

    #[test]
    fn the_second_half_of_a_write_comes_before_all_others() {
        let mut writes = Writes::new();
        writes.request(SAVE);
        writes.request_first(LOG);
        assert_eq!(writes.begin(), Some(LOG));
    }
}
