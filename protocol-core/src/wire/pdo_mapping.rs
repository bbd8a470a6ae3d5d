//! An entry of a PDO mapping, 0x1600 and 0x1A00 (CiA 301 7.5.2.36): which object lies in the PDO, and with how many
//! bits.

/// An entry of a PDO mapping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MappingEntry {
    /// Index of the mapped object.
    pub index: u16,
    /// Sub-index of the mapped object.
    pub sub: u8,
    /// Length in bits.
    pub bits: u8,
}

impl MappingEntry {
    /// The entry that maps nothing, beyond the number of mapped objects (A).
    ///
    /// CiA 301 does not name it. Configuration tools write it into all entries before they write the new ones, and a HAT
    /// has it for a default.
    pub const UNUSED: Self = Self::parse(0);

    /// Returns the entry in 32 bits: index, sub-index, length.
    #[must_use]
    pub const fn parse(raw: u32) -> Self {
        Self { index: (raw >> 16) as u16, sub: (raw >> 8) as u8, bits: raw as u8 }
    }

    /// Returns the entry as the object holds it.
    #[must_use]
    pub const fn emit(self) -> u32 {
        (self.index as u32) << 16 | (self.sub as u32) << 8 | self.bits as u32
    }

    /// Returns whether it is a dummy: an index 0x0001–0x0007 stands for a data type, the entry for a gap of that type's
    /// length (CiA 301 7.4.7.1).
    #[must_use]
    pub const fn is_valid_dummy(self) -> bool {
        let bits = match self.index {
            0x0001 => 1,
            0x0002 | 0x0005 => 8,
            0x0003 | 0x0006 => 16,
            0x0004 | 0x0007 => 32,
            _ => return false,
        };
        self.sub == 0 && self.bits == bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_as_the_manual_prints_them() {
        let entry = MappingEntry::parse(0x6300_0110);
        assert_eq!(entry, MappingEntry { index: 0x6300, sub: 1, bits: 16 });
        assert_eq!(entry.emit(), 0x6300_0110);
        assert!(!entry.is_valid_dummy());
    }

    #[test]
    fn dummies_have_the_length_of_their_type() {
        for raw in [0x0001_0001, 0x0002_0008, 0x0003_0010, 0x0004_0020, 0x0005_0008, 0x0006_0010, 0x0007_0020] {
            assert!(MappingEntry::parse(raw).is_valid_dummy(), "{raw:08X}");
        }
        for raw in [0x0000_0001, 0x0001_0008, 0x0001_0101, 0x0005_0010, 0x0008_0020] {
            assert!(!MappingEntry::parse(raw).is_valid_dummy(), "{raw:08X}");
        }
    }
}
