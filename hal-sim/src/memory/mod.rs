//! The non-volatile memory of one device: a flash with a record store, in RAM or backed by a file.

mod flash;

#[cfg(test)]
mod damage_tests;
#[cfg(test)]
mod power_cut_tests;
#[cfg(test)]
mod read_tests;
#[cfg(test)]
mod setting_tests;
#[cfg(test)]
mod tests;

use std::error::Error;
use std::fmt::Debug;

use protocol_core::memory::{Image, Record, RecordKey, StoreError};

pub use flash::{ERASED, Flash, FlashError, SECTOR, SIZE, TornErase, WORD};

use nvm::{BUFFER, Contents, Records, Unreadable};

/// The fill byte of an unreadable flash. The record store never produces such content.
const SPOILT: u8 = 0xA5;

/// The non-volatile memory of one device.
#[derive(Debug, Default)]
pub struct Memory {
    flash: Flash,
    file: Option<Box<dyn MemoryFile>>,
    /// True if unreadable content was found. The next image reports the damage.
    damaged: bool,
    /// True if the next read of the image simulates an unreadable flash.
    spoilt: bool,
    /// The unreadable content that the last failed [`read_image`](Self::read_image) found, before the erase.
    put_aside: Option<Vec<u8>>,
    warnings: Vec<String>,
}

/// A clone of a file-backed memory is in RAM and starts with the same content.
impl Clone for Memory {
    fn clone(&self) -> Self {
        let (flash, put_aside, warnings) = (self.flash.clone(), self.put_aside.clone(), self.warnings.clone());
        Self { flash, file: None, put_aside, warnings, ..*self }
    }
}

impl Memory {
    /// Creates an empty memory in RAM.
    #[must_use]
    pub fn in_ram() -> Self {
        Self::default()
    }

    /// Creates a memory in RAM with this flash.
    #[must_use]
    pub fn with_flash(flash: Flash) -> Self {
        Self { flash, ..Self::default() }
    }

    /// Creates a memory backed by a file with this content.
    ///
    /// Damaged content is put aside: the memory starts empty and is marked as damaged.
    /// [`take_warnings`](Self::take_warnings) returns the details.
    ///
    /// # Errors
    /// [`MemoryFileError`] if the file cannot be put aside or written.
    pub fn kept_in(file: Box<dyn MemoryFile>, content: Content) -> Result<Self, MemoryFileError> {
        let mut memory = Self { file: Some(file), ..Self::default() };
        match content {
            Content::New => {}
            // Opens a copy, because opening the store may complete an operation that a power cut interrupted.
            Content::Image(flash) if read(&mut flash.clone()).is_ok() => memory.flash = flash,
            Content::Image(_) | Content::Damaged => memory.put_file_aside()?,
        }
        // Fails early if the folder is not writable.
        memory.persist()?;
        Ok(memory)
    }

    /// Reads all records, as a device does at its start.
    ///
    /// The image of unreadable content is marked as damaged. The content is put aside and the flash is erased, so that
    /// records can be written again and later images are not damaged. A flash that cannot be written keeps its content.
    pub fn read_image(&mut self) -> Image {
        if std::mem::take(&mut self.spoilt) {
            self.flash.fill(|_| SPOILT);
        }
        // Opening the store may complete an interrupted operation; the content to put aside must remain unchanged.
        let found = self.flash.clone();
        let mut image = read(&mut self.flash).unwrap_or_else(|Unreadable| {
            self.give_up(&found);
            Image::empty()
        });
        if std::mem::take(&mut self.damaged) {
            image.set_damaged();
        }
        image
    }

    /// Returns the image that a device would read at its start, without changing the memory.
    #[must_use]
    pub fn peek_image(&self) -> Image {
        let mut copy = self.clone();
        copy.flash.restore_power();
        copy.read_image()
    }

    /// Writes a record.
    ///
    /// # Errors
    /// [`StoreError`] if the flash or the file cannot be written. Neither of them then contains the record, so that no
    /// later write or start can restore it.
    pub fn store(&mut self, key: RecordKey, record: &Record) -> Result<(), StoreError> {
        let kept = self.file.as_ref().map(|_| self.flash.cells.clone());
        let stored = store(&mut self.flash, key, record);
        if let Err(error) = self.persist() {
            self.warnings.push(error.to_string());
            if let Some(cells) = kept {
                self.flash.cells = cells;
                // The file may already have the new content, for example if only the sync failed. Restores the old
                // content.
                let _ = self.persist();
            }
            return Err(StoreError);
        }
        stored
    }

    /// Writes a record, but cuts the power after `numerator / denominator` of its flash operations.
    pub fn store_cut(&mut self, key: RecordKey, record: &Record, numerator: u64, denominator: u64) {
        let mut trial = self.flash.clone();
        let before = trial.word_writes() + trial.erases();
        // The trial run only counts the operations; its result is irrelevant.
        let _ = store(&mut trial, key, record);
        let operations = trial.word_writes() + trial.erases() - before;
        let reached = u128::from(operations) * u128::from(numerator) / u128::from(denominator.max(1));
        self.flash.cut_power_after(u64::try_from(reached).unwrap_or(u64::MAX));
        // The device has lost power and cannot detect the result.
        let _ = self.store(key, record);
        self.flash.restore_power();
    }

    /// Restores the power: writes succeed again after a power cut.
    pub fn power_up(&mut self) {
        if self.flash.is_dead() {
            self.flash.restore_power();
        }
    }

    /// Returns the flash.
    #[must_use]
    pub const fn flash(&self) -> &Flash {
        &self.flash
    }

    /// Returns the flash, for fault injection.
    pub const fn flash_mut(&mut self) -> &mut Flash {
        &mut self.flash
    }

    /// Sets whether writes fail.
    pub const fn set_write_fails(&mut self, fails: bool) {
        self.flash.set_write_fails(fails);
    }

    /// Returns whether writes fail.
    #[must_use]
    pub const fn write_fails(&self) -> bool {
        self.flash.write_fails()
    }

    /// Sets whether the next [`read_image`](Self::read_image) finds the memory unreadable.
    pub const fn set_spoilt(&mut self, spoilt: bool) {
        self.spoilt = spoilt;
    }

    /// Returns whether the next [`read_image`](Self::read_image) finds the memory unreadable.
    #[must_use]
    pub const fn is_spoilt(&self) -> bool {
        self.spoilt
    }

    /// Takes the warnings for the user, one line each.
    pub fn take_warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }

    /// Returns the unreadable content that [`read_image`](Self::read_image) put aside, if any.
    #[must_use]
    pub fn put_aside(&self) -> Option<&[u8]> {
        self.put_aside.as_deref()
    }

    /// Puts unreadable content aside and erases the flash. If the flash cannot be written, its content is kept.
    fn give_up(&mut self, found: &Flash) {
        self.damaged = true;
        if !self.flash.can_be_written() {
            return;
        }
        self.put_aside = Some(found.image());
        self.flash.fill(|_| ERASED);
        if let Err(error) = self.persist_aside().and_then(|()| self.persist()) {
            self.warnings.push(error.to_string());
        }
    }

    fn persist_aside(&mut self) -> Result<(), MemoryFileError> {
        let (Some(file), Some(image)) = (&self.file, &self.put_aside) else { return Ok(()) };
        file.write(image)?;
        self.put_file_aside()
    }

    fn put_file_aside(&mut self) -> Result<(), MemoryFileError> {
        if let Some(file) = &self.file {
            let warning = file.put_aside()?;
            self.warnings.push(warning);
        }
        self.damaged = true;
        Ok(())
    }

    fn persist(&self) -> Result<(), MemoryFileError> {
        self.file.as_ref().map_or(Ok(()), |file| file.write(&self.flash.cells))
    }
}

/// The reason why a file cannot be written or put aside. Its text is one line that includes the file name.
pub type MemoryFileError = Box<dyn Error + Send + Sync>;

/// A file with the image of a flash. The caller implements this trait, because the library writes no files.
pub trait MemoryFile: Debug + Send {
    /// Replaces the image. When the function returns `Ok`, the image is on disk.
    ///
    /// # Errors
    /// [`MemoryFileError`] if the file cannot be written. The file then contains the previous or the new image.
    fn write(&self, image: &[u8]) -> Result<(), MemoryFileError>;

    /// Moves unusable content aside; the next write creates a new file. Returns a one-line message for the user.
    ///
    /// # Errors
    /// [`MemoryFileError`] if the file cannot be moved. The file is then unchanged.
    fn put_aside(&self) -> Result<String, MemoryFileError>;
}

/// The content of a memory file at opening.
#[derive(Debug)]
pub enum Content {
    /// The file did not exist.
    New,
    /// The image of a flash.
    Image(Flash),
    /// The content is not a flash image.
    Damaged,
}

fn read(flash: &mut Flash) -> Result<Image, Unreadable> {
    let mut buffer = [0; BUFFER];
    let mut records = Records::new(flash, &mut buffer);
    let mut contents = Contents::empty();
    records.read(&mut contents).map(|()| contents.image)
}

fn store(flash: &mut Flash, key: RecordKey, record: &Record) -> Result<(), StoreError> {
    let mut buffer = [0; BUFFER];
    let mut records = Records::new(flash, &mut buffer);
    records.store(key, record)
}
