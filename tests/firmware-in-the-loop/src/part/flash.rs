//! The flash in the emulated part: the registers of the interface, and the sectors of the memory as a window of bytes.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::device::{Device, DeviceContext, ErasedDevice, Level, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::flash::Register;
use rigless::soc::{Layout, RegisterSpec, Width};
use rigless::time::{EventId, VirtualNanos};

use crate::flash::Flash;

/// The flash, which the processor and tests share.
#[derive(Clone, Debug, Default)]
pub struct SharedFlash(Arc<Mutex<Flash>>);

impl SharedFlash {
    /// Creates a shared flash.
    #[must_use]
    pub fn new(flash: Flash) -> Self {
        Self(Arc::new(Mutex::new(flash)))
    }

    /// Returns whether the processor stalls, because it waits for its only bank.
    pub(crate) fn holds(&self, now: VirtualNanos) -> bool {
        self.lock().holds(now.0)
    }

    /// Locks the flash.
    pub fn lock(&self) -> MutexGuard<'_, Flash> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The flash interface.
#[derive(Debug)]
pub(super) struct FlashInterface {
    pub(super) shared: SharedFlash,
    line: bool,
}

impl FlashInterface {
    pub(super) fn new(shared: SharedFlash) -> Self {
        Self { shared, line: false }
    }

    fn drive_line(&mut self, context: &mut DeviceContext<'_>) {
        let mut flash = self.shared.lock();
        flash.settle(context.now().0);
        let wanted = flash.interrupt();
        if std::mem::replace(&mut self.line, wanted) != wanted {
            context.interrupt(0, Level::from(wanted));
        }
        if let Some(due) = flash.due() {
            context.schedule(VirtualNanos(due));
        }
    }
}

impl Device for FlashInterface {
    type Register = Register;

    fn read(&mut self, register: Register, _: &mut RegisterFile, context: &mut DeviceContext<'_>) -> Option<u64> {
        let value = self.shared.lock().read_register(register.spec().offset, context.now().0);
        value.map(u64::from)
    }

    fn write(&mut self, register: Register, value: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.shared.lock().write_register(register.spec().offset, value as u32, context.now().0);
        self.drive_line(context);
    }

    fn on_event(&mut self, _: EventId, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.drive_line(context);
    }

    /// Handles the beginning and the end of operations.
    fn poll(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.drive_line(context);
    }
}

/// The sectors of the memory.
#[derive(Debug)]
pub(super) struct MemorySectors {
    shared: SharedFlash,
    /// The register table of the window, which is empty. The emulator identifies it by its address.
    table: &'static [RegisterSpec],
}

impl MemorySectors {
    pub(super) fn new(shared: SharedFlash, table: &'static [RegisterSpec]) -> Self {
        Self { shared, table }
    }
}

impl ErasedDevice for MemorySectors {
    fn layout(&self) -> &'static [RegisterSpec] {
        self.table
    }

    fn read(&mut self, _: usize, _: &mut RegisterFile, _: &mut DeviceContext<'_>) -> Option<u64> {
        None
    }

    fn write(&mut self, _: usize, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_event(&mut self, _: EventId, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_request(&mut self, _: RequestChange, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_clock(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn poll(&mut self, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn reset(&mut self) {}

    fn on_access(&mut self, _: u64, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_refused(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn read_window(&mut self, offset: u64, width: Width, context: &mut DeviceContext<'_>) -> u64 {
        self.shared.lock().read(offset as usize, bytes(width), context.now().0)
    }

    fn write_window(&mut self, offset: u64, width: Width, value: u64, context: &mut DeviceContext<'_>) {
        let mut flash = self.shared.lock();
        flash.write(offset as usize, bytes(width), value, context.now().0);
        // The end of an operation is an event of the part, at which the interface checks its interrupt.
        if let Some(due) = flash.due() {
            context.schedule(VirtualNanos(due));
        }
    }
}

fn bytes(width: Width) -> usize {
    width.bits() as usize / 8
}
