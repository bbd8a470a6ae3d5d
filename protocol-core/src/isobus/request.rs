//! Requests for parameter groups (SAE J1939-21 5.4.2 and 5.4.4; SPEC 5).
//!
//! | the group is | asked of this controller | asked of all |
//! | --- | --- | --- |
//! | one that it sends | the group | the group |
//! | an order, such as DM3 | carried out, acknowledged | carried out, silence |
//! | not supported | negative acknowledgement | silence |

use crate::frame::Frame;
use crate::wire::j1939_id::{Address, Format, J1939Id, Pgn};
use crate::wire::request::{self, Acknowledgement, Control};

/// A request that is for this controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// What is asked for.
    pub pgn: Pgn,
    /// Who asks.
    pub asker: Address,
    /// Whether this controller is asked, not all.
    pub addressed: bool,
}

impl Request {
    /// The request in a frame of this identifier, when it is for the controller at `own` or for all.
    #[inline]
    #[must_use]
    pub fn of(id: J1939Id, frame: &Frame, own: Option<Address>) -> Option<Self> {
        if id.format() != Format::REQUEST {
            return None;
        }
        let destination = id.destination();
        let addressed = destination != Address::GLOBAL;
        if addressed && own != Some(destination) {
            return None;
        }
        Some(Self { pgn: request::parse(frame)?, asker: id.source(), addressed })
    }

    /// What tells the asker that its order was carried out; nothing for one to all.
    #[must_use]
    pub fn acknowledge(&self, own: Address) -> Option<Frame> {
        self.answer(Control::Positive, own)
    }

    /// What tells the asker that the group is not supported; nothing for a request to all.
    #[must_use]
    pub fn refuse(&self, own: Address) -> Option<Frame> {
        self.answer(Control::Negative, own)
    }

    fn answer(&self, control: Control, own: Address) -> Option<Frame> {
        let acknowledgement = Acknowledgement { control, asker: self.asker, pgn: self.pgn };
        self.addressed.then(|| acknowledgement.frame(own))
    }
}
