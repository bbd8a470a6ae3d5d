//! The serial port of the console: 115200 baud, by DMA in both directions, so that characters arrive while the processor
//! stands in an erase.
//!
//! The drivers of embassy-stm32 0.6 do not tell all that was damaged. `BufferedUart` drops the error flags of the
//! receiver. `RingBufferedUartRx` goes on after an error with positions of the time before, and takes two rounds of its
//! ring during an erase for one. Here the DMA fills a buffer once and stops: what comes after that is an overrun, which
//! the receiver tells.

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

/// Bytes that the DMA moves at a time: a line and the beginning of the next one.
pub(super) const BUFFER: usize = 64;

/// The line became idle after a character, or a character arrived damaged.
static ARRIVED: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// Characters came damaged or were lost.
static DAMAGED: AtomicBool = AtomicBool::new(false);

/// Handles the interrupt of the UART. It must preempt the console's task, which asks for damage when it has taken the
/// characters.
pub(super) fn on_interrupt() {
    let status = UART.sr().read();
    // The second half of the sequence that clears the flags. It takes a character that the DMA has not.
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
    /// Keeps the pins and the clock of the UART.
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
        // Without an ST-LINK nobody drives the pin.
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

/// The receiving half.
pub(super) struct Receiver {
    channel: Channel<'static>,
    request: Request,
}

impl Receiver {
    /// Starts to fill a buffer.
    pub(super) fn fill<'a>(&'a mut self, buffer: &'a mut [u8; BUFFER]) -> Transfer<'a> {
        let data = UART.dr().as_ptr().cast::<u8>();
        // SAFETY: the data register is read by nobody else but the interrupt's handler, which counts what it takes as
        // damage. The transfer ends before the borrow of the buffer does: nobody in this crate forgets one.
        unsafe { self.channel.read(self.request, data, buffer, Default::default()) }
    }
}

/// Waits until characters have arrived, and stops the transfer. Returns their number, and whether some were damaged or
/// lost. A loss that is found before the next characters arrive is reported with those.
pub(super) async fn arrived(mut transfer: Transfer<'_>) -> (usize, bool) {
    select(&mut transfer, ARRIVED.wait()).await;
    transfer.request_pause();
    while transfer.is_running() {}
    let left = transfer.get_remaining_transfers() as usize;
    // Until the next transfer one character waits in the receiver.
    drop(transfer);
    let count = BUFFER - left;
    (count, count > 0 && DAMAGED.swap(false, Ordering::Relaxed))
}

/// The sending half.
pub(super) struct Transmitter {
    channel: Channel<'static>,
    request: Request,
    /// A copy of what is sent. From the flash itself the DMA could not read during an erase, and would not receive either.
    buffer: &'static mut [u8; BUFFER],
}

impl Transmitter {
    /// Sends bytes, until the last two are in the transmitter.
    pub(super) async fn send(&mut self, bytes: &[u8]) {
        let data = UART.dr().as_ptr().cast::<u8>();
        for chunk in bytes.chunks(BUFFER) {
            let (copy, _) = self.buffer.split_at_mut(chunk.len());
            copy.copy_from_slice(chunk);
            // SAFETY: as above, for the register that is written here.
            unsafe { self.channel.write(self.request, copy, data, Default::default()) }.await;
        }
    }
}
