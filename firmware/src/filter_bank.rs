//! A filter as a bank of the CAN controller holds it: one of 32 bits with a mask (RM0090 32.7.4).

use protocol_core::controller::{FILTERS, Filter};
use protocol_core::frame::{extended, key, standard};

/// How many banks CAN 1 has as long as nobody takes some for CAN 2.
pub const BANKS: usize = 14;

const _: () = assert!(FILTERS <= BANKS);

/// Where a standard identifier begins in an identifier register.
const STID: u32 = 21;
/// Where an extended identifier begins.
const EXID: u32 = 3;
/// Tells an extended identifier.
const IDE: u32 = 1 << 2;
/// Tells a remote frame.
const RTR: u32 = 1 << 1;

/// The registers of a bank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bank {
    /// What the identifier register of a frame is compared with.
    pub identifier: u32,
    /// The bits of it that count.
    pub mask: u32,
}

impl Bank {
    /// Lets through the data frames that a filter lets through.
    #[must_use]
    pub fn of(filter: &Filter) -> Self {
        let is_extended = filter.key & key(extended(0).into()) != 0;
        let (identifier, mask) = if is_extended {
            let bits = extended(u32::MAX).as_raw();
            ((filter.key & bits) << EXID | IDE, (filter.mask & bits) << EXID)
        } else {
            let bits = u32::from(standard(u16::MAX).as_raw());
            ((filter.key & bits) << STID, (filter.mask & bits) << STID)
        };
        Self { identifier, mask: mask | IDE | RTR }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_standard_identifier() {
        let bank = Bank::of(&Filter::exactly(0x220));
        assert_eq!(bank, Bank { identifier: 0x220 << 21, mask: 0xFFE0_0006 });
    }

    #[test]
    fn extended_identifiers_from_any_source() {
        let filter = Filter { key: key(extended(0x1BC0_0020).into()), mask: !(0x7FF << 11) };
        let bank = Bank::of(&filter);
        assert_eq!(bank, Bank { identifier: 0x1BC0_0020 << 3 | 4, mask: (0x1FC0_07FF << 3) | 6 });
    }
}
