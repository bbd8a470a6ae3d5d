//! Requests for parameter groups (SAE J1939-21 5.4.2 and 5.4.4; SPEC 5).
//!
//! | requested group | addressed request | request to all |
//! | --- | --- | --- |
//! | sent by this controller | the group | the group |
//! | a command such as DM3 | executed and acknowledged | executed, no answer |
//! | not supported | negative acknowledgement | no answer |

use crate::frame::Frame;
use crate::wire::j1939_id::{Address, J1939Id, Pgn};
use crate::wire::request::{self, Acknowledgement, Control};

/// A request to this controller or to all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// The requested group.
    pub pgn: Pgn,
    /// The requesting controller.
    pub requester: Address,
    /// True for a request to this controller, false for a request to all.
    pub addressed: bool,
}

impl Request {
    /// Decodes a request to this controller or to all. `id` is the identifier of the frame. Returns `None` for a
    /// malformed request.
    #[inline]
    #[must_use]
    pub fn of(id: J1939Id, frame: &Frame) -> Option<Self> {
        let addressed = id.pdu_specific() != Address::GLOBAL.get();
        Some(Self { pgn: request::parse(frame)?, requester: id.source(), addressed })
    }

    /// Encodes the acknowledgement from the controller `own`. Returns `None` for a request to all, and for a requester
    /// without an address.
    #[must_use]
    pub fn acknowledgement(&self, control: Control, own: Address) -> Option<Frame> {
        let acknowledgement = Acknowledgement { control, requester: self.requester, pgn: self.pgn };
        (self.addressed && is_controller(self.requester)).then(|| acknowledgement.frame(own))
    }
}

/// Returns whether a controller can have this address. No controller has the null address or the global address.
pub(super) const fn is_controller(address: Address) -> bool {
    !matches!(address, Address::NULL | Address::GLOBAL)
}
