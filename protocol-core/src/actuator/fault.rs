//! The faults of the valve, and sets of them (SPEC 2).

/// A fault of the valve, numbered by priority (SPEC 2, table of the monitors).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Fault {
    /// The spool deviates from its set-point.
    SpoolNotAtSetPoint = 1,
    /// The spool does not reach the float position.
    FloatNotReached = 2,
    /// The internal error, see [`InternalCause`].
    Internal = 3,
    /// The CAN controller is bus-off.
    CanBus = 4,
    /// The temperature is too high or too low.
    Temperature = 5,
    /// The supply voltage is too high.
    SupplyHigh = 6,
    /// The supply voltage is too low.
    SupplyLow = 7,
    /// No valid set-point arrived within the guard time.
    TimeGuarding = 8,
}

impl Fault {
    /// All faults, the highest priority first.
    pub const ALL: [Self; 8] = [
        Self::SpoolNotAtSetPoint,
        Self::FloatNotReached,
        Self::Internal,
        Self::CanBus,
        Self::Temperature,
        Self::SupplyHigh,
        Self::SupplyLow,
        Self::TimeGuarding,
    ];

    /// Returns the priority, from 1 (highest) to 8.
    #[inline]
    #[must_use]
    pub const fn priority(self) -> u8 {
        self as u8
    }

    /// Returns the name of the fault, which all interfaces use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SpoolNotAtSetPoint => "spool-not-at-set-point",
            Self::FloatNotReached => "float-not-reached",
            Self::Internal => "internal",
            Self::CanBus => "can-bus",
            Self::Temperature => "temperature",
            Self::SupplyHigh => "supply-high",
            Self::SupplyLow => "supply-low",
            Self::TimeGuarding => "time-guarding",
        }
    }

    /// Returns whether the fault concerns the spool position.
    #[must_use]
    pub const fn is_of_spool(self) -> bool {
        matches!(self, Self::SpoolNotAtSetPoint | Self::FloatNotReached)
    }

    /// Returns the index of the fault in [`ALL`](Self::ALL).
    pub(crate) const fn index(self) -> usize {
        (self as usize).wrapping_sub(1)
    }
}

/// A set of faults.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct FaultSet(u8);

impl FaultSet {
    /// The empty set.
    pub const EMPTY: Self = Self(0);
    /// All eight faults.
    pub const ALL: Self = Self(0xFF);

    /// Creates a set of one fault.
    #[must_use]
    pub const fn of(fault: Fault) -> Self {
        Self(1_u8.wrapping_shl(fault.index() as u32))
    }

    /// Creates a set from bits: bit 0 is the fault of priority 1, bit 7 the fault of priority 8.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }

    /// Returns the set as bits, see [`from_bits`](Self::from_bits).
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Returns whether the set is empty.
    #[inline]
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns the number of faults.
    #[must_use]
    pub const fn len(self) -> u32 {
        self.0.count_ones()
    }

    /// Returns whether the set contains a fault.
    #[inline]
    #[must_use]
    pub const fn contains(self, fault: Fault) -> bool {
        self.0 & Self::of(fault).0 != 0
    }

    /// Returns the faults in either set.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns the faults in both sets.
    #[must_use]
    pub const fn intersection(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Returns the faults of this set that are not in `other`.
    #[must_use]
    pub const fn difference(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Adds a fault.
    pub const fn insert(&mut self, fault: Fault) {
        *self = self.union(Self::of(fault));
    }

    /// Removes a fault.
    pub const fn remove(&mut self, fault: Fault) {
        *self = self.difference(Self::of(fault));
    }

    /// Returns the fault with the highest priority; `None` if the set is empty.
    #[must_use]
    pub fn highest(self) -> Option<Fault> {
        self.into_iter().next()
    }
}

impl IntoIterator for FaultSet {
    type Item = Fault;
    type IntoIter = FaultIter;

    fn into_iter(self) -> FaultIter {
        FaultIter(self)
    }
}

impl FromIterator<Fault> for FaultSet {
    fn from_iter<I: IntoIterator<Item = Fault>>(faults: I) -> Self {
        faults.into_iter().fold(Self::EMPTY, |set, fault| set.union(Self::of(fault)))
    }
}

/// The faults of a set, highest priority first.
#[derive(Clone, Debug)]
pub struct FaultIter(FaultSet);

impl Iterator for FaultIter {
    type Item = Fault;

    fn next(&mut self) -> Option<Fault> {
        let FaultSet(bits) = self.0;
        let fault = *Fault::ALL.get(bits.trailing_zeros() as usize)?;
        self.0 = FaultSet(bits & bits.wrapping_sub(1));
        Some(fault)
    }
}

/// A cause of the internal error (SPEC 2, a fault's life; SPEC 6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InternalCause {
    /// The user has injected the internal error.
    Injected,
    /// The watchdog reset the processor. The caller clears the cause once the internal error has been reported.
    Watchdog,
    /// The entire memory is damaged. The cause lasts until the next start.
    Memory,
    /// The record with this number, 0–7, is corrupt or could not be written. The cause lasts until the record is
    /// written. Numbers above 7 count as 7.
    Record(u8),
}

/// A set of causes of the internal error.
#[derive(Clone, Copy, Debug)]
pub(super) struct InternalCauses(u16);

impl InternalCauses {
    pub(super) const NONE: Self = Self(0);

    pub(super) fn set(&mut self, cause: InternalCause, present: bool) {
        let bit = match cause {
            InternalCause::Injected => 0x0001,
            InternalCause::Watchdog => 0x0002,
            InternalCause::Memory => 0x0004,
            InternalCause::Record(record) => 0x0100_u16.wrapping_shl(u32::from(record.min(7))),
        };
        self.0 = if present { self.0 | bit } else { self.0 & !bit };
    }

    pub(super) const fn any(self) -> bool {
        self.0 != 0
    }
}

pub(super) const SPOOL_FAULTS: FaultSet =
    FaultSet::of(Fault::SpoolNotAtSetPoint).union(FaultSet::of(Fault::FloatNotReached));

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_is_told_by_priority() {
        let set: FaultSet = [Fault::TimeGuarding, Fault::Internal, Fault::SpoolNotAtSetPoint].into_iter().collect();
        assert!(set.into_iter().eq([Fault::SpoolNotAtSetPoint, Fault::Internal, Fault::TimeGuarding]));
        assert_eq!(set.highest(), Some(Fault::SpoolNotAtSetPoint));
        assert_eq!(set.bits(), 0b1000_0101);
        assert_eq!(set.len(), 3);
        assert_eq!(FaultSet::EMPTY.highest(), None);
        assert!(FaultSet::ALL.into_iter().eq(Fault::ALL));
        assert!(Fault::ALL.into_iter().map(Fault::priority).eq(1..=8));
    }

    #[test]
    fn every_internal_cause_is_its_own() {
        let causes = (0..8).map(InternalCause::Record).chain([
            InternalCause::Injected,
            InternalCause::Watchdog,
            InternalCause::Memory,
        ]);
        let mut all = InternalCauses::NONE;
        causes.clone().for_each(|cause| all.set(cause, true));
        for cause in causes {
            assert!(all.any());
            all.set(cause, false);
        }
        assert!(!all.any());
    }
}
