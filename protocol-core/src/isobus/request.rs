//! Requests for parameter groups (SAE J1939-21 5.4.2 and 5.4.4; SPEC 5).
//!
//! | the group is | asked of this controller | asked of all |
//! | --- | --- | --- |
//! | one that it sends | the group | the group |
//! | an order, such as DM3 | carried out, acknowledged | carried out, silence |
//! | not supported | negative acknowledgement | silence |

use crate::frame::Frame;
use crate::wire::j1939_id::{Address, J1939Id, Pgn};
use crate::wire::request::{self, Acknowledgement, Control};

/// A request that is for this controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// The group asked for.
    pub pgn: Pgn,
    /// The controller that asks.
    pub requester: Address,
    /// The request is addressed to this controller, not to all.
    pub addressed: bool,
}

impl Request {
    /// Returns the request in a frame of this identifier, which is one of a request to this controller or to all;
    /// `None` for a malformed one.
    #[inline]
    #[must_use]
    pub fn of(id: J1939Id, frame: &Frame) -> Option<Self> {
        let addressed = id.pdu_specific() != Address::GLOBAL.get();
        Some(Self { pgn: request::parse(frame)?, requester: id.source(), addressed })
    }

    /// Returns the acknowledgement from the controller at `own`; `None` for a request to all, and for an requester without
    /// an address, whom no answer can name.
    #[must_use]
    pub fn acknowledgement(&self, control: Control, own: Address) -> Option<Frame> {
        let acknowledgement = Acknowledgement { control, requester: self.requester, pgn: self.pgn };
        (self.addressed && is_controller(self.requester)).then(|| acknowledgement.frame(own))
    }
}

/// Returns whether an address can be a controller's: 0xFE is nobody's, 0xFF everybody's.
pub(super) const fn is_controller(address: Address) -> bool {
    !matches!(address, Address::NULL | Address::GLOBAL)
}
