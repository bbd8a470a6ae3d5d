//! The console on USART3, the ST-LINK's virtual COM port: 115200 baud, a line a change.

use embassy_stm32::peripherals::{PD8, PD9, USART3};
use embassy_stm32::usart::{BufferedInterruptHandler, BufferedUart, Config};
use embassy_stm32::{Peri, bind_interrupts};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embedded_io_async::{Read as _, Write as _};
use firmware::console::USAGE;
use heapless::String;

/// The longest line.
pub(super) const LINE: usize = 48;

/// Lines for the device's task.
pub(super) static LINES: Channel<CriticalSectionRawMutex, String<LINE>, 4> = Channel::new();

/// Whether it understood one.
pub(super) static UNDERSTOOD: Channel<CriticalSectionRawMutex, bool, 4> = Channel::new();

bind_interrupts!(struct Interrupts {
    USART3 => BufferedInterruptHandler<USART3>;
});

const BUFFER: usize = 64;

/// Opens the port.
pub(super) fn open(
    uart: Peri<'static, USART3>,
    rx: Peri<'static, PD9>,
    tx: Peri<'static, PD8>,
) -> Option<BufferedUart<'static>> {
    let rx_buffer = cortex_m::singleton!(: [u8; BUFFER] = [0; BUFFER])?;
    let tx_buffer = cortex_m::singleton!(: [u8; BUFFER] = [0; BUFFER])?;
    BufferedUart::new(uart, rx, tx, tx_buffer, rx_buffer, Interrupts, Config::default()).ok()
}

#[embassy_executor::task]
pub(super) async fn run(uart: Option<BufferedUart<'static>>) {
    let Some(mut uart) = uart else { return };
    let mut line = String::new();
    let mut too_long = false;
    loop {
        let mut byte = [0];
        // What was garbled on its way makes a line that is not understood.
        let Ok(1) = uart.read(&mut byte).await else { continue };
        match byte[0] {
            b'\r' => {}
            b'\n' => {
                let understood = !too_long && {
                    LINES.send(core::mem::take(&mut line)).await;
                    super::can::ATTENTION.signal(());
                    UNDERSTOOD.receive().await
                };
                line.clear();
                too_long = false;
                let answer = if understood { "ok" } else { USAGE };
                for part in [answer, "\r\n"] {
                    let _ = uart.write_all(part.as_bytes()).await;
                }
            }
            byte => too_long |= line.push(char::from(byte)).is_err(),
        }
    }
}
