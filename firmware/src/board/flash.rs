//! The device's memory: two sectors of the second flash bank. The processor runs from the first one meanwhile.

use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll, Waker};

use embassy_stm32::flash::{Bank2Region1, Blocking, Error};
use embedded_storage_async::nor_flash::{ErrorType, MultiwriteNorFlash, NorFlash, ReadNorFlash};
use nvm::{BUFFER, Records};
use protocol_core::memory::{Image, Record, RecordKey, StoreError};

/// The sectors of the bank's first region are so long.
const SECTOR: usize = 16 * 1024;

/// The two sectors.
pub(super) struct Bank {
    region: Bank2Region1<'static, Blocking>,
    buffer: &'static mut [u8; BUFFER],
}

impl Bank {
    pub(super) fn new(region: Bank2Region1<'static, Blocking>) -> Self {
        let buffer = cortex_m::singleton!(: [u8; BUFFER] = [0; BUFFER]);
        // There is one bank, so this runs once.
        Self { region, buffer: buffer.unwrap_or_else(|| cortex_m::peripheral::SCB::sys_reset()) }
    }

    /// Everything stored, as it is now.
    pub(super) fn image(&mut self) -> Image {
        let Self { region, buffer } = self;
        let mut image = ready(async {
            let mut records = Records::open(Region(region), buffer).await.ok()?;
            records.read().await.ok()
        });
        if image.is_none() {
            // Nothing in it makes sense: begin anew, and tell.
            let erased = ready(Region(region).erase(0, 2 * SECTOR as u32)).is_ok();
            defmt::error!("the memory was damaged; erased: {}", erased);
            let mut empty = Image::empty();
            empty.set_damaged();
            image = Some(empty);
        }
        image.unwrap_or_default()
    }

    /// Writes a record.
    pub(super) fn store(&mut self, key: RecordKey, record: &Record) -> Result<(), StoreError> {
        let Self { region, buffer } = self;
        ready(async {
            let mut records = Records::open(Region(region), buffer).await.map_err(|_| StoreError)?;
            records.store(key, record).await
        })
    }
}

/// The region as the record store wants it.
struct Region<'a>(&'a mut Bank2Region1<'static, Blocking>);

impl ErrorType for Region<'_> {
    type Error = Error;
}

impl ReadNorFlash for Region<'_> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.blocking_read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        2 * SECTOR
    }
}

impl NorFlash for Region<'_> {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        self.0.blocking_erase(from, to)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        self.0.blocking_write(offset, bytes)
    }
}

impl MultiwriteNorFlash for Region<'_> {}

/// The result of a future that waits for nothing: the flash blocks.
fn ready<F: Future>(future: F) -> F::Output {
    let mut future = pin!(future);
    loop {
        if let Poll::Ready(output) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return output;
        }
    }
}
