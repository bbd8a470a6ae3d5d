//! The bit timings of the CAN controller. A clock of 40 MHz yields every bit rate exactly.

use protocol_core::controller::BitRate;

/// The clock of the controller, APB1, in Hz.
pub const CLOCK: u32 = 40_000_000;

/// The timing of a bit, in time quanta.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitTiming {
    /// The number of clock cycles of a time quantum.
    pub prescaler: u32,
    /// The number of time quanta between the synchronisation segment and the sample point.
    pub segment_1: u32,
    /// The number of time quanta after the sample point.
    pub segment_2: u32,
}

impl BitTiming {
    /// Returns the timing for a bit rate. The sample point is at 87.5 %; at 800 kbit/s it is at 90 %.
    #[must_use]
    pub const fn of(bit_rate: BitRate) -> Self {
        let (prescaler, segment_1, segment_2) = match bit_rate {
            BitRate::Kbit10 => (250, 13, 2),
            BitRate::Kbit20 => (125, 13, 2),
            BitRate::Kbit50 => (50, 13, 2),
            BitRate::Kbit125 => (20, 13, 2),
            BitRate::Kbit250 => (10, 13, 2),
            BitRate::Kbit500 => (5, 13, 2),
            BitRate::Kbit800 => (5, 8, 1),
            BitRate::Kbit1000 => (5, 6, 1),
        };
        Self { prescaler, segment_1, segment_2 }
    }

    /// Returns the bit rate in bits per second.
    #[must_use]
    pub const fn bits_per_second(self) -> u32 {
        CLOCK / (self.prescaler * self.quanta())
    }

    /// Returns the synchronisation jump width in time quanta: 2, limited to phase segment 2.
    ///
    /// With 16 quanta per bit, a width of 2 tolerates a clock error of ±0.48 % per node. A width of 1 tolerates ±0.31
    /// %.
    #[must_use]
    pub const fn jump_width(self) -> u32 {
        if self.segment_2 < 2 { self.segment_2 } else { 2 }
    }

    /// Returns the value of the register BTR.
    #[must_use]
    pub const fn register(self) -> u32 {
        (self.jump_width() - 1) << 24 | (self.segment_2 - 1) << 20 | (self.segment_1 - 1) << 16 | (self.prescaler - 1)
    }

    const fn quanta(self) -> u32 {
        1 + self.segment_1 + self.segment_2
    }
}

const _: () = {
    let mut i = 0;
    while i < BitRate::ALL.len() {
        let timing = BitTiming::of(BitRate::ALL[i]);
        assert!(timing.bits_per_second() == BitRate::ALL[i].bits_per_second());
        assert!(CLOCK.is_multiple_of(timing.prescaler * timing.quanta()));
        i += 1;
    }
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_as_the_reference_manual_lays_them_out() {
        assert_eq!(BitTiming::of(BitRate::Kbit250).register(), 0x011C_0009);
        assert_eq!(BitTiming::of(BitRate::Kbit800).register(), 0x0007_0004);
        assert_eq!(BitTiming::of(BitRate::Kbit10).register(), 0x011C_00F9);
    }

    /// The oscillator tolerance of a node in parts per million: resynchronisation must compensate the drift of 10 bits,
    /// and after 13 bits an error flag must still be distinguishable from a shifted bit (Bosch, "The Configuration of
    /// the CAN Bit Timing").
    #[test]
    fn oscillators_may_differ_as_much_as_the_segments_allow() {
        for (rate, ppm) in
            [(BitRate::Kbit10, 4854), (BitRate::Kbit500, 4854), (BitRate::Kbit800, 3875), (BitRate::Kbit1000, 4854)]
        {
            let timing = BitTiming::of(rate);
            let by_jump = timing.jump_width() * 1_000_000 / (20 * timing.quanta());
            let by_segments = timing.segment_2 * 1_000_000 / (2 * (13 * timing.quanta() - timing.segment_2));
            assert_eq!(by_jump.min(by_segments), ppm, "{rate:?}");
            assert!(timing.jump_width() <= timing.segment_2, "{rate:?}: RM0090 32.7.7");
        }
    }
}
