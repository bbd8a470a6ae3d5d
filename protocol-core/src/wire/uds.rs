//! UDS lite: single frames with 29-bit identifiers (SPEC 7). ISO 14229-1 defines the services, ISO 15765-2 the first
//! byte.

use crate::frame::{ExtendedId, Frame, Id, extended, key};

/// A UDS address: three bits for the net and eight bits for the node. An identifier carries a source and a destination
/// address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address(u16);

impl Address {
    /// Creates an address from the low eleven bits of `raw`.
    #[must_use]
    pub const fn new(raw: u16) -> Self {
        Self(raw & 0x7FF)
    }

    /// Creates the address of a node on net 0.
    #[must_use]
    pub const fn node(node: u8) -> Self {
        Self(node as u16)
    }

    /// Returns the eleven bits.
    #[must_use]
    pub const fn raw(self) -> u16 {
        self.0
    }
}

/// The fixed bits of an identifier: priority 0b110, extended data page 1, data page 1, type of service 0b11.
const BASE: u32 = 0x1BC0_0000;

/// Returns the identifier of a message from `source` to `destination` (R: the manual prints one identifier for both
/// directions, but its bit table distinguishes them).
#[must_use]
pub const fn id(source: Address, destination: Address) -> ExtendedId {
    extended(BASE | (source.0 as u32) << 11 | destination.0 as u32)
}

/// Returns the source and destination of a message; `None` if the identifier is not a UDS identifier.
#[inline]
#[must_use]
pub const fn parse_id(raw: u32) -> Option<(Address, Address)> {
    if raw & !0x003F_FFFF == BASE { Some((Address::new((raw >> 11) as u16), Address::new(raw as u16))) } else { None }
}

/// The mask of a [key] that ignores the source.
pub const ANY_SOURCE: u32 = !(0x7FF << 11);

/// Returns the [key] of messages to `destination`, with source 0.
#[must_use]
pub fn key_to(destination: Address) -> u32 {
    key(id(Address::new(0), destination).into()) & ANY_SOURCE
}

/// Service 0x22, read data by identifier.
pub const READ: u8 = 0x22;
/// Service 0x2E, write data by identifier.
pub const WRITE: u8 = 0x2E;
/// The bit that a positive answer adds to the service of its request.
pub const POSITIVE: u8 = 0x40;
/// The service of a negative answer.
pub const NEGATIVE: u8 = 0x7F;

/// A data identifier, big-endian on the bus (R: one example in the manual reverses the bytes).
pub type Identifier = u16;

/// The reason for a refusal: a negative response code of ISO 14229-1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum NegativeCode {
    /// The service is unknown.
    ServiceNotSupported = 0x11,
    /// The length is wrong.
    IncorrectLength = 0x13,
    /// The service cannot be executed now.
    ConditionsNotCorrect = 0x22,
    /// The identifier is unknown, or the value is out of range.
    RequestOutOfRange = 0x31,
    /// The identifier refers to factory data, which cannot be written.
    SecurityAccessDenied = 0x33,
    /// Writing the memory failed.
    ProgrammingFailure = 0x72,
}

impl NegativeCode {
    /// All codes.
    pub const ALL: [Self; 6] = [
        Self::ServiceNotSupported,
        Self::IncorrectLength,
        Self::ConditionsNotCorrect,
        Self::RequestOutOfRange,
        Self::SecurityAccessDenied,
        Self::ProgrammingFailure,
    ];

    /// Returns the meaning of the code as text.
    #[must_use]
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::ServiceNotSupported => "service not supported",
            Self::IncorrectLength => "incorrect length",
            Self::ConditionsNotCorrect => "conditions not correct",
            Self::RequestOutOfRange => "request out of range",
            Self::SecurityAccessDenied => "security access denied",
            Self::ProgrammingFailure => "programming failure",
        }
    }
}

/// Returns the bytes of a single frame after its length byte, and whether their number equals the length byte. The
/// first byte is the service.
///
/// Returns `None` for an empty frame, and for a length byte outside 1–7.
#[must_use]
pub fn single_frame(data: &[u8]) -> Option<(&[u8], bool)> {
    let (&len, bytes) = data.split_first()?;
    matches!(len, 1..=7).then_some((bytes, bytes.len() == usize::from(len)))
}

/// An answer from a UDS server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer<'a> {
    /// `n 62 hi lo data…`, up to four bytes of data.
    Read(Identifier, &'a [u8]),
    /// `03 6E hi lo` (R: one table in the manual has length byte 05).
    Written(Identifier),
    /// `03 7F sid code`.
    Negative(u8, NegativeCode),
}

impl Answer<'_> {
    /// Encodes the answer as a frame with the identifier `id`; data beyond four bytes are dropped.
    #[must_use]
    pub fn frame(self, id: Id) -> Frame {
        let (head, data): (_, &[u8]) = match self {
            Self::Read(identifier, data) => ((READ | POSITIVE, identifier.to_be_bytes()), data),
            Self::Written(identifier) => ((WRITE | POSITIVE, identifier.to_be_bytes()), &[]),
            Self::Negative(service, code) => ((NEGATIVE, [service, code as u8]), &[]),
        };
        let (first, [second, third]) = head;
        let mut bytes = [0, first, second, third, 0, 0, 0, 0];
        let [len, _, _, _, room @ ..] = &mut bytes;
        *len = 3;
        for (byte, value) in room.iter_mut().zip(data) {
            *byte = *value;
            *len = len.wrapping_add(1);
        }
        let len = len.wrapping_add(1);
        Frame::with_len(id, bytes, len)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    const TOOL: Address = Address::node(0xF1);
    const NODE: Address = Address::node(0x05);

    #[test]
    fn identifiers_from_the_bit_table() {
        assert_eq!(id(TOOL, NODE).as_raw(), 0x1BC7_8805);
        assert_eq!(id(NODE, TOOL).as_raw(), 0x1BC0_28F1);
        assert_eq!(parse_id(0x1BC7_8805), Some((TOOL, NODE)));
        assert_eq!(parse_id(0x18EA_FFF1), None);
        assert_eq!(parse_id(0x1B87_8805), None);
    }

    #[test]
    fn answers_as_the_manual_prints_them() {
        let id = Id::from(id(Address::node(0x81), TOOL));
        assert_eq!(Answer::Written(0x1001).frame(id).to_string(), "1BC408F1: 03 6E 10 01");
        let negative = Answer::Negative(WRITE, NegativeCode::RequestOutOfRange).frame(id);
        assert_eq!(negative.to_string(), "1BC408F1: 03 7F 2E 31");
        assert_eq!(Answer::Read(0xF010, &[0xA5]).frame(id).to_string(), "1BC408F1: 04 62 F0 10 A5");
        assert_eq!(Answer::Read(0xF193, b"A1  ").frame(id).to_string(), "1BC408F1: 07 62 F1 93 41 31 20 20");
    }

    #[test]
    fn single_frames() {
        assert_eq!(single_frame(&[]), None);
        assert_eq!(single_frame(&[0, 1]), None);
        assert_eq!(single_frame(&[8, 1]), None);
        assert_eq!(single_frame(&[2, 0x22, 0x10]), Some((&[0x22, 0x10][..], true)));
        assert_eq!(single_frame(&[3, 0x22]), Some((&[0x22][..], false)));
    }
}
