//! J1939 identifiers: priority, parameter group number, destination or group extension, source (SAE J1939-21 5.2; ISO
//! 11783-3).

use crate::frame::{Frame, Id, extended, key};

/// An address on the bus. Controllers have the addresses 0–253.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address(u8);

impl Address {
    /// The null address: the source address of a cannot-claim.
    pub const NULL: Self = Self(0xFE);
    /// The global address: the destination of messages to all controllers.
    pub const GLOBAL: Self = Self(0xFF);

    /// Creates an address from any byte.
    #[inline]
    #[must_use]
    pub const fn new(raw: u8) -> Self {
        Self(raw)
    }

    /// Returns the address as a byte.
    #[inline]
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }
}

/// A parameter group number (PGN) of 24 bits.
///
/// In an identifier the number has 18 bits, and in PDU1 format its low byte is 0. A request can contain any 24 bits,
/// which a refusal must repeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pgn(u32);

impl Pgn {
    /// Acknowledgement, PDU1.
    pub const ACKNOWLEDGEMENT: Self = Self(0x00_E800);
    /// Request, PDU1.
    pub const REQUEST: Self = Self(0x00_EA00);
    /// Transport protocol, data transfer (TP.DT), PDU1.
    pub const TP_DATA: Self = Self(0x00_EB00);
    /// Transport protocol, connection management (TP.CM), PDU1.
    pub const TP_CONNECTION: Self = Self(0x00_EC00);
    /// Address claimed, and cannot claim, PDU1.
    pub const ADDRESS_CLAIMED: Self = Self(0x00_EE00);
    /// DM1, active diagnostic trouble codes (R: the manual prints the identifier 18CEFA).
    pub const DM1: Self = Self(0x00_FECA);
    /// DM2, previously active diagnostic trouble codes (R: the manual prints the identifiers 18CEFCB and 18CEFB).
    pub const DM2: Self = Self(0x00_FECB);
    /// DM3, clearing of previously active diagnostic trouble codes.
    pub const DM3: Self = Self(0x00_FECC);
    /// Commanded address.
    pub const COMMANDED_ADDRESS: Self = Self(0x00_FED8);

    /// Creates a group number from the low 24 bits of `raw`.
    #[inline]
    #[must_use]
    pub const fn new(raw: u32) -> Self {
        Self(raw & 0xFF_FFFF)
    }

    /// Returns the group of auxiliary valve commands (AVC) to a valve. The low four bits of `number` select the valve.
    #[inline]
    #[must_use]
    pub const fn avc(number: u8) -> Self {
        Self(0x00_FE30 | (number & 0xF) as u32)
    }

    /// Returns the group of auxiliary valve estimated flows (AVEF) from a valve. The low four bits of `number` select
    /// the valve.
    #[inline]
    #[must_use]
    pub const fn avef(number: u8) -> Self {
        Self(0x00_FE10 | (number & 0xF) as u32)
    }

    /// Decodes three bytes, least significant first.
    #[inline]
    #[must_use]
    pub const fn from_bytes([low, middle, high]: [u8; 3]) -> Self {
        Self(u32::from_le_bytes([low, middle, high, 0]))
    }

    /// Encodes three bytes, least significant first.
    #[inline]
    #[must_use]
    pub const fn to_bytes(self) -> [u8; 3] {
        let [low, middle, high, _] = self.0.to_le_bytes();
        [low, middle, high]
    }

    /// Returns the 24 bits.
    #[inline]
    #[must_use]
    pub const fn raw(self) -> u32 {
        self.0
    }

    /// Returns the page bits and the PDU format, like [`J1939Id::format`], without the higher bits.
    #[inline]
    #[must_use]
    pub const fn format(self) -> Format {
        Format((self.0 >> 8) as u16 & 0x3FF)
    }
}

/// The two page bits and the eight bits of the PDU format. In PDU1 format these ten bits determine the group.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Format(u16);

impl Format {
    /// Acknowledgement.
    pub const ACKNOWLEDGEMENT: Self = Pgn::ACKNOWLEDGEMENT.format();
    /// Request.
    pub const REQUEST: Self = Pgn::REQUEST.format();
    /// Transport protocol, data transfer.
    pub const TP_DATA: Self = Pgn::TP_DATA.format();
    /// Transport protocol, connection management.
    pub const TP_CONNECTION: Self = Pgn::TP_CONNECTION.format();
    /// Address claimed, and cannot claim.
    pub const ADDRESS_CLAIMED: Self = Pgn::ADDRESS_CLAIMED.format();
    /// The groups 0xFE00–0xFEFF: AVC, AVEF, the diagnostic messages and many others. The next byte of the identifier
    /// distinguishes them.
    pub const GROUPS_FE: Self = Pgn(0x00_FE00).format();

    /// Returns whether the format is PDU1, whose frames have a destination.
    #[inline]
    #[must_use]
    pub const fn is_pdu1(self) -> bool {
        self.0 & 0xFF < 240
    }
}

/// The priority of a message, from 0 (highest) to 7.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Priority(u8);

impl Priority {
    /// 3: control messages (AVC and AVEF).
    pub const CONTROL: Self = Self(3);
    /// 6: all other messages.
    pub const DEFAULT: Self = Self(6);
    /// 7: the transport protocol.
    pub const TRANSPORT: Self = Self(7);

    /// Creates a priority from the low three bits of `raw`.
    #[must_use]
    pub const fn new(raw: u8) -> Self {
        Self(raw & 7)
    }

    /// Returns the priority as a number, 0–7.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }
}

/// The bits of the extended data page and the data page.
const BOTH_PAGES: u32 = 3 << 24;

/// A 29-bit J1939 identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct J1939Id(u32);

impl J1939Id {
    /// Creates the identifier of a message. The destination is ignored for a group in PDU2 format.
    #[inline]
    #[must_use]
    pub const fn new(priority: Priority, pgn: Pgn, destination: Address, source: Address) -> Self {
        let group = if pgn.format().is_pdu1() { pgn.0 & 0x3_FF00 | destination.0 as u32 } else { pgn.0 & 0x3_FFFF };
        Self((priority.0 as u32) << 26 | group << 8 | source.0 as u32)
    }

    /// Creates the identifier of a message to all.
    #[inline]
    #[must_use]
    pub const fn global(priority: Priority, pgn: Pgn, source: Address) -> Self {
        Self::new(priority, pgn, Address::GLOBAL, source)
    }

    /// Creates an identifier from the low 29 bits of `raw`.
    #[inline]
    #[must_use]
    pub const fn from_raw(raw: u32) -> Self {
        Self(raw & 0x1FFF_FFFF)
    }

    /// Returns the identifier of a frame; `None` for an 11-bit identifier.
    #[inline]
    #[must_use]
    pub fn of(frame: &Frame) -> Option<Self> {
        frame.is_extended().then(|| Self::from_raw(frame.key()))
    }

    /// Returns the 29 bits.
    #[inline]
    #[must_use]
    pub const fn raw(self) -> u32 {
        self.0
    }

    /// Returns the identifier as a frame's [`Id`].
    #[inline]
    #[must_use]
    pub const fn id(self) -> Id {
        Id::Extended(extended(self.0))
    }

    /// Returns the [key] of the identifier.
    #[inline]
    #[must_use]
    pub fn key(self) -> u32 {
        key(self.id())
    }

    /// Returns whether J1939 uses the identifier. An identifier with both page bits set belongs to another protocol
    /// (ISO 11783-3).
    #[inline]
    #[must_use]
    pub const fn is_j1939(self) -> bool {
        self.0 & BOTH_PAGES != BOTH_PAGES
    }

    /// Returns the priority.
    #[must_use]
    pub const fn priority(self) -> Priority {
        Priority::new((self.0 >> 26) as u8)
    }

    /// Returns the page bits and the PDU format.
    #[inline]
    #[must_use]
    pub const fn format(self) -> Format {
        Format((self.0 >> 16) as u16 & 0x3FF)
    }

    /// Returns the parameter group number.
    #[inline]
    #[must_use]
    pub const fn pgn(self) -> Pgn {
        Pgn(self.0 >> 8 & if self.format().is_pdu1() { 0x3_FF00 } else { 0x3_FFFF })
    }

    /// Returns the destination; [`Address::GLOBAL`] in PDU2 format.
    #[inline]
    #[must_use]
    pub const fn destination(self) -> Address {
        if self.format().is_pdu1() { Address(self.pdu_specific()) } else { Address::GLOBAL }
    }

    /// Returns the PDU-specific field: the destination in PDU1 format, the group extension in PDU2 format.
    #[inline]
    #[must_use]
    pub const fn pdu_specific(self) -> u8 {
        (self.0 >> 8) as u8
    }

    /// Returns the source address.
    #[inline]
    #[must_use]
    pub const fn source(self) -> Address {
        Address(self.0 as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::standard;

    fn parts(raw: u32) -> (u8, Pgn, u8, u8) {
        let id = J1939Id::from_raw(raw);
        (id.priority().get(), id.pgn(), id.destination().get(), id.source().get())
    }

    #[test]
    fn identifiers_as_the_manual_prints_them() {
        for (raw, priority, pgn, destination, source) in [
            (0x18EA_8327, 6, Pgn::REQUEST, 0x83, 0x27),
            (0x18E8_FF83, 6, Pgn::ACKNOWLEDGEMENT, 0xFF, 0x83),
            (0x18EE_FF83, 6, Pgn::ADDRESS_CLAIMED, 0xFF, 0x83),
            (0x1CEC_FF83, 7, Pgn::TP_CONNECTION, 0xFF, 0x83),
            (0x1CEB_FF83, 7, Pgn::TP_DATA, 0xFF, 0x83),
            (0x18FE_CA83, 6, Pgn::DM1, 0xFF, 0x83),
            (0x18FE_CB83, 6, Pgn::DM2, 0xFF, 0x83),
            (0x18FE_CC83, 6, Pgn::DM3, 0xFF, 0x83),
            (0x18FE_D827, 6, Pgn::COMMANDED_ADDRESS, 0xFF, 0x27),
            (0x0CFE_3327, 3, Pgn::avc(3), 0xFF, 0x27),
            (0x0CFE_1383, 3, Pgn::avef(0x83), 0xFF, 0x83),
        ] {
            assert_eq!(parts(raw), (priority, pgn, destination, source), "{raw:08X}");
            let id = J1939Id::new(Priority::new(priority), pgn, Address::new(destination), Address::new(source));
            assert_eq!(id.raw(), raw, "{raw:08X}");
        }
    }

    #[test]
    fn both_pages_are_part_of_the_number() {
        // UDS identifiers have both page bits set, so they belong to no group of page 0.
        assert_eq!(parts(0x1BC7_8805), (6, Pgn::new(0x3_C700), 0x88, 0x05));
        assert_eq!(parts(0x19FE_CA00), (6, Pgn::new(0x1_FECA), 0xFF, 0x00));
        assert_eq!(J1939Id::global(Priority::DEFAULT, Pgn::new(0x1_FECA), Address::new(0)).raw(), 0x19FE_CA00);
    }

    #[test]
    fn the_formats_part_at_240() {
        assert_eq!(parts(0x18EF_1234), (6, Pgn::new(0xEF00), 0x12, 0x34));
        assert_eq!(parts(0x18F0_1234), (6, Pgn::new(0xF012), 0xFF, 0x34));
    }

    #[test]
    fn a_format_is_that_of_its_group() {
        for (raw, format) in [
            (0x18E8_FF83, Format::ACKNOWLEDGEMENT),
            (0x18EA_8327, Format::REQUEST),
            (0x1CEB_FF83, Format::TP_DATA),
            (0x1CEC_FF83, Format::TP_CONNECTION),
            (0x18EE_FF83, Format::ADDRESS_CLAIMED),
            (0x0CFE_3327, Format::GROUPS_FE),
        ] {
            let id = J1939Id::from_raw(raw);
            assert_eq!((id.format(), id.pgn().format()), (format, format), "{raw:08X}");
            // The other pages have other groups.
            for page in [1 << 24, 1 << 25] {
                assert_ne!(J1939Id::from_raw(raw | page).format(), format, "{raw:08X}");
            }
        }
    }

    #[test]
    fn every_identifier_is_put_together_as_it_was() {
        for step in 0..0x1_0000 {
            let id = J1939Id::from_raw(step * 0x2011);
            assert_eq!(J1939Id::new(id.priority(), id.pgn(), id.destination(), id.source()), id);
        }
    }

    #[test]
    fn a_pgn_of_three_bytes_keeps_all_24_bits() {
        assert_eq!(Pgn::from_bytes([0xCC, 0xFE, 0x00]), Pgn::DM3);
        assert_eq!(Pgn::from_bytes([0xCC, 0xFE, 0xFC]).to_bytes(), [0xCC, 0xFE, 0xFC]);
        assert_ne!(Pgn::from_bytes([0xCC, 0xFE, 0xFC]), Pgn::DM3);
        assert_eq!(Pgn::avc(0x8F).raw(), 0xFE3F);
    }

    #[test]
    fn a_standard_frame_has_none() {
        assert_eq!(J1939Id::of(&Frame::full(standard(0x123).into(), [0; 8])), None);
        let id = J1939Id::from_raw(0x18EE_FF83);
        assert_eq!(J1939Id::of(&Frame::full(id.id(), [0; 8])), Some(id));
    }
}
