//! The console on the ST-LINK's virtual COM port: 115200 baud, a line a command.

use embassy_stm32::Peri;
use embassy_stm32::interrupt::typelevel::Binding;
use embassy_stm32::usart::{BufferedInterruptHandler, BufferedUart, Config, Instance, RxPin, TxPin};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::{Read as _, Write as _};
use firmware::console::{HELP, USAGE};
use heapless::{String, Vec};
use static_cell::ConstStaticCell;

use super::attention::{Caller, call};
use super::reset;

/// The longest line.
const LINE: usize = 48;
/// The longest answer to `status`.
const STATUS: usize = 352;

/// The lines of `status`.
pub(super) type Text = Vec<u8, STATUS>;

/// A line that was typed, with room for the lines of `status`. There is one: the console's task hands it to the
/// device's task, and gets it back with the answer.
pub(super) struct Exchange {
    /// The line.
    pub(super) line: String<LINE>,
    /// The lines of `status`, for [`Answer::Status`].
    pub(super) status: Text,
}

/// A line for the device's task.
pub(super) type Lines = Signal<CriticalSectionRawMutex, &'static mut Exchange>;
/// The answers of the device's task.
pub(super) type Answers = Signal<CriticalSectionRawMutex, (&'static mut Exchange, Answer)>;

/// The answer of the device's task to a line.
pub(super) enum Answer {
    /// It is done.
    Done,
    /// It is done, and the processor is to start anew.
    Restart,
    /// How the device is: in the [`Exchange`].
    Status,
    /// All words: these of the product, and those of every kind.
    Help(&'static str),
    /// Not understood.
    Usage,
    /// Understood, and impossible, for this reason.
    Refused(&'static str),
}

const BUFFER: usize = 64;

const BACKSPACE: u8 = 0x08;
/// What many terminals send in its place.
const DELETE: u8 = 0x7F;

/// Opens the port.
pub(super) fn open<U: Instance>(
    uart: Peri<'static, U>,
    rx: Peri<'static, impl RxPin<U>>,
    tx: Peri<'static, impl TxPin<U>>,
    interrupts: impl Binding<U::Interrupt, BufferedInterruptHandler<U>> + 'static,
) -> Option<BufferedUart<'static>> {
    let rx_buffer = cortex_m::singleton!(: [u8; BUFFER] = [0; BUFFER])?;
    let tx_buffer = cortex_m::singleton!(: [u8; BUFFER] = [0; BUFFER])?;
    BufferedUart::new(uart, rx, tx, tx_buffer, rx_buffer, interrupts, Config::default()).ok()
}

#[embassy_executor::task]
pub(super) async fn run(mut uart: BufferedUart<'static>, lines: &'static Lines, answers: &'static Answers) -> ! {
    static EXCHANGE: ConstStaticCell<Exchange> =
        ConstStaticCell::new(Exchange { line: String::new(), status: Vec::new() });
    let mut exchange = EXCHANGE.take();
    let mut too_long = false;
    let mut last = 0;
    loop {
        let mut byte = [0];
        // What was garbled on its way makes a line that is not understood.
        let Ok(1) = uart.read(&mut byte).await else { continue };
        let [byte] = byte;
        match byte {
            // Of CR LF the line ends with the first.
            b'\n' if last == b'\r' => {}
            b'\r' | b'\n' => {
                let mut answer = Answer::Usage;
                if !core::mem::take(&mut too_long) {
                    lines.signal(exchange);
                    call(Caller::Front);
                    (exchange, answer) = answers.wait().await;
                }
                exchange.line.clear();
                tell(&mut uart, &answer, &exchange.status).await;
                if let Answer::Restart = answer {
                    reset::power_cycle();
                }
            }
            BACKSPACE | DELETE => drop(exchange.line.pop()),
            byte => too_long |= exchange.line.push(char::from(byte)).is_err(),
        }
        last = byte;
    }
}

async fn tell(uart: &mut BufferedUart<'static>, answer: &Answer, status: &Text) {
    let (first, second, last): (&[u8], &[u8], &str) = match answer {
        Answer::Done | Answer::Restart => (b"", b"", "ok"),
        Answer::Status => (status, b"", "ok"),
        Answer::Help(own) => (own.as_bytes(), HELP.as_bytes(), "ok"),
        Answer::Usage => (b"", b"", USAGE),
        Answer::Refused(why) => (b"", b"", why),
    };
    for part in [first, second, last.as_bytes(), b"\r\n"] {
        // The driver takes all of it or nothing, no more than it has room for, and never wakes one who waits for room.
        for chunk in part.chunks(BUFFER) {
            let _ = uart.write(chunk).await;
            let _ = uart.flush().await;
        }
    }
}
