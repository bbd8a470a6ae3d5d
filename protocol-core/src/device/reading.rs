//! What a start reads from the memory: each record checked, the corrupt ones noted (SPEC 6).

use crate::memory::{Image, RecordKey};

/// The records of an image, and which of them are corrupt.
#[derive(Debug)]
pub struct Reading<'a> {
    image: &'a Image,
    /// By the record's position.
    corrupt: [bool; RecordKey::ALL.len()],
}

impl<'a> Reading<'a> {
    /// Begins to read an image.
    #[must_use]
    pub const fn new(image: &'a Image) -> Self {
        Self { image, corrupt: [false; RecordKey::ALL.len()] }
    }

    /// Decodes a record of this version; `None` when it was never written, or is corrupt, which is noted.
    pub fn record<T>(&mut self, key: RecordKey, version: u8, decode: impl FnOnce(&'a [u8]) -> Option<T>) -> Option<T> {
        let decoded = match self.image.payload(key, version) {
            Ok(None) => return None,
            Ok(Some(payload)) => decode(payload),
            Err(_) => None,
        };
        if decoded.is_none()
            && let Some(corrupt) = self.corrupt.get_mut(key.position())
        {
            *corrupt = true;
        }
        decoded
    }

    /// Returns whether a record was never written.
    #[must_use]
    pub fn is_absent(&self, key: RecordKey) -> bool {
        // Whatever the version: a record that does not open is not absent.
        self.image.payload(key, 0) == Ok(None)
    }

    /// Returns whether a record that was asked for is corrupt.
    #[must_use]
    pub fn is_corrupt(&self, key: RecordKey) -> bool {
        self.corrupt.get(key.position()) == Some(&true)
    }

    /// Returns whether the memory as a whole is damaged.
    #[must_use]
    pub const fn is_damaged(&self) -> bool {
        self.image.is_damaged()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::seal;

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
