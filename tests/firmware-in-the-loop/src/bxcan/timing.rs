//! The bit timing (RM0090 32.7.7).

use super::registers::btr;

/// The length of a bit, and the sample point in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitTiming {
    /// The number of cycles of the peripheral clock in a time quantum.
    pub prescaler: u32,
    /// The number of time quanta from the start of the bit to the sample point.
    pub to_sample: u32,
    /// The number of time quanta in a bit.
    pub quanta: u32,
    /// The maximum number of time quanta by which a bit is lengthened or shortened, to follow the clock of another
    /// node.
    pub jump_width: u32,
}

impl BitTiming {
    /// Decodes a value of [`BTR`](super::registers::BTR).
    #[must_use]
    pub const fn of(register: u32) -> Self {
        let to_sample = 1 + (register >> 16 & 0xF) + 1;
        let quanta = to_sample + (register >> 20 & 7) + 1;
        Self { prescaler: (register & 0x3FF) + 1, to_sample, quanta, jump_width: (register >> 24 & 3) + 1 }
    }

    /// Returns the bits per second with this peripheral clock, if they are a whole number.
    #[must_use]
    pub const fn bits_per_second(self, clock_hz: u64) -> Option<u64> {
        let cycles = self.prescaler as u64 * self.quanta as u64;
        if clock_hz.is_multiple_of(cycles) { Some(clock_hz / cycles) } else { None }
    }

    /// Returns the position of the sample point in the bit, in tenths of a percent.
    #[must_use]
    pub const fn sample_point(self) -> u32 {
        self.to_sample * 1000 / self.quanta
    }
}

/// Returns whether the controller hears itself instead of the bus.
pub(super) const fn is_loopback(register: u32) -> bool {
    register & btr::LBKM != 0
}

/// Returns whether the controller sends nothing dominant.
pub(super) const fn is_silent(register: u32) -> bool {
    register & btr::SILM != 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_segments_count_from_one() {
        let timing = BitTiming::of(0);
        assert_eq!((timing.prescaler, timing.to_sample, timing.quanta, timing.jump_width), (1, 2, 3, 1));
        let longest = BitTiming::of(0x037F_03FF);
        assert_eq!((longest.prescaler, longest.to_sample, longest.quanta, longest.jump_width), (1024, 17, 25, 4));
    }

    #[test]
    fn a_rate_that_does_not_divide_is_none() {
        assert_eq!(BitTiming::of(0x001C_0004).bits_per_second(40_000_000), Some(500_000));
        assert_eq!(BitTiming::of(0x001C_0004).bits_per_second(42_000_000), Some(525_000));
        assert_eq!(BitTiming::of(0x0023_0000).bits_per_second(40_000_000), Some(5_000_000));
        assert_eq!(BitTiming::of(0x001C_0006).bits_per_second(40_000_000), None);
    }

    #[test]
    fn the_sample_point_is_before_segment_2() {
        assert_eq!(BitTiming::of(0x001C_0004).sample_point(), 875);
        assert_eq!(BitTiming::of(0x0007_0004).sample_point(), 900);
    }
}
