//! Devices with slow or weak electronics: a late start, late answers, a slow cycle, an undervoltage reset.

use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant, NEVER, after, since};
use protocol_core::wire::cob_id::{Function, LSS_ANSWER, classify};
use protocol_core::wire::j1939_id::{J1939Id, Pgn};
use protocol_core::wire::uds;

/// The electronics of a device. The defaults add no delay and have no undervoltage reset (A): the manuals name neither.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Electronics {
    /// The time from power to the start of the device (A).
    pub boot: Duration,
    /// The smallest and the largest delay of an answer: SDO, LSS, UDS, and acknowledgements, DM2 and transport protocol
    /// of J1939 (A).
    pub answer: (Duration, Duration),
    /// The cycle of the application, from its start: it reads frames and inputs and sends frames only then. 0: at once
    /// (A).
    pub cycle: Duration,
    /// The supply below which a valve is off, in mV; it starts again above. `None`: never off (A).
    pub brown_out_mv: Option<u32>,
}

/// The state of a device's electronics.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    pub(super) electronics: Electronics,
    /// The start of the application.
    pub(super) started: Instant,
    /// The device is off because of its supply, and starts when that is back.
    pub(super) is_browned_out: bool,
    /// The inputs have changed since the last cycle.
    pub(super) has_new_inputs: bool,
}

impl Default for State {
    fn default() -> Self {
        Self {
            electronics: Electronics::default(),
            started: Instant::from_ticks(0),
            is_browned_out: false,
            has_new_inputs: false,
        }
    }
}

impl State {
    /// Returns the first cycle of the application at or after an instant.
    pub(super) fn cycle_from(&self, at: Instant) -> Instant {
        let cycle = self.electronics.cycle.as_ticks();
        if cycle == 0 || at == NEVER {
            return at;
        }
        let passed = since(at, self.started).as_ticks();
        after(self.started, Duration::from_ticks(passed.next_multiple_of(cycle)))
    }
}

/// Returns whether a frame of a device is an answer.
pub(super) fn is_answer(frame: &Frame) -> bool {
    match frame.id() {
        Id::Standard(id) => {
            id.as_raw() == LSS_ANSWER || classify(id).is_some_and(|(function, _)| function == Function::SdoAnswer)
        }
        Id::Extended(id) => {
            let is_j1939 =
                |id: J1939Id| [Pgn::ACKNOWLEDGEMENT, Pgn::DM2, Pgn::TP_CONNECTION, Pgn::TP_DATA].contains(&id.pgn());
            uds::parse_id(id.as_raw()).is_some() || J1939Id::of(frame).is_some_and(is_j1939)
        }
    }
}

#[cfg(test)]
#[path = "electronics_tests.rs"]
mod tests;
