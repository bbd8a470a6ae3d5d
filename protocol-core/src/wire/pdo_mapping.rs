//! A PDO mapping entry, 0x1600 and 0x1A00 (CiA 301 7.5.2.36): the mapped object and its length in bits.

/// A PDO mapping entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MappingEntry {
    /// The index of the mapped object.
    pub index: u16,
    /// The sub-index of the mapped object.
    pub sub: u8,
    /// The length of the mapped object, in bits.
    pub bits: u8,
}

impl MappingEntry {
    /// An unused entry, beyond the number of mapped objects (A).
    ///
    /// CiA 301 does not define this value. Configuration tools clear all entries with this value before they write new
    /// entries. It is also the default of entries 2 to 8 of a HAT.
    pub const UNUSED: Self = Self::parse(0);

    /// Decodes an entry from the value of its object.
    #[must_use]
    pub const fn parse(raw: u32) -> Self {
        Self { index: (raw >> 16) as u16, sub: (raw >> 8) as u8, bits: raw as u8 }
    }

    /// Encodes the entry as the value of its object.
    #[must_use]
    pub const fn emit(self) -> u32 {
        (self.index as u32) << 16 | (self.sub as u32) << 8 | self.bits as u32
    }

    /// Returns whether the entry is a valid dummy: a gap in the PDO, described by the index (0x0001–0x0007) and the
    /// length of a data type (CiA 301 7.4.7.1).
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
