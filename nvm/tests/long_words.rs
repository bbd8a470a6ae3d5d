//! A flash with words longer than those of the boards: as long as the header of an item.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use nvm::{BUFFER, Contents, ERASED, Records};
use protocol_core::memory::{RecordKey, seal};

const WORD: usize = 8;
const SECTOR: usize = 2048;

/// Two sectors in RAM.
struct Flash([u8; 2 * SECTOR]);

impl ErrorType for Flash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let found = self.0.get(offset as usize..).and_then(|rest| rest.get(..bytes.len()));
        bytes.copy_from_slice(found.ok_or(NorFlashErrorKind::OutOfBounds)?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.0[from as usize..to as usize].fill(ERASED);
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.0[offset as usize..][..bytes.len()].iter_mut().zip(bytes).for_each(|(cell, byte)| *cell &= byte);
        Ok(())
    }
}

#[test]
fn clearing_steps_over_a_torn_header() {
    let mut flash = Flash([ERASED; 2 * SECTOR]);
    let mut buffer = [0; BUFFER];
    let mut records = Records::new(&mut flash, &mut buffer);
    records.store_setting(b"kind").unwrap();
    records.store(RecordKey::LocalLayer, &seal(1, b"\x20\x03").unwrap()).unwrap();
    // The power was cut in the word with the header of an eight-byte item: its length is written, its checksum is not.
    let end = flash.0.chunks_exact(WORD).position(|word| word == [ERASED; WORD]).unwrap() * WORD;
    flash.write(end as u32, &[0x62, 0xD0, 0xE7, 0x75, 8, 0, 0xFF, 0xFF]).unwrap();

    let mut records = Records::new(&mut flash, &mut buffer);
    assert_eq!(records.clear(), Ok(()));
    let mut contents = Contents::empty();
    records.read(&mut contents).unwrap();
    assert!(contents.image.is_new());
    assert_eq!(contents.setting.as_deref(), Some(&b"kind"[..]));
}
