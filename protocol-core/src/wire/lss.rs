//! LSS requests and answers, of eight bytes each (CiA 305 6.4).

use super::cob_id::NodeId;
use super::u32_at;

/// The LSS address of a slave: the four numbers of its identity object, 0x1018.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// Vendor ID.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision number.
    pub revision: u32,
    /// Serial number.
    pub serial: u32,
}

impl Address {
    /// Returns a part of the address; `None` for a part above 3.
    #[must_use]
    pub const fn part(&self, part: u8) -> Option<u32> {
        match part {
            0 => Some(self.vendor),
            1 => Some(self.product),
            2 => Some(self.revision),
            3 => Some(self.serial),
            _ => None,
        }
    }
}

/// A part of the LSS address: 0 vendor, 1 product, 2 revision, 3 serial.
pub type Part = u8;

/// The kind of a bound on a part of the LSS address, set by identify remote slave. The limit itself satisfies every
/// bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// The part equals the limit.
    Exactly(Part),
    /// The part is at least the limit.
    AtLeast(Part),
    /// The part is at most the limit.
    AtMost(Part),
}

impl Bound {
    /// All bounds, in the order of the protocol.
    pub const ALL: [Self; 6] =
        [Self::Exactly(0), Self::Exactly(1), Self::AtLeast(2), Self::AtMost(2), Self::AtLeast(3), Self::AtMost(3)];

    /// Returns whether an LSS address satisfies the bound with the given limit.
    #[must_use]
    pub fn holds(self, limit: u32, address: &Address) -> bool {
        match self {
            Self::Exactly(part) => address.part(part) == Some(limit),
            Self::AtLeast(part) => address.part(part).is_some_and(|own| own >= limit),
            Self::AtMost(part) => address.part(part).is_some_and(|own| own <= limit),
        }
    }
}

/// A node ID in LSS: 1–127, or 255 for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LssNodeId(pub Option<NodeId>);

impl LssNodeId {
    /// Creates a node ID from its number; `None` for a reserved number.
    #[must_use]
    pub fn new(raw: u8) -> Option<Self> {
        if raw == NO_NODE_ID { Some(Self(None)) } else { NodeId::new(raw).map(|node_id| Self(Some(node_id))) }
    }

    /// Returns the node ID as a number, 255 for none.
    #[must_use]
    pub fn get(self) -> u8 {
        self.0.map_or(NO_NODE_ID, NodeId::get)
    }
}

/// A fast scan request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FastScan {
    /// The number to compare with the part of the LSS address.
    pub number: u32,
    /// The lowest compared bit, 0–31. 0x80 starts a scan, and every slave without a node ID answers.
    pub bit_check: u8,
    /// The compared part of the LSS address.
    pub sub: u8,
    /// The part that the next request compares.
    pub next: u8,
}

impl FastScan {
    /// Returns whether a match of this request ends the scan: the request compares all bits of the last part, and
    /// `next` differs from this part.
    #[must_use]
    pub const fn is_last(&self) -> bool {
        self.bit_check == 0 && self.sub == 3 && self.next != 3
    }
}

/// A request from an LSS master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// 0x04: switch all slaves to waiting (0) or configuration (1).
    SwitchGlobal {
        /// The mode; values above 1 are reserved.
        mode: u8,
    },
    /// 0x40–0x43: switch the slave with this LSS address to configuration. A request carries one part of the address.
    SwitchSelective(Part, u32),
    /// 0x11: configure a node ID.
    ConfigureNodeId(u8),
    /// 0x13: configure a bit rate.
    ConfigureBitTiming {
        /// The bit timing table; 0 is the table of CiA 305.
        table: u8,
        /// The index of the bit rate in the table.
        index: u8,
    },
    /// 0x15: activate the configured bit rate.
    ActivateBitTiming {
        /// The delay before the switch, and the delay after it, in ms.
        delay_ms: u16,
    },
    /// 0x17: store the node ID and bit rate.
    Store,
    /// 0x5A–0x5D: inquire a part of the LSS address.
    InquireIdentity(Part),
    /// 0x5E: inquire the node ID.
    InquireNodeId,
    /// 0x46–0x4B: identify remote slaves. A request carries one bound and its limit.
    IdentifyRemote(Bound, u32),
    /// 0x4C: identify slaves without a node ID.
    IdentifyNonConfigured,
    /// 0x51: fast scan.
    FastScan(FastScan),
    /// Any other command, with its first byte.
    Unknown(u8),
}

impl Request {
    /// Decodes the eight data bytes of a request.
    #[must_use]
    pub fn parse(bytes: &[u8; 8]) -> Self {
        let [command, first, second, _, _, bit_check, sub, next] = *bytes;
        let number = u32_at(bytes, 1);
        match command {
            0x04 => Self::SwitchGlobal { mode: first },
            0x40..=0x43 => Self::SwitchSelective(command & 0b11, number),
            0x11 => Self::ConfigureNodeId(first),
            0x13 => Self::ConfigureBitTiming { table: first, index: second },
            0x15 => Self::ActivateBitTiming { delay_ms: u16::from_le_bytes([first, second]) },
            0x17 => Self::Store,
            0x5A..=0x5D => Self::InquireIdentity(command.wrapping_sub(0x5A)),
            0x5E => Self::InquireNodeId,
            0x46..=0x4B => {
                let bound = Bound::ALL.get(usize::from(command.wrapping_sub(0x46)));
                bound.map_or(Self::Unknown(command), |bound| Self::IdentifyRemote(*bound, number))
            }
            0x4C => Self::IdentifyNonConfigured,
            0x51 => Self::FastScan(FastScan { number, bit_check, sub, next }),
            _ => Self::Unknown(command),
        }
    }
}

/// An answer from an LSS slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// 0x44: all four parts of the LSS address match, and the slave is in configuration.
    Selected,
    /// 0x11: the result of configuring the node ID, [`SUCCESS`] or an error code.
    NodeId(u8),
    /// 0x13: the result of configuring the bit rate, [`SUCCESS`] or an error code.
    BitTiming(u8),
    /// 0x17: the result of storing, [`SUCCESS`] or an error code.
    Stored(u8),
    /// 0x5A–0x5D: a part of the LSS address.
    Identity(Part, u32),
    /// 0x5E: the node ID; 255 for none.
    InquiredNodeId(u8),
    /// 0x50: the slave has no node ID.
    NonConfigured,
    /// 0x4F: the slave satisfies identify remote slave or fast scan.
    Identified,
}

/// The result of a successful configuration or store. The product defines the error codes.
pub const SUCCESS: u8 = 0;

/// The number that stands for no node ID.
pub const NO_NODE_ID: u8 = 255;

impl Answer {
    /// Encodes the answer as eight data bytes.
    #[must_use]
    pub const fn emit(self) -> [u8; 8] {
        let (command, number) = match self {
            Self::Selected => (0x44, 0),
            Self::NodeId(error) => (0x11, error as u32),
            Self::BitTiming(error) => (0x13, error as u32),
            Self::Stored(error) => (0x17, error as u32),
            Self::Identity(part, number) => (0x5A_u8.wrapping_add(part & 0b11), number),
            Self::InquiredNodeId(node) => (0x5E, node as u32),
            Self::NonConfigured => (0x50, 0),
            Self::Identified => (0x4F, 0),
        };
        let [a, b, c, d] = number.to_le_bytes();
        [command, a, b, c, d, 0, 0, 0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(bytes: [u8; 8]) -> Request {
        Request::parse(&bytes)
    }

    #[test]
    fn requests_as_the_manual_prints_them() {
        assert_eq!(parse([0x04, 0x01, 0, 0, 0, 0, 0, 0]), Request::SwitchGlobal { mode: 1 });
        assert_eq!(parse([0x40, 0x19, 0, 0, 0x01, 0, 0, 0]), Request::SwitchSelective(0, 0x0100_0019));
        assert_eq!(parse([0x43, 0x00, 0x01, 0x2E, 0x5B, 0, 0, 0]), Request::SwitchSelective(3, 0x5B2E_0100));
        assert_eq!(parse([0x11, 0x17, 0, 0, 0, 0, 0, 0]), Request::ConfigureNodeId(0x17));
        assert_eq!(parse([0x13, 0, 2, 0, 0, 0, 0, 0]), Request::ConfigureBitTiming { table: 0, index: 2 });
        assert_eq!(parse([0x15, 0xE8, 0x03, 0, 0, 0, 0, 0]), Request::ActivateBitTiming { delay_ms: 1000 });
        assert_eq!(parse([0x17, 0, 0, 0, 0, 0, 0, 0]), Request::Store);
        assert_eq!(parse([0x4C, 0, 0, 0, 0, 0, 0, 0]), Request::IdentifyNonConfigured);
        assert_eq!(parse([0x5D, 0, 0, 0, 0, 0, 0, 0]), Request::InquireIdentity(3));
        assert_eq!(parse([0x49, 0x07, 0x00, 0x01, 0, 0, 0, 0]), Request::IdentifyRemote(Bound::AtMost(2), 0x0001_0007));
        assert_eq!(
            parse([0x51, 0x00, 0x00, 0x36, 0x53, 0x00, 0x01, 0x02]),
            Request::FastScan(FastScan { number: 0x5336_0000, bit_check: 0, sub: 1, next: 2 })
        );
        assert_eq!(parse([0x44, 0, 0, 0, 0, 0, 0, 0]), Request::Unknown(0x44));
    }

    #[test]
    fn answers_as_the_manual_prints_them() {
        assert_eq!(Answer::Selected.emit(), [0x44, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(Answer::NodeId(1).emit(), [0x11, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(Answer::BitTiming(SUCCESS).emit(), [0x13, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(Answer::Stored(2).emit(), [0x17, 2, 0, 0, 0, 0, 0, 0]);
        assert_eq!(Answer::Identity(3, 0x5B2E_0100).emit(), [0x5D, 0x00, 0x01, 0x2E, 0x5B, 0, 0, 0]);
        assert_eq!(Answer::InquiredNodeId(0x20).emit(), [0x5E, 0x20, 0, 0, 0, 0, 0, 0]);
        assert_eq!(Answer::NonConfigured.emit(), [0x50, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(Answer::Identified.emit(), [0x4F, 0, 0, 0, 0, 0, 0, 0]);
    }
}
