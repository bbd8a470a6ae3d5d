//! Looking at a flash without touching it, or touching it as well.
//!
//! `sequential-storage` erases a sector that makes no sense to it even when it is only asked what is there. Then nobody
//! could tell afterwards that something had been, and been damaged. Here such an erase only seems to happen.

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use crate::SECTORS;
use crate::sure_erase::ERASED;

/// A flash that is looked at only, or written to: one type for both, so that there is one map over it on the board.
pub(crate) struct Preview<S> {
    flash: S,
    /// Whether it is looked at only: what was to be erased reads so, and is not.
    looking: bool,
    erased: [bool; SECTORS],
}

impl<S: NorFlash> Preview<S> {
    /// Lets everything read and nothing change; some sectors seem to be erased.
    pub(crate) const fn looking(flash: S, erased: [bool; SECTORS]) -> Self {
        Self { flash, looking: true, erased }
    }

    /// Lets everything through.
    pub(crate) const fn writing(flash: S) -> Self {
        Self { flash, looking: false, erased: [false; SECTORS] }
    }
}

impl<S: ErrorType> ErrorType for Preview<S> {
    type Error = S::Error;
}

impl<S: NorFlash> ReadNorFlash for Preview<S> {
    const READ_SIZE: usize = S::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), S::Error> {
        self.flash.read(offset, bytes)?;
        if self.erased.get(offset as usize / S::ERASE_SIZE) == Some(&true) {
            bytes.fill(ERASED);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<S: NorFlash> NorFlash for Preview<S> {
    const WRITE_SIZE: usize = S::WRITE_SIZE;
    const ERASE_SIZE: usize = S::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), S::Error> {
        if !self.looking {
            return self.flash.erase(from, to);
        }
        let sectors = from as usize / S::ERASE_SIZE..to as usize / S::ERASE_SIZE;
        self.erased.iter_mut().take(sectors.end).skip(sectors.start).for_each(|erased| *erased = true);
        Ok(())
    }

    /// Writes nothing while looking: the map writes only to sectors that it has erased.
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), S::Error> {
        if self.looking { Ok(()) } else { self.flash.write(offset, bytes) }
    }
}
