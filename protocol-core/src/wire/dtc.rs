//! Diagnostic trouble codes (SAE J1939-73 5.7.1; SPEC 3).

/// A diagnostic trouble code in 24 bits: the suspect parameter (SPN) and its failure mode (FMI).
///
/// (R) The manual prints a code as one number, which is the three bytes on the bus in reverse order (SPEC 3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Dtc(u32);

impl Dtc {
    /// No trouble code: three bytes of 0.
    pub const NONE: Self = Self(0);

    /// Creates a code from the low 19 bits of a suspect parameter number and the low 5 bits of a failure mode
    /// identifier.
    #[must_use]
    pub const fn new(spn: u32, fmi: u8) -> Self {
        Self((spn & 0x7_0000) << 5 | (fmi as u32 & 0x1F) << 16 | spn & 0xFFFF)
    }

    /// Creates a code from the low 24 bits of the number that the manual prints.
    #[must_use]
    pub const fn from_printed(number: u32) -> Self {
        Self(number & 0xFF_FFFF)
    }

    /// Returns the number that the manual prints.
    #[must_use]
    pub const fn printed(self) -> u32 {
        self.0
    }

    /// Returns the suspect parameter number.
    #[must_use]
    pub const fn spn(self) -> u32 {
        self.0 >> 5 & 0x7_0000 | self.0 & 0xFFFF
    }

    /// Returns the failure mode identifier.
    #[must_use]
    pub const fn fmi(self) -> u8 {
        (self.0 >> 16) as u8 & 0x1F
    }

    /// Decodes the three bytes on the bus.
    #[must_use]
    pub const fn from_bytes([low, middle, high]: [u8; 3]) -> Self {
        Self(u32::from_le_bytes([low, middle, high, 0]))
    }

    /// Encodes the three bytes on the bus.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; 3] {
        let [low, middle, high, _] = self.0.to_le_bytes();
        [low, middle, high]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_codes_of_the_manual() {
        for (printed, spn, fmi, bytes) in [
            (0x878FEC, 298_988, 7, [0xEC, 0x8F, 0x87]),
            (0x878FEE, 298_990, 7, [0xEE, 0x8F, 0x87]),
            (0x8B8FFA, 299_002, 11, [0xFA, 0x8F, 0x8B]),
            (0x938FD7, 298_967, 19, [0xD7, 0x8F, 0x93]),
            (0x908FF1, 298_993, 16, [0xF1, 0x8F, 0x90]),
            (0x030273, 627, 3, [0x73, 0x02, 0x03]),
            (0x040273, 627, 4, [0x73, 0x02, 0x04]),
            (0x938FE9, 298_985, 19, [0xE9, 0x8F, 0x93]),
        ] {
            let dtc = Dtc::new(spn, fmi);
            assert_eq!(dtc.printed(), printed);
            assert_eq!(dtc.to_bytes(), bytes);
            assert_eq!(Dtc::from_bytes(bytes), dtc);
            assert_eq!(Dtc::from_printed(printed), dtc);
            assert_eq!((dtc.spn(), dtc.fmi()), (spn, fmi));
        }
    }

    #[test]
    fn bits_beyond_the_fields_are_left_out() {
        assert_eq!(Dtc::new(u32::MAX, u8::MAX).to_bytes(), [0xFF; 3]);
        assert_eq!((Dtc::from_bytes([0xFF; 3]).spn(), Dtc::from_bytes([0xFF; 3]).fmi()), (0x7_FFFF, 0x1F));
        assert_eq!(Dtc::new(u32::MAX, 0).to_bytes(), [0xFF, 0xFF, 0xE0]);
        assert_eq!(Dtc::new(0, u8::MAX).to_bytes(), [0, 0, 0x1F]);
        assert_eq!(Dtc::from_printed(0xFF00_0000), Dtc::NONE);
    }
}
