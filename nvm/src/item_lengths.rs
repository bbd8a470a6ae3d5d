//! Items of a length that none has: damage, which the map is to step over.
//!
//! `sequential-storage` goes from item to item by the lengths in their headers. A length has a checksum of 16 bits, which
//! damage fits now and then. An item that claims more than the buffer holds would end every look at its sector with an
//! error; one that claims nothing, not even a key, would be read beyond its end. Neither is ever written. So such a header
//! is handed out with a checksum that is never right: the map then looks for the next header word by word, and finds
//! what lies behind, whatever was claimed.

use core::ops::Range;

use embedded_storage::nor_flash::{ErrorType, MultiwriteNorFlash, NorFlash, ReadNorFlash};

use crate::sure_erase::ERASED;

/// Where a header says how long its item is.
const LENGTH: Range<usize> = 4..6;
/// The checksum of that.
const CHECKSUM: Range<usize> = 6..8;
/// What the map never computes, so that it cannot be taken for an erased word.
const NO_CHECKSUM: u8 = 0xFF;

/// A flash in which no item is longer than `MAX` bytes, or empty.
///
/// A header is known by the bytes that are read at once. An item of as many bytes is told from it by the header before.
pub(crate) struct ItemLengths<S, const MAX: usize> {
    flash: S,
    /// Where the data of the last header lies, if it is as long as a header.
    data: Option<u32>,
}

impl<S: NorFlash, const MAX: usize> ItemLengths<S, MAX> {
    /// Data checksum, length and checksum, in whole words.
    const HEADER: usize = CHECKSUM.end.next_multiple_of(S::WRITE_SIZE);

    pub(crate) const fn new(flash: S) -> Self {
        // A sector's state is read by single units.
        const { assert!(S::READ_SIZE < Self::HEADER) }
        Self { flash, data: None }
    }

    /// Looks at what was read as the header at `offset`.
    fn check(&mut self, offset: u32, header: &mut [u8]) {
        self.data = None;
        if header.iter().all(|byte| *byte == ERASED) {
            return;
        }
        let length = usize::from(u16::from_le_bytes([header[LENGTH.start], header[LENGTH.start + 1]]));
        if length == 0 || length > MAX {
            header.fill(0);
            header[CHECKSUM].fill(NO_CHECKSUM);
        } else if length.next_multiple_of(S::WRITE_SIZE) == Self::HEADER {
            self.data = Some(offset + Self::HEADER as u32);
        }
    }
}

impl<S: ErrorType, const MAX: usize> ErrorType for ItemLengths<S, MAX> {
    type Error = S::Error;
}

impl<S: NorFlash, const MAX: usize> ReadNorFlash for ItemLengths<S, MAX> {
    const READ_SIZE: usize = S::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), S::Error> {
        self.flash.read(offset, bytes)?;
        if bytes.len() == Self::HEADER && self.data != Some(offset) {
            self.check(offset, bytes);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<S: NorFlash, const MAX: usize> NorFlash for ItemLengths<S, MAX> {
    const WRITE_SIZE: usize = S::WRITE_SIZE;
    const ERASE_SIZE: usize = S::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), S::Error> {
        self.data = None;
        self.flash.erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), S::Error> {
        self.data = None;
        self.flash.write(offset, bytes)
    }
}

impl<S: MultiwriteNorFlash, const MAX: usize> MultiwriteNorFlash for ItemLengths<S, MAX> {}
