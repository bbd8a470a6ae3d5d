//! The non-volatile memory of one device: a flash with a record store on it, in RAM alone or kept in a file.

mod cells;
mod file;
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

use protocol_core::memory::{Image, Record, RecordKey, StoreError};

pub use cells::{ERASED, SECTOR, SIZE};
pub use file::{Content, MemoryFile, MemoryFileError};
pub use flash::{Flash, FlashError, TornErase, WORD};

use nvm::{BUFFER, Contents, Records, Unreadable};

/// What fills a flash that cannot be read: no map writes so.
const SPOILT: u8 = 0xA5;

/// The non-volatile memory of one device.
#[derive(Debug, Default)]
pub struct Memory {
    flash: Flash,
    file: Option<Box<dyn MemoryFile>>,
    /// What was there could not be read and was put aside: to be told with the next image.
    damaged: bool,
    /// The next image is to find the flash unreadable.
    spoilt: bool,
    /// What was in the flash before it was erased because it could not be read; a file keeps it in a file.
    put_aside: Option<Vec<u8>>,
    warnings: Vec<String>,
}

/// The clone of a memory in a file is in RAM, with what the file holds.
impl Clone for Memory {
    fn clone(&self) -> Self {
        let Self { flash, file: _, damaged, spoilt, put_aside, warnings } = self;
        Self {
            flash: flash.clone(),
            file: None,
            damaged: *damaged,
            spoilt: *spoilt,
            put_aside: put_aside.clone(),
            warnings: warnings.clone(),
        }
    }
}

impl Memory {
    /// A new memory that is lost with the process.
    #[must_use]
    pub fn in_ram() -> Self {
        Self::default()
    }

    /// A memory with this flash.
    #[must_use]
    pub fn with_flash(flash: Flash) -> Self {
        Self { flash, ..Self::default() }
    }

    /// Returns the memory that a file keeps; a new one where the file is new.
    ///
    /// Damaged content is put aside, and the memory starts empty and damaged: see
    /// [`take_warnings`](Self::take_warnings).
    ///
    /// # Errors
    /// When the file cannot be written or put aside. It is not changed then.
    pub fn kept_in(file: Box<dyn MemoryFile>, content: Content) -> Result<Self, MemoryFileError> {
        let mut memory = Self { file: Some(file), ..Self::default() };
        match content {
            Content::New => {}
            // A copy is looked at: opening it may finish what a power cut left half done.
            Content::Image(flash) if read(&mut flash.clone()).is_ok() => memory.flash = flash,
            Content::Image(_) | Content::Damaged => memory.put_file_aside()?,
        }
        // A folder that cannot be written to is found out now.
        memory.persist()?;
        Ok(memory)
    }

    /// Everything stored, as a device finds it when it starts.
    ///
    /// A memory that cannot be read as a whole is put aside and erased, so that it can be written again; the image says
    /// that it was damaged, once.
    pub fn read_image(&mut self) -> Image {
        if std::mem::take(&mut self.spoilt) {
            self.flash.fill(|_| SPOILT);
        }
        // Opening it may finish what a power cut left half done, and that must not spoil what is to be put aside.
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

    /// Returns what a device would find if it started now, and leaves everything as it is.
    #[must_use]
    pub fn peek_image(&self) -> Image {
        let mut flash = self.flash.clone();
        flash.restore_power();
        let found = if self.spoilt { Err(Unreadable) } else { read(&mut flash) };
        let is_damaged = self.damaged || found.is_err();
        let mut image = found.unwrap_or_else(|Unreadable| Image::empty());
        if is_damaged {
            image.set_damaged();
        }
        image
    }

    /// Writes a record.
    ///
    /// # Errors
    /// [`StoreError`] when the flash or the file cannot be written. Neither holds the record then: the next write would
    /// bring it back, or the next start.
    pub fn store(&mut self, key: RecordKey, record: &Record) -> Result<(), StoreError> {
        let kept = self.file.as_ref().map(|_| self.flash.cells().clone());
        let stored = store(&mut self.flash, key, record);
        if let Err(error) = self.persist() {
            self.warnings.push(error.to_string());
            if let Some(cells) = kept {
                self.flash.set_cells(cells);
                // A folder that cannot be synced may have the new file already.
                let _ = self.persist();
            }
            return Err(StoreError);
        }
        stored
    }

    /// Writes a record, of which the power cut leaves the part `numerator / denominator`, in words.
    pub fn store_cut(&mut self, key: RecordKey, record: &Record, numerator: u64, denominator: u64) {
        let mut trial = self.flash.clone();
        let before = trial.word_writes() + trial.erases();
        // How it would have ended does not matter, only how many operations it takes.
        let _ = store(&mut trial, key, record);
        let operations = trial.word_writes() + trial.erases() - before;
        let reached = u128::from(operations) * u128::from(numerator) / u128::from(denominator.max(1));
        self.flash.cut_power_after(u64::try_from(reached).unwrap_or(u64::MAX));
        // The device that waits for the answer is without power, too.
        let _ = self.store(key, record);
        self.flash.restore_power();
    }

    /// The power came back: a flash that lost it in the middle of a write works again.
    pub fn power_up(&mut self) {
        if self.flash.is_dead() {
            self.flash.restore_power();
        }
    }

    /// The flash.
    #[must_use]
    pub const fn flash(&self) -> &Flash {
        &self.flash
    }

    /// The flash, to inject faults into.
    pub const fn flash_mut(&mut self) -> &mut Flash {
        &mut self.flash
    }

    /// From now on writes fail, or do so no longer.
    pub const fn set_write_fails(&mut self, fails: bool) {
        self.flash.set_write_fails(fails);
    }

    /// Whether writes fail.
    #[must_use]
    pub const fn write_fails(&self) -> bool {
        self.flash.write_fails()
    }

    /// The next [`read_image`](Self::read_image) cannot read the memory, or can again.
    pub const fn set_spoilt(&mut self, spoilt: bool) {
        self.spoilt = spoilt;
    }

    /// Whether the next [`read_image`](Self::read_image) cannot read the memory.
    #[must_use]
    pub const fn is_spoilt(&self) -> bool {
        self.spoilt
    }

    /// What the user should know, a line each: once.
    pub fn take_warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }

    /// The flash image that could not be read and was erased, of a memory without a file.
    #[must_use]
    pub fn put_aside(&self) -> Option<&[u8]> {
        self.put_aside.as_deref()
    }

    /// The flash cannot be read: keeps what is in it aside, and erases it. One that cannot be erased stays as it is.
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
        self.file.as_ref().map_or(Ok(()), |file| file.write(&self.flash.image()))
    }
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
