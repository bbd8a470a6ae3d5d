//! A reader for the previous layout, which contains items of `sequential-storage` 8. The last words of each sector
//! announce erases. An item consists of its checksum, its length, the checksum of the length, its key and its content.

use core::ops::Range;

use crc::{Algorithm, Crc, NoTable};
use embedded_storage::nor_flash::NorFlash;

use crate::log::{HEADER as ENTRY_HEADER, Log, MARK};
use crate::{ERASED, ITEM_MAX, is_key};

/// The checksum of an item: CRC-32C with a non-standard initial value.
const DATA: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&Algorithm {
    width: 32,
    poly: 0x1EDC_6F41,
    init: 0x7777_7777,
    refin: true,
    refout: true,
    xorout: 0xFFFF_FFFF,
    check: 0,
    residue: 0,
});

const DATA_CHECKSUM: Range<usize> = 0..4;
const LENGTH: Range<usize> = 4..6;
const LENGTH_CHECKSUM: Range<usize> = 6..8;

/// The maximum number of announcements at the end of a sector. An announcement has two words, and concerns the other
/// sector.
const ANNOUNCEMENTS: usize = 16;
/// The byte that fills the first word of an announcement when an erase of the other sector begins.
const ANNOUNCED: u8 = 0x5A;
/// The byte that fills the last word before the announcements of a full sector.
const FULL: u8 = 0;

impl<F: NorFlash> Log<'_, F> {
    /// The number of bytes of a sector before its announcements.
    const LEGACY_SECTOR: usize = F::ERASE_SIZE - ANNOUNCEMENTS * 2 * F::WRITE_SIZE;
    const LEGACY_HEADER: usize = LENGTH_CHECKSUM.end.next_multiple_of(F::WRITE_SIZE);

    /// Visits the items of a sector in the previous layout, from the oldest to the newest. A sector with the present
    /// layout or with an unfinished erase is skipped. `visit` receives the address, key and content of an item.
    pub(crate) fn legacy_items(
        &mut self,
        sector: usize,
        visit: &mut dyn FnMut(usize, u8, &[u8]),
    ) -> Result<(), F::Error> {
        let (start, mut at) = (sector * F::ERASE_SIZE, sector * F::ERASE_SIZE);
        self.read(start, F::WRITE_SIZE)?;
        if self.buffer[0] == MARK || self.is_being_erased(sector)? {
            return Ok(());
        }
        let end = start + Self::LEGACY_SECTOR - F::WRITE_SIZE;
        while let Some(next) = self.next_written(at, end)? {
            match self.legacy_item_at(next, end)? {
                Some(length) => {
                    if is_key(self.buffer[0]) {
                        visit(next, self.buffer[0], &self.buffer[1..length]);
                    }
                    at = next + Self::LEGACY_HEADER + length.next_multiple_of(F::WRITE_SIZE);
                }
                None => at = next + F::WRITE_SIZE,
            }
        }
        Ok(())
    }

    /// Reads the content of an item into the buffer, after the space for an entry header. Returns whether the item is
    /// intact.
    pub(crate) fn read_legacy(&mut self, at: usize, length: usize) -> Result<bool, F::Error> {
        let end = (at / F::ERASE_SIZE) * F::ERASE_SIZE + Self::LEGACY_SECTOR - F::WRITE_SIZE;
        let is_intact = self.legacy_item_at(at, end)? == Some(1 + length);
        self.buffer.copy_within(1..=length, ENTRY_HEADER);
        Ok(is_intact)
    }

    /// Returns whether the first sector has newer items than the second.
    pub(crate) fn is_legacy_newer_in_front(&mut self) -> Result<bool, F::Error> {
        Ok(self.is_legacy_full(1)? && !self.is_legacy_full(0)?)
    }

    /// Returns whether a sector is marked as full. If only one sector is full, the other has newer items.
    fn is_legacy_full(&mut self, sector: usize) -> Result<bool, F::Error> {
        self.is_word_of(sector * F::ERASE_SIZE + Self::LEGACY_SECTOR - F::WRITE_SIZE, FULL)
    }

    /// Reads the item at a word into the buffer. Returns its length; `None` unless an intact item begins at the word.
    fn legacy_item_at(&mut self, at: usize, end: usize) -> Result<Option<usize>, F::Error> {
        if at + Self::LEGACY_HEADER > end {
            return Ok(None);
        }
        self.read(at, Self::LEGACY_HEADER)?;
        let length = u16::from_le_bytes([self.buffer[LENGTH.start], self.buffer[LENGTH.start + 1]]);
        let is_sound = self.buffer[LENGTH_CHECKSUM] == length_checksum(length).to_le_bytes();
        let mut data = [0; 4];
        data.copy_from_slice(&self.buffer[DATA_CHECKSUM]);
        let length = usize::from(length);
        let size = length.next_multiple_of(F::WRITE_SIZE);
        if !is_sound || length == 0 || length > 1 + ITEM_MAX || at + Self::LEGACY_HEADER + size > end {
            return Ok(None);
        }
        self.read(at + Self::LEGACY_HEADER, size)?;
        Ok(Some(length).filter(|length| checksum(&self.buffer[..*length]).to_le_bytes() == data))
    }

    /// Returns whether an erase of the sector was announced and not completed.
    pub(crate) fn is_being_erased(&mut self, sector: usize) -> Result<bool, F::Error> {
        let first = (1 - sector) * F::ERASE_SIZE + Self::LEGACY_SECTOR;
        for number in 0..ANNOUNCEMENTS {
            let at = first + number * 2 * F::WRITE_SIZE;
            if self.is_word_of(at, ANNOUNCED)? && self.is_word_of(at + F::WRITE_SIZE, ERASED)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn is_word_of(&mut self, at: usize, byte: u8) -> Result<bool, F::Error> {
        self.read(at, F::WRITE_SIZE)?;
        Ok(self.buffer[..F::WRITE_SIZE].iter().all(|found| *found == byte))
    }
}

/// Returns the checksum of an item. The first byte of the checksum is neither 0 nor 0xFF.
fn checksum(data: &[u8]) -> u32 {
    match DATA.checksum(data) {
        0 => 1,
        crc if matches!(crc.to_le_bytes()[0], 0 | ERASED) => crc ^ 1,
        crc => crc,
    }
}

/// Returns the checksum for the length of an item: CRC-16 with the reversed polynomial 0x1A2E, but never 0xFFFF.
fn length_checksum(length: u16) -> u16 {
    let crc = length.to_le_bytes().iter().fold(u16::MAX, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0x1A2E } else { 0 })
    });
    if !crc == u16::MAX { 0xFFFE } else { !crc }
}
