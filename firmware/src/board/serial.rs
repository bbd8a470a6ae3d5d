//! The serial port of the console: 115200 baud, with DMA in both directions. The DMA receives characters even while an
//! erase stalls the processor.
//!
//! The drivers of embassy-stm32 0.6 do not report all damage. `BufferedUart` drops the error flags of the receiver.
//! `RingBufferedUartRx` continues after an error with old positions, and counts two rounds of its ring during an erase
//! as one round. Here the DMA fills a buffer once and stops. More characters cause an overrun, which the receiver
//! reports.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_futures::select::select;
use embassy_stm32::Peri;
use embassy_stm32::dma::{Channel, InterruptHandler, Request, Transfer};
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::typelevel::Binding;
use embassy_stm32::mode::Blocking;
use embassy_stm32::usart::{Config, Instance, RxDma, RxPin, TxDma, TxPin, Uart};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;

use super::nucleo::UART;

/// The number of bytes of a DMA transfer: a line and the beginning of the next line.
pub(super) const BUFFER: usize = 64;

/// The signal that the line is idle after a character, or that a character is damaged.
static ARRIVED: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// Whether characters were damaged or lost.
static DAMAGED: AtomicBool = AtomicBool::new(false);

/// Handles the UART interrupt, which must preempt the console task. This task takes the characters and then
/// checks for damage.
pub(super) fn on_interrupt() {
    let status = UART.sr().read();
    // Reading the data clears the flags. It also consumes a character that the DMA has not transferred yet.
    UART.dr().read();
    if status.ore() || status.fe() || status.ne() || status.rxne() {
        DAMAGED.store(true, Ordering::Relaxed);
    }
    ARRIVED.signal(());
}

/// The serial port.
pub(super) struct Port {
    pub(super) receiver: Receiver,
    pub(super) transmitter: Transmitter,
    /// Keeps the pins and the clock of the UART enabled.
    _uart: Uart<'static, Blocking>,
}

impl Port {
    /// Opens the port.
    pub(super) fn open<U: Instance, R: RxDma<U>, T: TxDma<U>>(
        uart: Peri<'static, U>,
        (rx, tx): (Peri<'static, impl RxPin<U>>, Peri<'static, impl TxPin<U>>),
        (receive, transmit): (Peri<'static, R>, Peri<'static, T>),
        interrupts: impl Binding<R::Interrupt, InterruptHandler<R>> + Binding<T::Interrupt, InterruptHandler<T>> + 'static,
    ) -> Option<Self> {
        let transmitter = Transmitter {
            request: transmit.request(),
            channel: Channel::new(transmit, interrupts),
            buffer: cortex_m::singleton!(: [u8; BUFFER] = [0; BUFFER])?,
        };
        let receiver = Receiver { request: receive.request(), channel: Channel::new(receive, interrupts) };
        let mut config = Config::default();
        // Without an ST-LINK nothing drives the pin.
        config.rx_pull = Pull::Up;
        let uart = Uart::new_blocking(uart, rx, tx, config).ok()?;
        UART.cr3().modify(|control| {
            control.set_dmar(true);
            control.set_dmat(true);
            control.set_eie(true);
        });
        UART.cr1().modify(|control| control.set_idleie(true));
        Some(Self { receiver, transmitter, _uart: uart })
    }
}

/// The receiving half of the serial port.
pub(super) struct Receiver {
    channel: Channel<'static>,
    request: Request,
}

impl Receiver {
    /// Starts a transfer that fills a buffer.
    pub(super) fn fill<'a>(&'a mut self, buffer: &'a mut [u8; BUFFER]) -> Transfer<'a> {
        let data = UART.dr().as_ptr().cast::<u8>();
        // SAFETY: only the interrupt handler also reads the data register, and counts a character that it takes as
        // damage. The transfer ends before the borrow of the buffer does: no transfer in this crate is forgotten.
        unsafe { self.channel.read(self.request, data, buffer, Default::default()) }
    }
}

/// Waits for characters or damage, and stops the transfer. Returns the number of characters, and whether any were
/// damaged or lost. Damage without characters is reported with the next characters.
pub(super) async fn arrived(mut transfer: Transfer<'_>) -> (usize, bool) {
    select(&mut transfer, ARRIVED.wait()).await;
    transfer.request_pause();
    while transfer.is_running() {}
    let left = transfer.get_remaining_transfers() as usize;
    // Until the next transfer, the receiver can hold one more character.
    drop(transfer);
    let count = BUFFER - left;
    (count, count > 0 && DAMAGED.swap(false, Ordering::Relaxed))
}

/// The sending half of the serial port.
pub(super) struct Transmitter {
    channel: Channel<'static>,
    request: Request,
    /// The copy in RAM of the bytes to send. If the DMA read them from the flash, an erase would also block the
    /// reception.
    buffer: &'static mut [u8; BUFFER],
}

impl Transmitter {
    /// Sends bytes. The call returns while the transmitter still holds the last two bytes.
    pub(super) async fn send(&mut self, bytes: &[u8]) {
        let data = UART.dr().as_ptr().cast::<u8>();
        for chunk in bytes.chunks(BUFFER) {
            let (copy, _) = self.buffer.split_at_mut(chunk.len());
            copy.copy_from_slice(chunk);
            // SAFETY: as above, for writing the register.
            unsafe { self.channel.write(self.request, copy, data, Default::default()) }.await;
        }
    }
}
