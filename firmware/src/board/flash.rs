//! The two flash sectors of the memory.

use core::pin::pin;
use core::task::{Context, Poll, Waker};

use embassy_stm32::flash::{Async, Error, Flash};
use embassy_stm32::pac::FLASH;
use embassy_stm32::pac::flash::vals::Psize;
use embassy_time::Duration;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use super::clock::supply_is_good;
use super::nucleo::MEMORY;

/// The length of a sector, in bytes.
const SECTOR: usize = 16 * 1024;

/// The maximum time to erase a sector by words (DS9405, DS10693).
pub(super) const LONGEST_ERASE: Duration = Duration::from_millis(500);

/// The two keys that unlock the control register, in this order (RM0090 3.6.1).
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// The two sectors.
pub(super) struct Sectors(pub(super) Flash<'static, Async>);

impl Sectors {
    /// Erases both sectors.
    pub(super) fn erase_all(&mut self) -> Result<(), Error> {
        self.erase(0, 2 * SECTOR as u32)
    }
}

impl ErrorType for Sectors {
    type Error = Error;
}

impl ReadNorFlash for Sectors {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.blocking_read(MEMORY + offset, bytes)
    }

    fn capacity(&self) -> usize {
        2 * SECTOR
    }
}

impl NorFlash for Sectors {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        let _uncached = Uncached::new()?;
        for sector in (MEMORY + from..MEMORY + to).step_by(SECTOR) {
            erase_by_words();
            sleep_until(self.0.erase(sector, sector + SECTOR as u32))?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        let _uncached = Uncached::new()?;
        self.0.blocking_write(MEMORY + offset, bytes)
    }
}

/// Waits for a flash operation in thread mode. The processor sleeps until an interrupt, such as the flash interrupt.
fn sleep_until<T>(operation: impl Future<Output = T>) -> T {
    let mut operation = pin!(operation);
    loop {
        if let Poll::Ready(result) = operation.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return result;
        }
        // An interrupt since the poll has set the event, so `wfe` returns at once.
        cortex_m::asm::wfe();
    }
}

/// Sets the width of erases to words, because the driver uses the present width and leaves it at bytes. Erasing a
/// sector by words takes 250 ms instead of 400 ms.
fn erase_by_words() {
    if FLASH.cr().read().lock() {
        KEYS.into_iter().for_each(|key| FLASH.keyr().write_value(key));
    }
    FLASH.cr().modify(|control| control.set_psize(Psize::PSIZE32));
}

/// The disabled data cache. Dropping the value enables the cache, which is then empty.
///
/// Cached data are outdated after an erase or a write (RM0090 3.6.4, RM0390 3.5.4). In a flash with two banks, a read
/// of one bank during a write of the other can also corrupt the cache (ES0206). The driver has a workaround, but treats
/// the STM32F429 as a part with one bank.
struct Uncached;

impl Uncached {
    /// Disables the data cache.
    ///
    /// # Errors Returns [`Error::Protected`] if the supply is too low for writing.
    fn new() -> Result<Self, Error> {
        if !supply_is_good() {
            return Err(Error::Protected);
        }
        FLASH.acr().modify(|acr| acr.set_dcen(false));
        Ok(Self)
    }
}

impl Drop for Uncached {
    fn drop(&mut self) {
        FLASH.acr().modify(|acr| acr.set_dcrst(true));
        FLASH.acr().modify(|acr| acr.set_dcrst(false));
        FLASH.acr().modify(|acr| acr.set_dcen(true));
    }
}
