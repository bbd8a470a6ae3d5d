//! The local controls of the board: console and button.

use core::sync::atomic::Ordering;

use embassy_time::Instant;
use firmware::console::Command;
use firmware::plant::{Injection, Plant, Value};
use firmware::settings::Settings;
use protocol_core::controller::BusErrorMode;
use protocol_core::device::Device;
use protocol_core::wire::decimal::decimal;

use super::button::Presses;
use super::can::{ERROR_INTERRUPTS, OVERRUNS};
use super::console::{Answer, Answers, Exchange, Lines, Text};
use super::link::Link;

/// The console and the button, for the device task.
pub(super) struct LocalControls {
    lines: &'static Lines,
    answers: &'static Answers,
    presses: &'static Presses,
    /// The exchange of a line that has no answer yet.
    exchange: Option<&'static mut Exchange>,
    /// The fault that the last press injected.
    injection: Injection,
}

impl LocalControls {
    pub(super) const fn new(lines: &'static Lines, answers: &'static Answers, presses: &'static Presses) -> Self {
        Self { lines, answers, presses, exchange: None, injection: Injection::None }
    }

    /// Returns the plant after a press of the button; `None` without a press.
    pub(super) fn pressed(&mut self, plant: &Plant) -> Option<Plant> {
        self.presses.try_take()?;
        self.injection = self.injection.next(&plant.inputs.product);
        Some(self.injection.applied_to(*plant))
    }

    /// Takes a line from the console and returns its command; `None` without a line, or for a line that cannot be
    /// parsed, which is answered at once.
    pub(super) fn command(&mut self) -> Option<Command> {
        let exchange = self.exchange.insert(self.lines.try_take()?);
        let command = Command::parse(exchange.line.text());
        if command.is_none() {
            self.answer(Answer::Usage);
        }
        command
    }

    /// Answers the last line.
    pub(super) fn answer(&mut self, answer: Answer) {
        if let Some(exchange) = self.exchange.take() {
            self.answers.signal((exchange, answer));
        }
    }

    /// Writes the status of the device as the answer to the last line, one value per line. Values that do not fit are
    /// left out.
    pub(super) fn tell_status(&mut self, settings: &Settings, device: &dyn Device, link: &Link, plant: &Plant) {
        let Some(Exchange { status, .. }) = &mut self.exchange else { return };
        let bus = match plant.inputs.bus {
            BusErrorMode::ErrorActive => "error-active",
            BusErrorMode::ErrorPassive => "error-passive",
            BusErrorMode::BusOff => "bus-off",
        };
        let own = [
            ("kind", Value::Word(settings.kind.name())),
            ("node_id", device.node_id().map_or(Value::Word("none"), |node_id| Value::Natural(node_id.into()))),
            ("bit_rate", Value::Natural(link.bit_rate().bits_per_second())),
            ("bus", Value::Word(bus)),
            ("error_interrupts", Value::Natural(ERROR_INTERRUPTS.load(Ordering::Relaxed))),
            ("overruns", Value::Natural(OVERRUNS.load(Ordering::Relaxed))),
            ("dropped", Value::Natural(device.frames_dropped())),
        ];
        status.clear();
        own.into_iter().for_each(|line| tell(line, status));
        plant.words(Instant::now()).for_each(|change| tell(change.text(), status));
    }
}

fn tell((word, value): (&str, Value), status: &mut Text) {
    let digits;
    let (sign, value): (&[u8], &[u8]) = match value {
        Value::Natural(number) => {
            digits = decimal(number);
            (b"", &digits)
        }
        Value::Integer(number) => {
            digits = decimal(number.unsigned_abs());
            (if number < 0 { b"-" } else { b"" }, &digits)
        }
        Value::Word(word) => (b"", word.as_bytes()),
        // No word of a board has ranges.
        Value::Range(..) => (b"", b""),
    };
    for part in [word.as_bytes(), b" ", sign, value, b"\r\n"] {
        let _ = status.extend_from_slice(part);
    }
}
