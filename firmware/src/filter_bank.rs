//! The encoding of filters as filter banks of bxCAN: 32-bit scale, mask mode (RM0090 32.7.4).

use protocol_core::controller::{FILTERS, Filter, Filters};
use protocol_core::frame::{extended, key, standard};

/// The number of filter banks that CAN 1 has after a reset (RM0090, CAN2SB).
pub const BANKS: usize = 14;

const _: () = assert!(FILTERS <= BANKS);

/// The lowest bit of an 11-bit identifier in an identifier register.
const STID: u32 = 21;
/// The lowest bit of a 29-bit identifier in an identifier register.
const EXID: u32 = 3;
/// The bit that marks a 29-bit identifier.
const IDE: u32 = 1 << 2;
/// The bit that marks a remote frame.
const RTR: u32 = 1 << 1;

/// The registers of a filter bank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bank {
    /// The value with which the identifier register of a frame is compared.
    pub identifier: u32,
    /// The compared bits of the identifier register.
    pub mask: u32,
}

impl Bank {
    /// Creates the bank that passes the same data frames as a filter.
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

/// Returns the next change towards the wanted filters: the number of a bank and its new contents, or `None` to make the
/// bank inactive.
///
/// A bank is inactive while it changes. A filter that is still wanted keeps its bank, and new filters are added before
/// old filters are removed. An identifier that is wanted before and after the change is therefore received throughout.
/// A new filter replaces an old filter only if no bank is free.
#[must_use]
pub fn next_change(held: &[Option<Bank>; BANKS], wanted: &Filters) -> Option<(usize, Option<Bank>)> {
    let is_held = |bank: &Bank| held.contains(&Some(*bank));
    let is_old = |held: &Option<Bank>| held.is_some_and(|bank| wanted.iter().all(|filter| Bank::of(filter) != bank));
    let position = |is: &dyn Fn(&Option<Bank>) -> bool| held.iter().position(is);
    let old = position(&is_old);
    match wanted.iter().map(Bank::of).find(|bank| !is_held(bank)) {
        Some(new) => position(&Option::is_none).or(old).map(|number| (number, Some(new))),
        None => old.map(|number| (number, None)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Changes the banks to the wanted filters; `step` receives the banks at each intermediate state.
    fn change(held: &mut [Option<Bank>; BANKS], wanted: &[u32], step: &mut dyn FnMut(&[Option<Bank>; BANKS])) {
        let wanted: Filters = wanted.iter().map(|key| Filter::exactly(*key)).collect();
        for _ in 0..2 * BANKS {
            let Some((place, bank)) = next_change(held, &wanted) else {
                let held = held.iter().flatten().count();
                assert_eq!(held, wanted.len());
                return;
            };
            held[place] = None;
            step(held);
            held[place] = bank;
        }
        panic!("there is no end");
    }

    #[test]
    fn a_filter_that_stays_is_never_off() {
        let mut held = [None; BANKS];
        let sets: [&[u32]; 6] =
            [&[1, 2, 3, 4, 5], &[1, 9, 2, 3, 4, 5], &[2, 3, 5], &[5, 3, 2, 1], &[1, 2, 3, 4, 5, 6, 7, 8], &[8]];
        let mut before: &[u32] = &[];
        for after in sets {
            let stay = |key: &&u32| before.contains(key) && after.contains(key);
            let stay: heapless::Vec<Bank, 8> =
                after.iter().filter(stay).map(|key| Bank::of(&Filter::exactly(*key))).collect();
            change(&mut held, after, &mut |held| {
                assert!(stay.iter().all(|bank| held.contains(&Some(*bank))), "{before:?} to {after:?}");
            });
            before = after;
        }
    }

    #[test]
    fn all_filters_change_at_once() {
        let mut held = [None; BANKS];
        change(&mut held, &[1, 2, 3, 4, 5, 6, 7, 8], &mut |_| {});
        change(&mut held, &[11, 12, 13, 14, 15, 16, 17, 18], &mut |_| {});
        let wanted = [11, 12, 13, 14, 15, 16, 17, 18].map(|key| Bank::of(&Filter::exactly(key)));
        assert!(wanted.iter().all(|bank| held.contains(&Some(*bank))));
    }

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
