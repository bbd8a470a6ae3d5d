//! The memory during a start, when the device checks each record that it reads (SPEC 6).

use crate::memory::{Memory, RecordKey, open};

/// A memory, and the records found corrupt so far.
pub struct Reading<'a> {
    memory: &'a dyn Memory,
    /// The bits of the corrupt records, each at the position of its record.
    corrupt: u8,
}

const _: () = assert!(RecordKey::ALL.len() <= 8);

impl<'a> Reading<'a> {
    /// Starts reading a memory. No record counts as corrupt yet.
    #[must_use]
    pub const fn new(memory: &'a dyn Memory) -> Self {
        Self { memory, corrupt: 0 }
    }

    /// Decodes a record with this version. Returns `None` for a record that was never written or is corrupt.
    /// [`is_corrupt`](Self::is_corrupt) distinguishes the two cases.
    pub fn record<T>(&mut self, key: RecordKey, version: u8, decode: impl FnOnce(&'a [u8]) -> Option<T>) -> Option<T> {
        let decoded = decode(self.payload(key, version)?);
        if decoded.is_none() {
            self.corrupt |= bit(key);
        }
        decoded
    }

    fn payload(&mut self, key: RecordKey, version: u8) -> Option<&'a [u8]> {
        let payload = match self.memory.sealed(key) {
            Ok(None) => return None,
            Ok(Some(record)) => open(version, record),
            Err(_) => None,
        };
        if payload.is_none() {
            self.corrupt |= bit(key);
        }
        payload
    }

    /// Returns whether a record was never written.
    #[must_use]
    pub fn is_absent(&self, key: RecordKey) -> bool {
        self.memory.sealed(key) == Ok(None)
    }

    /// Returns whether [`record`](Self::record) has found a record corrupt.
    #[must_use]
    pub const fn is_corrupt(&self, key: RecordKey) -> bool {
        self.corrupt & bit(key) != 0
    }

    /// Returns whether the entire memory is damaged.
    #[must_use]
    pub fn is_damaged(&self) -> bool {
        self.memory.is_damaged()
    }
}

const fn bit(key: RecordKey) -> u8 {
    1_u8.wrapping_shl(key.position() as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::{Image, seal};

    #[test]
    fn absent_corrupt_and_sound_records() {
        let mut image = Image::empty();
        image.put(RecordKey::LocalLayer, &seal(1, b"\x20").unwrap());
        image.put(RecordKey::FaultLog, &seal(1, b"what no decoder takes").unwrap());
        image.put(RecordKey::Parameters, b"noise");
        let mut reading = Reading::new(&image);
        assert_eq!(reading.record(RecordKey::LocalLayer, 1, |payload| payload.first().copied()), Some(0x20));
        assert_eq!(reading.record(RecordKey::FaultLog, 1, |_| None::<()>), None);
        assert_eq!(reading.record(RecordKey::Parameters, 1, Some), None);
        assert_eq!(reading.record(RecordKey::Factory, 1, Some), None);
        let of = |read: &dyn Fn(RecordKey) -> bool| RecordKey::ALL.map(read);
        assert_eq!(of(&|key| reading.is_absent(key)), [true, false, false, true, false, true]);
        assert_eq!(of(&|key| reading.is_corrupt(key)), [false, false, true, false, true, false]);
    }
}
