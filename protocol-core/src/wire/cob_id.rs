//! Node IDs and COB-IDs (CiA 301 7.3.3 and 7.5.2): the predefined connection set, and objects of type COB-ID.

use crate::frame::{Id, StandardId, extended, standard};

/// A CANopen node ID, 1–127.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(u8);

impl NodeId {
    /// Creates a node ID of 1–127; `None` outside this range.
    #[inline]
    #[must_use]
    pub const fn new(raw: u8) -> Option<Self> {
        if raw >= 1 && raw <= 127 { Some(Self(raw)) } else { None }
    }

    /// Returns the node ID as a number, 1–127.
    #[inline]
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }

    /// Returns the identifier of this node's `function` in the predefined connection set.
    #[inline]
    #[must_use]
    pub const fn id(self, function: Function) -> StandardId {
        standard(self.raw_id(function))
    }

    /// Returns the identifier of this node's `function` as a number.
    #[inline]
    #[must_use]
    pub const fn raw_id(self, function: Function) -> u16 {
        function as u16 | self.0 as u16
    }
}

/// The functions of a node in the predefined connection set. The identifier of a frame is the function plus the node
/// ID.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Function {
    /// EMCY, sent by the node.
    Emcy = 0x080,
    /// TPDO 1, sent by the node.
    Tpdo1 = 0x180,
    /// RPDO 1, received by the node.
    Rpdo1 = 0x200,
    /// SDO answer, sent by the node.
    SdoAnswer = 0x580,
    /// SDO request, received by the node.
    SdoRequest = 0x600,
    /// Boot-up and heartbeat, sent by the node.
    Heartbeat = 0x700,
}

impl Function {
    const ALL: [Self; 6] = [Self::Emcy, Self::Tpdo1, Self::Rpdo1, Self::SdoAnswer, Self::SdoRequest, Self::Heartbeat];

    /// Returns whether the node sends the frames of this function; otherwise the node receives them.
    #[must_use]
    pub const fn is_from_node(self) -> bool {
        !matches!(self, Self::Rpdo1 | Self::SdoRequest)
    }
}

/// Returns the function and node ID of an identifier; `None` for PDOs 2 to 4 and for identifiers without a node ID.
#[must_use]
pub fn classify(id: StandardId) -> Option<(Function, NodeId)> {
    let (function, node) = (id.as_raw() & !0x7F, id.as_raw() & 0x7F);
    let function = Function::ALL.into_iter().find(|known| *known as u16 == function)?;
    Some((function, NodeId::new(u8::try_from(node).ok()?)?))
}

/// The identifier of NMT commands, which all nodes receive.
pub const NMT: u16 = 0x000;
/// The identifier of LSS answers, which the slaves send.
pub const LSS_ANSWER: u16 = 0x7E4;
/// The identifier of LSS requests, which the slaves receive.
pub const LSS_REQUEST: u16 = 0x7E5;

/// The value of an object of type COB-ID: an identifier and three control bits (CiA 301 7.5.2.5, .15, .35).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CobId(u32);

impl CobId {
    /// Bit 31: the communication object is off.
    pub const OFF: u32 = 1 << 31;
    /// Bit 30: for a PDO, RTR is not allowed; for SYNC, the device is the producer.
    pub const BIT_30: u32 = 1 << 30;
    /// Bit 29: the identifier has 29 bits.
    pub const EXTENDED: u32 = 1 << 29;
    const IDENTIFIER: u32 = Self::EXTENDED - 1;

    /// Creates a COB-ID from any 32 bits.
    #[inline]
    #[must_use]
    pub const fn new(raw: u32) -> Self {
        Self(raw)
    }

    /// Returns all 32 bits.
    #[inline]
    #[must_use]
    pub const fn raw(self) -> u32 {
        self.0
    }

    /// Returns whether bit 31 switches the communication object off.
    #[inline]
    #[must_use]
    pub const fn is_off(self) -> bool {
        self.0 & Self::OFF != 0
    }

    /// Returns whether bit 30 is set.
    #[must_use]
    pub const fn has_bit_30(self) -> bool {
        self.0 & Self::BIT_30 != 0
    }

    /// Returns whether the identifier has 29 bits.
    #[must_use]
    pub const fn is_extended(self) -> bool {
        self.0 & Self::EXTENDED != 0
    }

    /// Returns bits 0–28.
    #[must_use]
    pub const fn identifier(self) -> u32 {
        self.0 & Self::IDENTIFIER
    }

    /// Returns the CAN identifier. Bit 29 decides between 11 and 29 bits.
    #[must_use]
    pub const fn id(self) -> Id {
        if self.is_extended() {
            Id::Extended(extended(self.identifier()))
        } else {
            Id::Standard(standard((self.0 & 0x7FF) as u16))
        }
    }

    /// Returns the [key](crate::frame::key) of the identifier.
    #[inline]
    #[must_use]
    pub const fn key(self) -> u32 {
        self.0 & (Self::EXTENDED | Self::IDENTIFIER)
    }

    /// Returns whether a PDO, SYNC, EMCY or EMCY consumer may use the identifier. `extended` permits every 29-bit
    /// identifier. CiA 301 (7.3.5) restricts some 11-bit identifiers, such as the identifiers of NMT, the default SDOs
    /// and LSS (SPEC 4.1).
    #[must_use]
    pub const fn is_usable(self, extended: bool) -> bool {
        if self.is_extended() {
            return extended;
        }
        !matches!(
            self.identifier(),
            0x000..=0x07F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF | 0x701..
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn node_ids_are_1_to_127() {
        assert_eq!(NodeId::new(0), None);
        assert_eq!(NodeId::new(128), None);
        assert_eq!(NodeId::new(1).map(NodeId::get), Some(1));
        assert_eq!(NodeId::new(127).map(|id| id.id(Function::Heartbeat).as_raw()), Some(0x77F));
    }

    #[test]
    fn each_identifier_of_the_predefined_connection_set_is_classified() {
        for raw in 0..=0x7FF {
            let found = classify(StandardId::new(raw).unwrap());
            let function = match raw {
                0x081..=0x0FF => Some(Function::Emcy),
                0x181..=0x1FF => Some(Function::Tpdo1),
                0x201..=0x27F => Some(Function::Rpdo1),
                0x581..=0x5FF => Some(Function::SdoAnswer),
                0x601..=0x67F => Some(Function::SdoRequest),
                0x701..=0x77F => Some(Function::Heartbeat),
                _ => None,
            };
            assert_eq!(found.map(|(function, _)| function), function, "{raw:X}");
            assert!(found.is_none_or(|(function, node)| node.raw_id(function) == raw), "{raw:X}");
        }
    }

    #[test]
    fn the_reserved_identifiers_at_their_edges() {
        for raw in [0x000, 0x07F, 0x101, 0x180, 0x581, 0x5FF, 0x601, 0x67F, 0x6E0, 0x6FF, 0x701, 0x7FF, 0x800] {
            assert!(!CobId::new(raw).is_usable(false), "{raw:X}");
        }
        for raw in [0x080, 0x100, 0x181, 0x200, 0x580, 0x600, 0x680, 0x6DF, 0x700] {
            assert!(CobId::new(raw).is_usable(false), "{raw:X}");
            assert!(CobId::new(raw | CobId::OFF | CobId::BIT_30).is_usable(false), "{raw:X}");
        }
        assert!(!CobId::new(CobId::EXTENDED | 0x200).is_usable(false));
        assert!(CobId::new(CobId::EXTENDED | 0x200).is_usable(true));
        assert!(!CobId::new(0x0001_0200).is_usable(true));
    }
}
