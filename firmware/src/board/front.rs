//! The controls of the board: the lines of its console, the presses of its button.

use core::sync::atomic::Ordering;

use firmware::console::Command;
use firmware::plant::{Plant, Value};
use firmware::settings::Settings;
use heapless::String;
use protocol_core::controller::BusErrorMode;
use protocol_core::device::Device;

use super::button::Presses;
use super::can::{ERROR_INTERRUPTS, OVERRUNS};
use super::console::{Answer, Answers, Lines, STATUS};
use super::link::Link;
use super::storage::{Client, Request};

/// Console and button, as the device's task has them.
pub(super) struct Front {
    lines: &'static Lines,
    answers: &'static Answers,
    presses: &'static Presses,
}

impl Front {
    /// The front of a board.
    pub(super) const fn new(lines: &'static Lines, answers: &'static Answers, presses: &'static Presses) -> Self {
        Self { lines, answers, presses }
    }

    /// Returns the plant after the last press of the button, if there was one.
    pub(super) fn pressed(&self, plant: &Plant) -> Option<Plant> {
        self.presses.try_take().map(|injection| injection.applied_to(*plant))
    }

    /// Returns the command of a line that was typed; answers a line that is none.
    pub(super) fn command(&self, plant: &Plant) -> Option<Command> {
        let line = self.lines.try_take()?;
        let command = Command::parse(&line, plant);
        if command.is_none() {
            self.answer(Answer::Usage);
        }
        command
    }

    /// Answers the line that was typed last.
    pub(super) fn answer(&self, answer: Answer) {
        self.answers.signal(answer);
    }

    /// Makes the board a new device at the next start; `None` is a device that does not exist. A refusal is answered here, the
    /// rest when the memory has answered.
    pub(super) fn become_new(&self, settings: Option<Settings>, memory: &mut Client) {
        match settings.map(|settings| memory.ask(Request::Become(settings))) {
            Some(Ok(())) => {}
            Some(Err(_)) => self.answer(Answer::Refused("the memory is busy")),
            None => self.answer(Answer::Refused("on ISOBUS a valve always has an address")),
        }
    }
}

/// Returns a line for each thing that can be told; what does not fit is left out.
pub(super) fn status(settings: &Settings, device: &dyn Device, link: &Link, plant: &Plant) -> String<STATUS> {
    let number = |number: u32| Value::Number(i32::try_from(number).unwrap_or(i32::MAX));
    let bus = match plant.senses.bus {
        BusErrorMode::ErrorActive => "error-active",
        BusErrorMode::ErrorPassive => "error-passive",
        BusErrorMode::BusOff => "bus-off",
    };
    let own = [
        ("kind", Value::Word(settings.kind.name())),
        ("node_id", device.node_id().map_or(Value::Word("none"), |node_id| Value::Number(node_id.into()))),
        ("bit_rate", number(link.bit_rate().bits_per_second())),
        ("bus", Value::Word(bus)),
        ("error_interrupts", number(ERROR_INTERRUPTS.load(Ordering::Relaxed))),
        ("overruns", number(OVERRUNS.load(Ordering::Relaxed))),
        ("dropped", number(device.frames_dropped())),
    ];
    let mut status = String::new();
    for (word, value) in own.into_iter().chain(plant.words()) {
        let mut digits = itoa::Buffer::new();
        let value = match value {
            Value::Number(number) => digits.format(number),
            Value::Word(word) => word,
        };
        for part in [word, " ", value, "\r\n"] {
            let _ = status.push_str(part);
        }
    }
    status
}
