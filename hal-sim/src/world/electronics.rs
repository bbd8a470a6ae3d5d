//! Devices with slow or weak electronics: a delayed start, delayed answers, a slow cycle, an undervoltage reset.

use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant, NEVER, after, since};
use protocol_core::wire::cob_id::{Function, LSS_ANSWER, classify};
use protocol_core::wire::j1939_id::{Address, J1939Id, Pgn};
use protocol_core::wire::uds;

use super::Change;

/// The electronics of a device. The defaults add no delay and have no undervoltage reset (A): the manuals name neither.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Electronics {
    /// The time from power-on to the start of the application (A).
    pub boot: Duration,
    /// The minimum and maximum delay of an answer (A). Answers are SDO, LSS and UDS responses, J1939 acknowledgements,
    /// aborts of the transport protocol, and a DM2 in one frame.
    pub answer: (Duration, Duration),
    /// The cycle time of the application, which reads frames and inputs and sends frames only once per cycle (A). Faults
    /// and lever of the spool are such inputs. With 0, the application reacts immediately.
    pub cycle: Duration,
    /// The supply voltage in mV below which a valve is off (A). The valve restarts when the supply reaches this
    /// voltage. `None` if the valve never switches off.
    pub brown_out_mv: Option<u32>,
}

impl Electronics {
    /// Applies a plant change; a word that does not belong to the electronics has no effect.
    pub(super) fn change(&mut self, plant: Change) {
        let millis = |ms: u16| Duration::from_millis(ms.into());
        match plant {
            Change::BootMs(ms) => self.boot = millis(ms),
            Change::AnswerMs(from, to) => self.answer = (millis(from), millis(to)),
            Change::CycleMs(ms) => self.cycle = millis(ms),
            Change::BrownOutMv(limit) => self.brown_out_mv = limit,
            _ => {}
        }
    }

    /// Returns the delays as plant changes.
    pub(super) fn words(&self) -> [Change; 3] {
        let millis = |time: Duration| u16::try_from(time.as_millis()).unwrap_or(u16::MAX);
        let (from, to) = self.answer;
        [
            Change::BootMs(millis(self.boot)),
            Change::AnswerMs(millis(from), millis(to)),
            Change::CycleMs(millis(self.cycle)),
        ]
    }
}

/// The state of a device's electronics.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    pub(super) settings: Electronics,
    /// The time at which the application started.
    pub(super) started: Instant,
    /// True if the device is off because of undervoltage and will start when the supply recovers.
    pub(super) is_browned_out: bool,
    /// True if the inputs have changed since the last cycle.
    pub(super) has_new_inputs: bool,
}

impl Default for State {
    fn default() -> Self {
        Self {
            settings: Electronics::default(),
            started: Instant::from_ticks(0),
            is_browned_out: false,
            has_new_inputs: false,
        }
    }
}

impl State {
    /// Returns whether the application has a slow cycle.
    pub(super) fn is_slow(&self) -> bool {
        self.settings.cycle.as_ticks() > 0
    }

    /// Returns the start of the first application cycle at or after an instant.
    pub(super) fn cycle_from(&self, at: Instant) -> Instant {
        let cycle = self.settings.cycle.as_ticks();
        if cycle == 0 || at == NEVER {
            return at;
        }
        let passed = since(at, self.started).as_ticks();
        after(self.started, Duration::from_ticks(passed.next_multiple_of(cycle)))
    }
}

/// Returns whether a frame from a device is an answer, as defined by [`Electronics::answer`].
pub(super) fn is_answer(frame: &Frame) -> bool {
    match frame.id() {
        Id::Standard(id) => {
            id.as_raw() == LSS_ANSWER || classify(id).is_some_and(|(function, _)| function == Function::SdoAnswer)
        }
        Id::Extended(id) => {
            // A broadcast in several packets has its own times.
            let is_j1939 = |id: J1939Id| match id.pgn() {
                Pgn::TP_CONNECTION => id.destination() != Address::GLOBAL,
                pgn => [Pgn::ACKNOWLEDGEMENT, Pgn::DM2].contains(&pgn),
            };
            uds::parse_id(id.as_raw()).is_some() || J1939Id::of(frame).is_some_and(is_j1939)
        }
    }
}

#[cfg(test)]
#[path = "electronics_tests.rs"]
mod tests;
