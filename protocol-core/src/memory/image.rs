//! The contents of the memory at the start of a device.

use super::record::{RECORD_MAX, Record, RecordKey, open};

/// The memory of a device at its start. The records are not checked.
pub trait Memory {
    /// Returns the [sealed](super::seal) bytes of a record; `None` for a record that was never written.
    ///
    /// # Errors
    /// Returns [`Corrupt`] for a record that exists but could not be read.
    fn sealed(&self, key: RecordKey) -> Result<Option<&[u8]>, Corrupt>;

    /// Returns whether the entire memory is damaged, so that the number of unreadable records is unknown.
    fn is_damaged(&self) -> bool {
        false
    }
}

/// The contents of a record.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Content {
    /// The record was never written.
    #[default]
    Absent,
    /// The sealed bytes of the record, not checked.
    Sealed(Record),
    /// The record exists, but could not be read or is too long.
    Unreadable,
}

/// A copy of the memory at the start of a device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Image {
    contents: [Content; RecordKey::ALL.len()],
    damaged: bool,
}

impl Image {
    /// Creates the image of a memory that was never written.
    #[must_use]
    pub const fn empty() -> Self {
        Self { contents: [const { Content::Absent }; RecordKey::ALL.len()], damaged: false }
    }

    /// Empties the image in place. A second image would be large for the stack of a small processor.
    pub fn clear(&mut self) {
        self.contents.fill_with(Content::default);
        self.damaged = false;
    }

    /// Sets the sealed bytes of a record.
    pub fn put(&mut self, key: RecordKey, bytes: &[u8]) {
        self.set(key, Record::from_slice(bytes).map_or(Content::Unreadable, Content::Sealed));
    }

    /// Marks a record as unreadable.
    pub fn put_unreadable(&mut self, key: RecordKey) {
        self.set(key, Content::Unreadable);
    }

    /// Marks the entire memory as damaged.
    pub const fn set_damaged(&mut self) {
        self.damaged = true;
    }

    /// Returns whether the entire memory is damaged.
    #[must_use]
    pub const fn is_damaged(&self) -> bool {
        self.damaged
    }

    /// Returns whether the memory is new: nothing was ever written, and nothing is damaged.
    #[must_use]
    pub fn is_new(&self) -> bool {
        !self.damaged && self.contents.iter().all(|content| *content == Content::Absent)
    }

    /// Returns the payload of a record; `Ok(None)` for a record that was never written.
    ///
    /// # Errors
    /// Returns [`Corrupt`] for a record that cannot be read or does not open with `version`.
    pub fn payload(&self, key: RecordKey, version: u8) -> Result<Option<&[u8]>, Corrupt> {
        self.sealed(key)?.map(|record| open(version, record).ok_or(Corrupt)).transpose()
    }

    fn set(&mut self, key: RecordKey, content: Content) {
        if let Some(slot) = self.contents.get_mut(key.position()) {
            *slot = content;
        }
    }
}

impl Memory for Image {
    fn sealed(&self, key: RecordKey) -> Result<Option<&[u8]>, Corrupt> {
        match self.contents.get(key.position()) {
            None | Some(Content::Absent) => Ok(None),
            Some(Content::Sealed(record)) => Ok(Some(record)),
            Some(Content::Unreadable) => Err(Corrupt),
        }
    }

    fn is_damaged(&self) -> bool {
        self.damaged
    }
}

/// The error for a record that is unreadable or fails its check. The record counts as absent and raises the internal
/// error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corrupt;

const _: () = assert!(RECORD_MAX <= 255);

#[cfg(test)]
mod tests {
    use super::super::seal;
    use super::*;

    #[test]
    fn a_new_memory_holds_nothing() {
        let image = Image::empty();
        assert!(image.is_new());
        assert_eq!(image.payload(RecordKey::Parameters, 1), Ok(None));
    }

    #[test]
    fn records_are_checked_when_they_are_opened() {
        let mut image = Image::empty();
        image.put(RecordKey::LocalLayer, &seal(1, b"\x20").unwrap());
        image.put(RecordKey::Parameters, b"noise");
        image.put(RecordKey::FaultLog, &[0; 200]);
        assert!(!image.is_new());
        assert_eq!(image.payload(RecordKey::LocalLayer, 1), Ok(Some(&b"\x20"[..])));
        assert_eq!(image.payload(RecordKey::LocalLayer, 2), Err(Corrupt));
        assert_eq!(image.payload(RecordKey::Parameters, 1), Err(Corrupt));
        assert_eq!(image.payload(RecordKey::FaultLog, 1), Err(Corrupt));
    }

    #[test]
    fn a_memory_that_was_cleared_is_a_new_one() {
        let mut image = Image::empty();
        image.put(RecordKey::LocalLayer, &seal(1, b"\x20").unwrap());
        image.put_unreadable(RecordKey::FaultLog);
        image.set_damaged();
        image.clear();
        assert_eq!(image, Image::empty());
    }

    #[test]
    fn a_damaged_memory_is_not_a_new_one() {
        let mut image = Image::empty();
        image.set_damaged();
        assert!(image.is_damaged() && !image.is_new());
    }
}
