//! LSS: the eight bytes of a request and of an answer (CiA 305 6.4).

use super::cob_id::NodeId;
use super::u32_at;

/// The four numbers that tell one slave from every other: the identity object, 0x1018.
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
    /// Returns one of the four numbers; `None` for a part above 3.
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

/// The number of a slave's identity that a service is about: 0 vendor, 1 product, 2 revision, 3 serial.
pub type Part = u8;

/// The condition of identify remote slave on one of the four numbers, the limits included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// Equal to this number.
    Exactly(Part),
    /// Not lower than this number.
    AtLeast(Part),
    /// Not higher than this number.
    AtMost(Part),
}

impl Bound {
    /// All of them, in the order in which they are asked.
    pub const ALL: [Self; 6] =
        [Self::Exactly(0), Self::Exactly(1), Self::AtLeast(2), Self::AtMost(2), Self::AtLeast(3), Self::AtMost(3)];

    /// Returns whether a slave is within the bound.
    #[must_use]
    pub fn holds(self, limit: u32, address: &Address) -> bool {
        match self {
            Self::Exactly(part) => address.part(part) == Some(limit),
            Self::AtLeast(part) => address.part(part).is_some_and(|own| own >= limit),
            Self::AtMost(part) => address.part(part).is_some_and(|own| own <= limit),
        }
    }
}

/// A node ID as LSS configures it: 1–127, or 255 for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LssNodeId(pub Option<NodeId>);

impl LssNodeId {
    /// Returns the node ID of a number; `None` for a reserved one.
    #[must_use]
    pub fn new(raw: u8) -> Option<Self> {
        if raw == NO_NODE_ID { Some(Self(None)) } else { NodeId::new(raw).map(|node_id| Self(Some(node_id))) }
    }

    /// Returns the number.
    #[must_use]
    pub fn get(self) -> u8 {
        self.0.map_or(NO_NODE_ID, NodeId::get)
    }
}

/// A question of the fast scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FastScan {
    /// The number that is compared.
    pub number: u32,
    /// The lowest bit that is compared, 0–31; 0x80 asks who is there.
    pub bit_check: u8,
    /// The number that the question is about.
    pub sub: u8,
    /// The number that the master asks about next.
    pub next: u8,
}

impl FastScan {
    /// Returns whether this is the last question: all bits of the last number, and the master goes on to another one.
    #[must_use]
    pub const fn is_last(&self) -> bool {
        self.bit_check == 0 && self.sub == 3 && self.next != 3
    }
}

/// A request of a master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// 0x04: all to waiting (0) or configuration (1).
    SwitchGlobal {
        /// The mode; others than 0 and 1 are reserved.
        mode: u8,
    },
    /// 0x40–0x43: one of the four numbers of the slave that is to go to configuration.
    SwitchSelective(Part, u32),
    /// 0x11: a pending node ID.
    ConfigureNodeId(u8),
    /// 0x13: a pending bit rate.
    ConfigureBitTiming {
        /// The table; 0 is that of CiA.
        table: u8,
        /// The entry of the table.
        index: u8,
    },
    /// 0x15: switch to the pending bit rate.
    ActivateBitTiming {
        /// The delay in ms, before and after the switch.
        delay_ms: u16,
    },
    /// 0x17: store node ID and bit rate.
    Store,
    /// 0x5A–0x5D: one of the four numbers.
    InquireIdentity(Part),
    /// 0x5E: the node ID.
    InquireNodeId,
    /// 0x46–0x4B: one of the bounds of identify remote slave.
    IdentifyRemote(Bound, u32),
    /// 0x4C: is there a slave without node ID?
    IdentifyNonConfigured,
    /// 0x51: fast scan.
    FastScan(FastScan),
    /// Any other command.
    Unknown(u8),
}

impl Request {
    /// Returns what eight bytes on 0x7E5 ask for.
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

/// An answer of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// 0x44: it is the one whose four numbers were sent.
    Selected,
    /// 0x11: node ID taken, or the error code.
    NodeId(u8),
    /// 0x13: bit rate taken, or the error code.
    BitTiming(u8),
    /// 0x17: stored, or the error code.
    Stored(u8),
    /// 0x5A–0x5D: one of the four numbers.
    Identity(Part, u32),
    /// 0x5E: the node ID; 255 for none.
    InquiredNodeId(u8),
    /// 0x50: it has no node ID.
    NonConfigured,
    /// 0x4F: the question of identify remote slave or fast scan is answered with yes.
    Identified,
}

/// The error code of an answer to a configuration or store service that succeeded; others are the product's.
pub const SUCCESS: u8 = 0;

/// The node ID that answers an inquiry when there is none.
pub const NO_NODE_ID: u8 = 255;

impl Answer {
    /// Returns the answer as it goes over the bus.
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
