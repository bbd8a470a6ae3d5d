//! The highlight of a frame, which determines its colour, and the cyclic frames that a trace may omit.

use protocol_core::frame::{Frame, Id};
use protocol_core::wire::cob_id::{Function, LSS_ANSWER, LSS_REQUEST, NMT, classify};
use protocol_core::wire::dm;
use protocol_core::wire::emcy::{Emcy, NO_ERROR};
use protocol_core::wire::j1939_id::{J1939Id, Pgn};
use protocol_core::wire::uds::parse_id;

/// The highlight of a frame, which determines its colour in a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// No highlight.
    Plain,
    /// A fault: an EMCY with an error, or a DM1 with a trouble code.
    Fault,
    /// A client uses a device's identifier.
    Impersonation,
    /// The meaning of the frame is unknown.
    Unknown,
}

/// Returns whether a frame reports a fault.
pub(super) fn tells_fault(frame: &Frame) -> bool {
    match frame.id() {
        Id::Standard(id) if matches!(classify(id), Some((Function::Emcy, _))) => {
            frame.eight().is_some_and(|bytes| Emcy::parse(bytes).code != NO_ERROR)
        }
        Id::Extended(id) if J1939Id::from_raw(id.as_raw()).pgn() == Pgn::DM1 => {
            dm::parse(frame.data()).is_some_and(|(_, mut troubles)| troubles.next().is_some())
        }
        _ => false,
    }
}

/// Returns whether a frame is a cyclic message. Requests, responses and changes of state are not cyclic.
#[must_use]
pub fn is_cyclic(frame: &Frame) -> bool {
    match frame.id() {
        Id::Standard(id) => match classify(id) {
            Some((function, _)) => matches!(function, Function::Tpdo1 | Function::Rpdo1 | Function::Heartbeat),
            None => !matches!(id.as_raw(), NMT | LSS_ANSWER | LSS_REQUEST),
        },
        Id::Extended(id) => {
            let pgn = J1939Id::from_raw(id.as_raw()).pgn();
            let once = [
                Pgn::ADDRESS_CLAIMED,
                Pgn::REQUEST,
                Pgn::ACKNOWLEDGEMENT,
                Pgn::TP_CONNECTION,
                Pgn::TP_DATA,
                Pgn::DM2,
                Pgn::DM3,
                Pgn::COMMANDED_ADDRESS,
            ];
            parse_id(id.as_raw()).is_none() && !once.contains(&pgn)
        }
    }
}
