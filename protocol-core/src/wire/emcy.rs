//! Emergency messages (CiA 301 7.2.7).

/// The emergency error code "no error": an error reset.
pub const NO_ERROR: u16 = 0x0000;

/// The emergency error code of a generic error. The EMCY consumer of a valve treats it as an emergency stop (SPEC 4.2).
pub const GENERIC_ERROR: u16 = 0x1000;

/// An emergency message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Emcy {
    /// The emergency error code; [`NO_ERROR`] for an error reset.
    pub code: u16,
    /// The error register, 0x1001.
    pub register: u8,
    /// The manufacturer-specific field.
    pub manufacturer: [u8; 5],
}

impl Emcy {
    /// Decodes the message from eight data bytes.
    #[must_use]
    pub fn parse(bytes: &[u8; 8]) -> Self {
        let &[low, high, register, ref manufacturer @ ..] = bytes;
        Self { code: u16::from_le_bytes([low, high]), register, manufacturer: *manufacturer }
    }

    /// Encodes the message as eight data bytes.
    #[must_use]
    pub const fn emit(self) -> [u8; 8] {
        let [low, high] = self.code.to_le_bytes();
        let [a, b, c, d, e] = self.manufacturer;
        [low, high, self.register, a, b, c, d, e]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_low_supply_as_the_manual_prints_it() {
        let bytes = [0x12, 0x34, 0x05, 0x0F, 0, 0, 0, 0];
        let emcy = Emcy { code: 0x3412, register: 0x05, manufacturer: [0x0F, 0, 0, 0, 0] };
        assert_eq!(Emcy::parse(&bytes), emcy);
        assert_eq!(emcy.emit(), bytes);
        assert_eq!(Emcy::default().emit(), [0; 8]);
    }
}
