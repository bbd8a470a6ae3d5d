//! The console on the virtual COM port of the ST-LINK, with one command per line.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Timer};
use firmware::console::{DAMAGED, HELP, USAGE, tell_help};
use firmware::line::{Arrival, Line};
use firmware::plant::Product;
use heapless::Vec;
use static_cell::ConstStaticCell;

use super::reset;
use super::serial::{BUFFER, Port, Transmitter, arrived};
use super::wake_up::{Event, notify};

/// The transmission time of two characters, rounded up.
const LAST_TWO: Duration = Duration::from_millis(1);
/// The maximum length of an answer to `status`.
const STATUS: usize = 352;

/// The lines of `status`, or one line of `help`.
pub(super) type Text = Vec<u8, STATUS>;

/// A received line, with a buffer for the lines of `status`. The console task owns the only exchange. It passes the
/// exchange with the line to the device task, which returns the exchange with the answer.
pub(super) struct Exchange {
    /// The received line.
    pub(super) line: Line,
    /// The lines of `status`, for [`Answer::Status`].
    pub(super) status: Text,
}

/// The signal that passes a line to the device task.
pub(super) type Lines = Signal<CriticalSectionRawMutex, &'static mut Exchange>;
/// The signal that returns the answer from the device task.
pub(super) type Answers = Signal<CriticalSectionRawMutex, (&'static mut Exchange, Answer)>;

/// The answer to a line.
pub(super) enum Answer {
    /// The command was executed.
    Done,
    /// The command was executed, and the processor must restart.
    Restart,
    /// The command was `status`. The lines are in the [`Exchange`].
    Status,
    /// The command was `help`. The answer includes the plant words of this product.
    Help(Product),
    /// The line is invalid.
    Usage,
    /// Characters of the line were lost or altered.
    Damaged,
    /// The command was refused for this reason.
    Refused(&'static str),
}

#[embassy_executor::task]
pub(super) async fn run(mut port: Port, lines: &'static Lines, answers: &'static Answers) -> ! {
    static EXCHANGE: ConstStaticCell<Exchange> =
        ConstStaticCell::new(Exchange { line: Line::new(), status: Vec::new() });
    static BUFFERS: ConstStaticCell<[[u8; BUFFER]; 2]> = ConstStaticCell::new([[0; BUFFER]; 2]);
    let mut exchange = EXCHANGE.take();
    let [mut taken, mut filled] = BUFFERS.take().each_mut();
    let mut transfer = port.receiver.fill(filled);
    loop {
        let (count, is_damaged) = arrived(transfer).await;
        core::mem::swap(&mut taken, &mut filled);
        transfer = port.receiver.fill(filled);
        for character in &taken[..count] {
            let answer = match exchange.line.push(*character, is_damaged) {
                None => continue,
                Some(Arrival::TooLong) => Answer::Usage,
                Some(Arrival::Damaged) => Answer::Damaged,
                Some(Arrival::Whole) => {
                    lines.signal(exchange);
                    notify(Event::Controls);
                    let answer;
                    (exchange, answer) = answers.wait().await;
                    answer
                }
            };
            tell(&mut port.transmitter, &answer, &mut exchange.status).await;
            if let Answer::Restart = answer {
                Timer::after(LAST_TWO).await;
                reset::power_cycle();
            }
        }
    }
}

async fn tell(transmitter: &mut Transmitter, answer: &Answer, text: &mut Text) {
    if let Answer::Help(product) = answer {
        for word in product.words_of_board() {
            text.clear();
            tell_help(word, &mut |part| {
                let _ = text.extend_from_slice(part.as_bytes());
            });
            transmitter.send(text).await;
        }
    }
    let (first, last): (&[u8], &str) = match answer {
        Answer::Done | Answer::Restart => (b"", "ok"),
        Answer::Status => (text, "ok"),
        Answer::Help(_) => (HELP.as_bytes(), "ok"),
        Answer::Usage => (b"", USAGE),
        Answer::Damaged => (b"", DAMAGED),
        Answer::Refused(why) => (b"", why),
    };
    for part in [first, last.as_bytes(), b"\r\n"] {
        transmitter.send(part).await;
    }
}
