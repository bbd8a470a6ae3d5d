//! The highlight of a frame, which determines its colour, and the cyclic frames that a trace may omit.

use protocol_core::frame::{Frame, Id};
use protocol_core::wire::cob_id::{Function, LSS_ANSWER, LSS_REQUEST, NMT, classify};
use protocol_core::wire::dm;
use protocol_core::wire::emcy::{Emcy, NO_ERROR};
use protocol_core::wire::j1939_id::{J1939Id, Pgn};
use protocol_core::wire::uds::parse_id;

use super::{Context, uds};

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

pub(super) fn mark(frame: &Frame, context: &Context<'_>) -> Mark {
    if context.sender.is_none() && source(frame).is_some_and(|id| context.impersonated(id).is_some()) {
        Mark::Impersonation
    } else if tells_fault(frame) {
        Mark::Fault
    } else {
        Mark::Plain
    }
}

/// Returns the source in a frame's identifier: a node ID or an address.
fn source(frame: &Frame) -> Option<u8> {
    // A remote frame has the identifier of the requested frame.
    if frame.is_remote() {
        return None;
    }
    match frame.id() {
        Id::Standard(id) => classify(id).filter(|(function, _)| function.is_from_node()).map(|(_, node)| node.get()),
        Id::Extended(id) => match parse_id(id.as_raw()) {
            Some((source, _)) => uds::device(source),
            None => Some(J1939Id::from_raw(id.as_raw()).source().get()),
        },
    }
}

fn tells_fault(frame: &Frame) -> bool {
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
