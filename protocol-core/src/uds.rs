//! The UDS lite server of the CANopen and ISOBUS valves (SPEC 7). The product defines all identifiers except the node
//! ID.

use heapless::Vec;

use crate::frame::{Frame, Id, extended};
use crate::wire::uds::{Address, Answer, Identifier, NegativeCode, POSITIVE, READ, WRITE, id, single_frame};

/// The identifier of the node ID. No other identifier is writable.
pub const NODE_ID: Identifier = 0x1001;

/// The CAN identifier of every answer to a write of the node ID (R). It does not depend on the node: the manual says so
/// three times, although its own table of identifiers disagrees.
pub const NODE_ID_ANSWER: u32 = 0x1BC4_08F1;

/// The maximum number of data bytes for an identifier, limited by the single frame.
pub const DATA_MAX: usize = 4;

/// The identifier data that the product supplies.
pub trait Identifiers {
    /// Returns the data of an identifier; `None` if the identifier does not exist.
    fn read(&self, identifier: Identifier) -> Option<Vec<u8, DATA_MAX>>;

    /// Returns whether the product permits a node ID or address.
    fn accepts_node_id(&self, node_id: u8) -> bool;

    /// Returns whether a write of the node ID is in progress.
    fn is_busy(&self) -> bool;
}

/// The reaction to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reaction {
    /// No answer.
    Nothing,
    /// Send this answer.
    Answer(Frame),
    /// Store this node ID, then send [`node_id_written`].
    StoreNodeId(u8),
}

/// Handles a request from the address `source` to the address `own`.
#[must_use]
pub fn serve(own: Address, source: Address, data: &[u8], identifiers: &impl Identifiers) -> Reaction {
    let Some((request, length_agrees)) = single_frame(data) else { return Reaction::Nothing };
    let service = request.first().copied().unwrap_or(0);
    if service & POSITIVE != 0 {
        // Two devices would otherwise answer each other's answers for ever.
        return Reaction::Nothing;
    }
    let answer_id = match request {
        [WRITE, high, low, ..] if Identifier::from_be_bytes([*high, *low]) == NODE_ID => node_id_answer(),
        _ => id(own, source).into(),
    };
    let result = if length_agrees { act(request, identifiers) } else { Err(NegativeCode::IncorrectLength) };
    match result {
        Ok(Action::Read(identifier, data)) => Reaction::Answer(Answer::Read(identifier, &data).frame(answer_id)),
        Ok(Action::StoreNodeId(node_id)) => Reaction::StoreNodeId(node_id),
        Err(code) => Reaction::Answer(Answer::Negative(service, code).frame(answer_id)),
    }
}

/// Encodes the answer to a write of the node ID. `stored` is the result of the write.
#[must_use]
pub fn node_id_written(stored: bool) -> Frame {
    let answer =
        if stored { Answer::Written(NODE_ID) } else { Answer::Negative(WRITE, NegativeCode::ProgrammingFailure) };
    answer.frame(node_id_answer())
}

enum Action {
    Read(Identifier, Vec<u8, DATA_MAX>),
    StoreNodeId(u8),
}

/// Checks a request in the order of SPEC 7: service, length, identifier, factory data, range, memory.
fn act(request: &[u8], identifiers: &impl Identifiers) -> Result<Action, NegativeCode> {
    match request {
        &[READ, high, low] => {
            let identifier = Identifier::from_be_bytes([high, low]);
            let data = identifiers.read(identifier).ok_or(NegativeCode::RequestOutOfRange)?;
            Ok(Action::Read(identifier, data))
        }
        &[WRITE, high, low, ref data @ ..] => {
            let identifier = Identifier::from_be_bytes([high, low]);
            match data {
                &[node_id] if identifier == NODE_ID => {
                    if !identifiers.accepts_node_id(node_id) {
                        Err(NegativeCode::RequestOutOfRange)
                    } else if identifiers.is_busy() {
                        Err(NegativeCode::ConditionsNotCorrect)
                    } else {
                        Ok(Action::StoreNodeId(node_id))
                    }
                }
                _ if identifier == NODE_ID => Err(NegativeCode::IncorrectLength),
                _ if identifiers.read(identifier).is_none() => Err(NegativeCode::RequestOutOfRange),
                // (A) The answer does not depend on the state of the device, because no service unlocks the factory
                // data.
                _ => Err(NegativeCode::SecurityAccessDenied),
            }
        }
        [READ | WRITE, ..] => Err(NegativeCode::IncorrectLength),
        _ => Err(NegativeCode::ServiceNotSupported),
    }
}

const fn node_id_answer() -> Id {
    Id::Extended(extended(NODE_ID_ANSWER))
}
