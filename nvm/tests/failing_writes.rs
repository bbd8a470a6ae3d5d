//! Writes that fail without saying so, or say so although they succeeded (SPEC 6).

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use nvm::{BUFFER, Contents, ERASED, Records};
use protocol_core::memory::{Record, RecordKey, seal};

const WORD: usize = 4;
const SECTOR: usize = 2048;
const KEY: RecordKey = RecordKey::LocalLayer;

/// What happens to writes.
#[derive(Clone, Copy)]
enum Fault {
    None,
    /// Reported as done, and nothing is written.
    Silent,
    /// One bit of the first write stays 1.
    Flipped,
    /// Written and reported as failed.
    Late,
}

/// Two sectors in RAM.
struct Flash {
    cells: [u8; 2 * SECTOR],
    fault: Fault,
}

impl Flash {
    const fn blank() -> Self {
        Self { cells: [ERASED; 2 * SECTOR], fault: Fault::None }
    }

    fn store(&mut self, fault: Fault, record: &Record) -> bool {
        self.fault = fault;
        let mut buffer = [0; BUFFER];
        let is_stored = Records::new(&mut *self, &mut buffer).store(KEY, record).is_ok();
        self.fault = Fault::None;
        is_stored
    }

    /// Returns the payload of the record, as the next start reads it.
    fn payload(&mut self) -> Option<Vec<u8>> {
        let (mut buffer, mut contents) = ([0; BUFFER], Contents::empty());
        Records::new(&mut *self, &mut buffer).read(&mut contents).expect("a memory");
        contents.image.payload(KEY, 1).expect("an intact record").map(<[u8]>::to_vec)
    }
}

impl ErrorType for Flash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let found = self.cells.get(offset as usize..).and_then(|rest| rest.get(..bytes.len()));
        bytes.copy_from_slice(found.ok_or(NorFlashErrorKind::OutOfBounds)?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.cells.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.cells[from as usize..to as usize].fill(ERASED);
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        if let Fault::Silent = self.fault {
            return Ok(());
        }
        let cells = &mut self.cells[offset as usize..][..bytes.len()];
        cells.iter_mut().zip(bytes).for_each(|(cell, byte)| *cell &= byte);
        match self.fault {
            Fault::Flipped => {
                // In the content, behind the header.
                cells[2 * bytes.len() / 3] ^= 0x80;
                self.fault = Fault::None;
                Ok(())
            }
            Fault::Late => Err(NorFlashErrorKind::Other),
            Fault::None | Fault::Silent => Ok(()),
        }
    }
}

fn record(byte: u8) -> Record {
    seal(1, &[byte; 8]).expect("a record")
}

#[test]
fn a_write_that_silently_fails_is_no_store() {
    let mut flash = Flash::blank();
    assert!(flash.store(Fault::None, &record(1)));
    assert!(!flash.store(Fault::Silent, &record(2)));
    assert_eq!(flash.payload(), Some(vec![1; 8]));
    assert!(flash.store(Fault::None, &record(2)));
    assert_eq!(flash.payload(), Some(vec![2; 8]));
}

#[test]
fn a_flipped_bit_is_found_when_it_is_read_back() {
    let mut flash = Flash::blank();
    assert!(flash.store(Fault::None, &record(1)));
    // Written again behind the damaged entry.
    assert!(flash.store(Fault::Flipped, &record(2)));
    assert_eq!(flash.payload(), Some(vec![2; 8]));
}

/// The new content is there, whatever the flash said; the same content again could be the earlier one.
#[test]
fn a_write_that_succeeds_and_is_reported_as_failed() {
    let mut flash = Flash::blank();
    assert!(flash.store(Fault::None, &record(1)));
    assert!(flash.store(Fault::Late, &record(2)));
    assert_eq!(flash.payload(), Some(vec![2; 8]));
    assert!(!flash.store(Fault::Late, &record(2)));
    assert_eq!(flash.payload(), Some(vec![2; 8]));
}
