//! Looking at a flash without touching it.
//!
//! `sequential-storage` erases a sector that makes no sense to it even when it is only asked what is there. Then nobody
//! could tell afterwards that something had been, and been damaged. Here such an erase only seems to happen.

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use crate::SECTORS;
use crate::sure_erase::ERASED;

/// A flash that is read only: what was to be erased reads so, and is not.
pub(crate) struct Preview<S> {
    flash: S,
    erased: [bool; SECTORS],
}

impl<S: NorFlash> Preview<S> {
    pub(crate) const fn new(flash: S) -> Self {
        Self { flash, erased: [false; SECTORS] }
    }
}

impl<S: ErrorType> ErrorType for Preview<S> {
    type Error = S::Error;
}

impl<S: NorFlash> ReadNorFlash for Preview<S> {
    const READ_SIZE: usize = S::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), S::Error> {
        self.flash.read(offset, bytes).await?;
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

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), S::Error> {
        let sectors = from as usize / S::ERASE_SIZE..to as usize / S::ERASE_SIZE;
        self.erased.iter_mut().take(sectors.end).skip(sectors.start).for_each(|erased| *erased = true);
        Ok(())
    }

    /// Looking writes nothing but to sectors that it has erased.
    async fn write(&mut self, _: u32, _: &[u8]) -> Result<(), S::Error> {
        Ok(())
    }
}
