//! NAME, the unique identification of a controller, and its messages: address claimed and commanded address (SAE
//! J1939-81).

use super::j1939_id::{Address, J1939Id, Pgn, Priority};
use crate::frame::Frame;

/// A NAME of 64 bits. The lower of two NAMEs wins an address.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Name(u64);

/// The mask of the identity number, the low 21 bits.
pub const IDENTITY_NUMBER: u32 = 0x1F_FFFF;

/// The fields of a NAME. [`Name::new`] ignores bits beyond the width of a field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fields {
    /// Whether the controller can choose another address by itself.
    pub arbitrary_address_capable: bool,
    /// The industry group, 3 bits; 2 is agriculture and forestry.
    pub industry_group: u8,
    /// The vehicle system instance, 4 bits.
    pub vehicle_system_instance: u8,
    /// The vehicle system, 7 bits.
    pub vehicle_system: u8,
    /// The function, 8 bits.
    pub function: u8,
    /// The function instance, 5 bits.
    pub function_instance: u8,
    /// The ECU instance, 3 bits.
    pub ecu_instance: u8,
    /// The manufacturer code, 11 bits.
    pub manufacturer_code: u16,
    /// The identity number, 21 bits.
    pub identity_number: u32,
}

impl Name {
    /// Creates a NAME from its fields; the reserved bit is 0.
    #[must_use]
    pub const fn new(fields: &Fields) -> Self {
        Self(
            (fields.arbitrary_address_capable as u64) << 63
                | (fields.industry_group as u64 & 0x7) << 60
                | (fields.vehicle_system_instance as u64 & 0xF) << 56
                | (fields.vehicle_system as u64 & 0x7F) << 49
                | (fields.function as u64) << 40
                | (fields.function_instance as u64 & 0x1F) << 35
                | (fields.ecu_instance as u64 & 0x7) << 32
                | (fields.manufacturer_code as u64 & 0x7FF) << 21
                | (fields.identity_number & IDENTITY_NUMBER) as u64,
        )
    }

    /// Returns the fields, without the reserved bit.
    #[must_use]
    pub const fn fields(self) -> Fields {
        Fields {
            arbitrary_address_capable: self.0 >> 63 != 0,
            industry_group: (self.0 >> 60) as u8 & 0x7,
            vehicle_system_instance: (self.0 >> 56) as u8 & 0xF,
            vehicle_system: (self.0 >> 49) as u8 & 0x7F,
            function: (self.0 >> 40) as u8,
            function_instance: (self.0 >> 35) as u8 & 0x1F,
            ecu_instance: (self.0 >> 32) as u8 & 0x7,
            manufacturer_code: (self.0 >> 21) as u16 & 0x7FF,
            identity_number: self.0 as u32 & IDENTITY_NUMBER,
        }
    }

    /// Decodes the eight bytes on the bus.
    #[inline]
    #[must_use]
    pub const fn from_bytes(bytes: [u8; 8]) -> Self {
        Self(u64::from_le_bytes(bytes))
    }

    /// Encodes the eight bytes on the bus.
    #[inline]
    #[must_use]
    pub const fn to_bytes(self) -> [u8; 8] {
        self.0.to_le_bytes()
    }

    /// Returns the 64 bits as a number.
    #[inline]
    #[must_use]
    pub const fn raw(self) -> u64 {
        self.0
    }

    /// Encodes an address claim, `18EEFFyy` with the NAME. With the source [`Address::NULL`] the frame is a
    /// cannot-claim.
    #[inline]
    #[must_use]
    pub fn claim(self, source: Address) -> Frame {
        let id = J1939Id::global(Priority::DEFAULT, Pgn::ADDRESS_CLAIMED, source);
        Frame::full(id.id(), self.to_bytes())
    }
}

/// The length of a commanded address.
pub const COMMANDED_ADDRESS_LEN: usize = 9;

/// A commanded address: the controller with this NAME must change to this address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandedAddress {
    /// The NAME of the addressed controller.
    pub name: Name,
    /// The new address.
    pub address: Address,
}

impl CommandedAddress {
    /// Decodes nine bytes; `None` for any other length.
    #[must_use]
    pub fn parse(payload: &[u8]) -> Option<Self> {
        let (name, rest) = payload.split_first_chunk()?;
        let &[address] = rest else { return None };
        Some(Self { name: Name::from_bytes(*name), address: Address::new(address) })
    }

    /// Encodes the command as nine bytes.
    #[must_use]
    pub const fn emit(self) -> [u8; COMMANDED_ADDRESS_LEN] {
        let [a, b, c, d, e, f, g, h] = self.name.to_bytes();
        [a, b, c, d, e, f, g, h, self.address.get()]
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    const MANUAL: [u8; 8] = [0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20];

    #[test]
    fn the_name_of_the_manual() {
        let fields = Fields {
            arbitrary_address_capable: false,
            industry_group: 2,
            vehicle_system_instance: 0,
            vehicle_system: 1,
            function: 255,
            function_instance: 1,
            ecu_instance: 0,
            manufacturer_code: 57,
            identity_number: 1,
        };
        assert_eq!(Name::new(&fields).to_bytes(), MANUAL);
        assert_eq!(Name::from_bytes(MANUAL).fields(), fields);
    }

    #[test]
    fn every_field_has_its_bits() {
        let all = Fields {
            arbitrary_address_capable: true,
            industry_group: 0xFF,
            vehicle_system_instance: 0xFF,
            vehicle_system: 0xFF,
            function: 0xFF,
            function_instance: 0xFF,
            ecu_instance: 0xFF,
            manufacturer_code: 0xFFFF,
            identity_number: 0xFFFF_FFFF,
        };
        assert_eq!(Name::new(&all).to_bytes(), [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFE, 0xFF]);
        let none = Fields::default();
        for (fields, raw) in [
            (Fields { arbitrary_address_capable: true, ..none }, 0x8000_0000_0000_0000),
            (Fields { industry_group: 0xFF, ..none }, 0x7000_0000_0000_0000),
            (Fields { vehicle_system_instance: 0xFF, ..none }, 0x0F00_0000_0000_0000),
            (Fields { vehicle_system: 0xFF, ..none }, 0x00FE_0000_0000_0000),
            (Fields { function: 0xFF, ..none }, 0x0000_FF00_0000_0000),
            (Fields { function_instance: 0xFF, ..none }, 0x0000_00F8_0000_0000),
            (Fields { ecu_instance: 0xFF, ..none }, 0x0000_0007_0000_0000),
            (Fields { manufacturer_code: 0xFFFF, ..none }, 0x0000_0000_FFE0_0000),
            (Fields { identity_number: u32::MAX, ..none }, 0x0000_0000_001F_FFFF),
        ] {
            assert_eq!(Name::new(&fields).raw(), raw, "{fields:?}");
        }
    }

    #[test]
    fn the_lower_name_is_less_and_the_reserved_bit_counts() {
        let name = Name::from_bytes(MANUAL);
        let mut other = MANUAL;
        other[0] = 2;
        assert!(name < Name::from_bytes(other));
        let mut other = MANUAL;
        other[7] = 0x1F;
        assert!(Name::from_bytes(other) < name);
        let mut other = MANUAL;
        other[6] = 0x03;
        assert!(name < Name::from_bytes(other));
        assert_eq!(Name::from_bytes(other).to_bytes(), other);
    }

    #[test]
    fn claims_as_the_manual_prints_them() {
        let name = Name::from_bytes(MANUAL);
        assert_eq!(name.claim(Address::new(0x83)).to_string(), "18EEFF83: 01 00 20 07 08 FF 02 20");
        assert_eq!(name.claim(Address::NULL).to_string(), "18EEFFFE: 01 00 20 07 08 FF 02 20");
    }

    #[test]
    fn the_commanded_address_of_the_manual() {
        let payload = [0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20, 0x81];
        let command = CommandedAddress { name: Name::from_bytes(MANUAL), address: Address::new(0x81) };
        assert_eq!(CommandedAddress::parse(&payload), Some(command));
        assert_eq!(command.emit(), payload);
        assert_eq!(CommandedAddress::parse(&payload[..8]), None);
        assert_eq!(CommandedAddress::parse(&[0; 10]), None);
        assert_eq!(CommandedAddress::parse(&[]), None);
    }
}
