//! Erases that are finished, whatever cuts them.
//!
//! An erase that the power cuts leaves anything behind: zeros, noise, half of what was there. `sequential-storage`
//! judges a sector by a mark at each of its ends, and so can take such a sector for a full one. It then takes the
//! copies that it made before the erase for unfinished ones, throws them away, and copies the garbage: everything is
//! lost.
//!
//! So no erase is left unfinished for it to see. Each is announced in the *other* sector before it begins, and that it
//! is done is noted there too; one that was announced and is not done is done again before anything is read.
//!
//! An erased sector does not stay erased for sure: bits flip in it, too. The records that are moved there are written
//! without a look at what is in their way, and then what they were copied from is erased. So a sector is looked at
//! before that, and erased again if it has to be.

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

/// How many erases of the other sector a sector has room for: one in normal operation, and one more for each time that
/// the power is cut while records are being moved. Erases beyond that are not protected.
const ANNOUNCEMENTS: usize = 16;

/// Announces an erase. Neither a word that a cut has torn nor one with a flipped bit reads so.
const ANNOUNCED: u8 = 0x5A;
const DONE: u8 = 0;
/// The mark at the front of a sector that is begun.
const BEGUN: u8 = 0;
/// What an erased byte reads.
pub const ERASED: u8 = 0xFF;

/// The longest word that there is room for.
pub(crate) const WORD_MAX: usize = 32;

/// A flash of two sectors that finishes every erase. Its sectors are shorter by the place for the announcements.
#[derive(Debug)]
pub struct SureErase<F> {
    flash: F,
}

impl<F: NorFlash> SureErase<F> {
    /// An announcement is two words: that an erase begins, and that it is done.
    const ANNOUNCEMENT: usize = 2 * F::WRITE_SIZE;
    /// The bytes of a sector that are left.
    pub const SECTOR: usize = F::ERASE_SIZE - ANNOUNCEMENTS * Self::ANNOUNCEMENT;

    /// Finishes what was announced and not done. To be done anew after every error.
    ///
    /// # Errors
    /// Those of the flash.
    pub fn open(flash: F) -> Result<Self, F::Error> {
        const { assert!(F::WRITE_SIZE <= WORD_MAX && F::WRITE_SIZE.is_multiple_of(F::READ_SIZE)) }
        let mut opened = Self { flash };
        for sector in 0..2 {
            for number in 0..ANNOUNCEMENTS {
                if opened.announcement(sector, number)? == [Some(ANNOUNCED), Some(ERASED)] {
                    opened.finish(sector, number)?;
                }
            }
        }
        Ok(opened)
    }

    /// Returns whether a sector and the other one are begun, and the other one is not full: of two that the map uses, the
    /// older one would be this.
    pub(crate) fn is_older(&mut self, sector: usize) -> Result<bool, F::Error> {
        let (start, other) = (sector * F::ERASE_SIZE, (1 - sector) * F::ERASE_SIZE);
        let other_end = other + Self::SECTOR;
        Ok(!self.is_erased(start, start + F::WRITE_SIZE)?
            && !self.is_erased(other, other + F::WRITE_SIZE)?
            && self.is_erased(other_end - F::WRITE_SIZE, other_end)?)
    }

    /// Returns whether a sector is not begun: of one that holds items, the mark is lost.
    pub(crate) fn is_unmarked(&mut self, sector: usize) -> Result<bool, F::Error> {
        let start = sector * F::ERASE_SIZE;
        self.is_erased(start, start + F::WRITE_SIZE)
    }

    /// Marks a sector as begun.
    pub(crate) fn mark(&mut self, sector: usize) -> Result<(), F::Error> {
        self.flash.write((sector * F::ERASE_SIZE) as u32, &[BEGUN; WORD_MAX][..F::WRITE_SIZE])
    }

    /// Erases a sector.
    pub(crate) fn erase_sector(&mut self, sector: usize) -> Result<(), F::Error> {
        for number in 0..ANNOUNCEMENTS {
            if self.announcement(sector, number)? == [Some(ERASED); 2] {
                let address = Self::address_of(sector, number);
                self.flash.write(address, &[ANNOUNCED; WORD_MAX][..F::WRITE_SIZE])?;
                return self.finish(sector, number);
            }
        }
        self.erase_physical(sector)
    }

    /// Erases a sector as was announced, and notes that it is done.
    fn finish(&mut self, sector: usize, number: usize) -> Result<(), F::Error> {
        self.erase_physical(sector)?;
        let address = Self::address_of(sector, number) + F::WRITE_SIZE as u32;
        self.flash.write(address, &[DONE; WORD_MAX][..F::WRITE_SIZE])
    }

    /// Erases a sector that begins to take what is in the other one, full sector, if anything is in the way.
    fn make_room(&mut self, sector: usize) -> Result<(), F::Error> {
        let other_end = (1 - sector) * F::ERASE_SIZE + Self::SECTOR;
        let start = sector * F::ERASE_SIZE;
        // Its end is marked when it is full. Else nothing is moved, and what is there may be all there is.
        let full = !self.is_erased(other_end - F::WRITE_SIZE, other_end)?;
        if full && !self.is_erased(start, start + Self::SECTOR)? {
            self.erase_sector(sector)?;
        }
        Ok(())
    }

    fn is_erased(&mut self, start: usize, end: usize) -> Result<bool, F::Error> {
        let mut bytes = [0; 4 * WORD_MAX];
        for start in (start..end).step_by(bytes.len()) {
            let bytes = &mut bytes[..(end - start).min(4 * WORD_MAX)];
            self.flash.read(start as u32, bytes)?;
            if bytes.iter().any(|byte| *byte != ERASED) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn erase_physical(&mut self, sector: usize) -> Result<(), F::Error> {
        let start = sector * F::ERASE_SIZE;
        self.flash.erase(start as u32, (start + F::ERASE_SIZE) as u32)
    }

    /// Returns the two words of an announcement about `sector`, each as the byte that it is made of, if it is one.
    fn announcement(&mut self, sector: usize, number: usize) -> Result<[Option<u8>; 2], F::Error> {
        let mut bytes = [0; 2 * WORD_MAX];
        let bytes = &mut bytes[..Self::ANNOUNCEMENT];
        self.flash.read(Self::address_of(sector, number), bytes)?;
        let (announced, done) = bytes.split_at(F::WRITE_SIZE);
        Ok([announced, done].map(|word| word.iter().all(|byte| *byte == word[0]).then_some(word[0])))
    }

    /// Returns where an announcement about `sector` lies: at the end of the other one.
    const fn address_of(sector: usize, number: usize) -> u32 {
        ((1 - sector) * F::ERASE_SIZE + Self::SECTOR + number * Self::ANNOUNCEMENT) as u32
    }

    /// Returns the sector of an address, and where that begins in the flash.
    const fn physical(address: u32) -> (usize, u32) {
        let (sector, within) = (address as usize / Self::SECTOR, address as usize % Self::SECTOR);
        (sector, (sector * F::ERASE_SIZE + within) as u32)
    }
}

impl<F: ErrorType> ErrorType for SureErase<F> {
    type Error = F::Error;
}

/// Nothing that is read or written reaches from one sector into the other.
impl<F: NorFlash> ReadNorFlash for SureErase<F> {
    const READ_SIZE: usize = F::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        self.flash.read(Self::physical(offset).1, bytes)
    }

    fn capacity(&self) -> usize {
        2 * Self::SECTOR
    }
}

impl<F: NorFlash> NorFlash for SureErase<F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = Self::SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        for address in (from..to).step_by(Self::SECTOR) {
            self.erase_sector(Self::physical(address).0)?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        // The mark at the front of a sector is what it begins with.
        if (offset as usize).is_multiple_of(Self::SECTOR) {
            self.make_room(offset as usize / Self::SECTOR)?;
        }
        self.flash.write(Self::physical(offset).1, bytes)
    }
}
