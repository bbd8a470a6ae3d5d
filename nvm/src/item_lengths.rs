//! Items of a length that none has: damage, which the map is to step over.
//!
//! `sequential-storage` goes from item to item by the lengths in their headers. A length has a checksum of 16 bits,
//! which damage fits now and then. An item that claims more than the buffer holds would end every look at its sector
//! with an error; one that claims nothing, not even a key, would be read beyond its end. Neither is ever written. So
//! such a header is handed out with a checksum that is never right: the map then looks for the next header word by
//! word, and finds what lies behind, whatever was claimed.
//!
//! Erased words end a sector for the map, and damage can leave some between two items. What is stored into such a gap
//! would be lost as soon as it is closed: the older items behind it would count as the newer ones. So erased words with
//! anything behind them are stepped over, too.
//!
//! In the same way all items but those of one key are given up: they read as removed, and no sector has room, so that
//! the map moves to its other sector, takes along what it still sees, and erases the rest.

use core::ops::Range;

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use crate::sure_erase::{ERASED, WORD_MAX};

/// The checksum of an item's data: zero when the item was removed.
const DATA_CHECKSUM: Range<usize> = 0..4;
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
    /// Erased words with something behind them, as far as they were looked at.
    gap: Range<u32>,
    /// The only key whose items are seen, while all others are given up.
    kept: Option<u8>,
    /// Whether erased words count as taken, so that the map closes its sector and moves to the other one.
    full: bool,
}

impl<S: NorFlash, const MAX: usize> ItemLengths<S, MAX> {
    /// Data checksum, length and checksum, in whole words.
    const HEADER: usize = CHECKSUM.end.next_multiple_of(S::WRITE_SIZE);

    /// Returns a flash whose items are checked. With `kept`, it gives up the items of all other keys at the first item
    /// that is stored.
    pub(crate) const fn new(flash: S, kept: Option<u8>) -> Self {
        // A sector's state is read by single units.
        const { assert!(S::READ_SIZE < Self::HEADER) }
        Self { flash, data: None, gap: 0..0, kept, full: kept.is_some() }
    }

    /// Returns whether the data follow a header, and not the next one. Behind a header with a wrong checksum the map
    /// goes on by a word: shorter words than a header are looked at anew there, whatever the header said.
    fn is_sound(header: &[u8]) -> bool {
        S::WRITE_SIZE < Self::HEADER || checksum(&header[LENGTH]).to_le_bytes() == header[CHECKSUM]
    }

    /// Returns whether anything follows behind the erased words at `offset`, in a sector that is begun.
    fn is_gap(&mut self, offset: u32) -> Result<bool, S::Error> {
        if self.gap.contains(&offset) {
            return Ok(true);
        }
        let sector = offset as usize / S::ERASE_SIZE * S::ERASE_SIZE;
        let mut bytes = [0; 4 * WORD_MAX];
        let mark = &mut bytes[..S::WRITE_SIZE];
        self.flash.read(sector as u32, mark)?;
        if mark.iter().all(|byte| *byte == ERASED) {
            return Ok(false);
        }
        // The last word is the mark of a full sector.
        let end = sector + S::ERASE_SIZE - S::WRITE_SIZE;
        for start in (offset as usize..end).step_by(bytes.len()) {
            let bytes = &mut bytes[..(end - start).min(4 * WORD_MAX)];
            self.flash.read(start as u32, bytes)?;
            if let Some(used) = bytes.iter().position(|byte| *byte != ERASED) {
                self.gap = offset..(start + used) as u32;
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Looks at what was read as the header at `offset`.
    fn check(&mut self, offset: u32, header: &mut [u8]) -> Result<(), S::Error> {
        self.data = None;
        let is_erased = header.iter().all(|byte| *byte == ERASED);
        if is_erased && !self.full && !self.is_gap(offset)? {
            return Ok(());
        }
        let data = offset + Self::HEADER as u32;
        let length = usize::from(u16::from_le_bytes([header[LENGTH.start], header[LENGTH.start + 1]]));
        if length == 0 || length > MAX || !Self::is_sound(header) {
            header.fill(0);
            header[CHECKSUM].fill(NO_CHECKSUM);
            return Ok(());
        }
        if length.next_multiple_of(S::WRITE_SIZE) == Self::HEADER {
            self.data = Some(data);
        }
        if let Some(kept) = self.kept {
            // The key is what the data begins with.
            let mut word = [0; WORD_MAX];
            self.flash.read(data, &mut word[..S::WRITE_SIZE])?;
            if word[0] != kept {
                header[DATA_CHECKSUM].fill(0);
            }
        }
        Ok(())
    }
}

/// Returns the checksum that the map gives to a length: CRC-16 with the reversed polynomial 0x1A2E.
fn checksum(length: &[u8]) -> u16 {
    let crc = length.iter().fold(u16::MAX, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0x1A2E } else { 0 })
    });
    !crc
}

impl<S: ErrorType, const MAX: usize> ErrorType for ItemLengths<S, MAX> {
    type Error = S::Error;
}

impl<S: NorFlash, const MAX: usize> ReadNorFlash for ItemLengths<S, MAX> {
    const READ_SIZE: usize = S::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), S::Error> {
        self.flash.read(offset, bytes)?;
        if bytes.len() == Self::HEADER && self.data != Some(offset) {
            self.check(offset, bytes)?;
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
        (self.data, self.gap) = (None, 0..0);
        self.flash.erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), S::Error> {
        (self.data, self.gap) = (None, 0..0);
        self.full = false;
        self.flash.write(offset, bytes)
    }
}
