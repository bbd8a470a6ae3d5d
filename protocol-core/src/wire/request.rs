//! Request for a parameter group, and the acknowledgement (SAE J1939-21 5.4.2 and 5.4.4).

use super::j1939_id::{Address, J1939Id, Pgn, Priority};
use crate::frame::Frame;

/// The length of a request.
const LEN: u8 = 3;

/// Returns the requested group; `None` for a remote frame and for fewer than three bytes. Longer frames are valid,
/// because some tools pad every frame to eight bytes.
#[inline]
#[must_use]
pub const fn parse(frame: &Frame) -> Option<Pgn> {
    if frame.is_remote() || frame.len() < LEN {
        return None;
    }
    let &[low, middle, high, ..] = frame.bytes();
    Some(Pgn::from_bytes([low, middle, high]))
}

/// Encodes a request `18EAddyy: pgn` from `source` to `destination`.
#[must_use]
pub fn frame(pgn: Pgn, destination: Address, source: Address) -> Frame {
    let [low, middle, high] = pgn.to_bytes();
    let id = J1939Id::new(Priority::DEFAULT, Pgn::REQUEST, destination, source);
    Frame::with_len(id.id(), [low, middle, high, 0, 0, 0, 0, 0], LEN)
}

/// The control byte of an acknowledgement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Control {
    /// The request was executed.
    Positive = 0,
    /// The group is not supported, or its execution failed.
    Negative = 1,
    /// The group is supported, but this requester has no access.
    AccessDenied = 2,
    /// The group is supported, but cannot be answered now.
    CannotRespond = 3,
}

impl Control {
    /// All control bytes.
    pub const ALL: [Self; 4] = [Self::Positive, Self::Negative, Self::AccessDenied, Self::CannotRespond];
}

/// An acknowledgement. The frame goes to all controllers and names the requester.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Acknowledgement {
    /// The control byte.
    pub control: Control,
    /// The requester.
    pub requester: Address,
    /// The requested group.
    pub pgn: Pgn,
}

impl Acknowledgement {
    /// Decodes eight bytes; `None` for an unknown control byte.
    #[must_use]
    pub fn parse(bytes: &[u8; 8]) -> Option<Self> {
        let &[control, _, _, _, requester, low, middle, high] = bytes;
        Some(Self {
            control: Control::ALL.into_iter().find(|known| *known as u8 == control)?,
            requester: Address::new(requester),
            pgn: Pgn::from_bytes([low, middle, high]),
        })
    }

    /// Encodes the acknowledgement as eight data bytes.
    #[must_use]
    pub const fn emit(self) -> [u8; 8] {
        let [low, middle, high] = self.pgn.to_bytes();
        [self.control as u8, 0xFF, 0xFF, 0xFF, self.requester.get(), low, middle, high]
    }

    /// Encodes the frame `18E8FFyy: control FF FF FF requester pgn`.
    #[must_use]
    pub fn frame(self, source: Address) -> Frame {
        Frame::full(J1939Id::global(Priority::DEFAULT, Pgn::ACKNOWLEDGEMENT, source).id(), self.emit())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    const TOOL: Address = Address::new(0x27);
    const VALVE: Address = Address::new(0x83);

    #[test]
    fn requests_as_the_manual_prints_them() {
        for (text, pgn) in [("18EA8327: 00 EE 00", Pgn::ADDRESS_CLAIMED), ("18EA8327: CC FE 00", Pgn::DM3)] {
            assert_eq!(parse(&text.parse().unwrap()), Some(pgn));
        }
        assert_eq!(frame(Pgn::DM3, VALVE, TOOL).to_string(), "18EA8327: CC FE 00");
        assert_eq!(frame(Pgn::ADDRESS_CLAIMED, Address::GLOBAL, TOOL).to_string(), "18EAFF27: 00 EE 00");
    }

    #[test]
    fn a_padded_request_is_taken_and_a_short_one_is_none() {
        assert_eq!(parse(&"18EA8327: CB FE 00 FF FF FF FF FF".parse().unwrap()), Some(Pgn::DM2));
        for short in ["18EA8327:", "18EA8327: CB", "18EA8327: CB FE", "18EA8327: R3", "18EA8327: R8"] {
            assert_eq!(parse(&short.parse().unwrap()), None, "{short}");
        }
    }

    #[test]
    fn acknowledgements_as_the_manual_prints_them() {
        let done = Acknowledgement { control: Control::Positive, requester: TOOL, pgn: Pgn::DM3 };
        assert_eq!(done.frame(VALVE).to_string(), "18E8FF83: 00 FF FF FF 27 CC FE 00");
        let refused = Acknowledgement { control: Control::Negative, requester: TOOL, pgn: Pgn::new(0xFF_1234) };
        assert_eq!(refused.frame(VALVE).to_string(), "18E8FF83: 01 FF FF FF 27 34 12 FF");
        for control in Control::ALL {
            let answer = Acknowledgement { control, ..done };
            assert_eq!(Acknowledgement::parse(&answer.emit()), Some(answer));
        }
        assert_eq!(Acknowledgement::parse(&[4, 0xFF, 0xFF, 0xFF, 0x27, 0xCC, 0xFE, 0]), None);
    }
}
