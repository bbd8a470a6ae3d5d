//! The acceptance filter of the commands `M` and `m`: that of an SJA1000 with two filters, of which one has to accept.
//!
//! | bits of code and mask | 11-bit identifier | 29-bit identifier |
//! | --- | --- | --- |
//! | 31–16 | filter 1: identifier, RTR, and the upper half of the first data byte | filter 1: bits 28–13 |
//! | 15–4 | filter 2: identifier, RTR | filter 2: bits 28–13, with the next |
//! | 3–0 | filter 1: the lower half of the first data byte | |

use protocol_core::frame::{Frame, Id};

/// A code, and the mask of those of its bits that do not matter. The default lets everything through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Filter {
    pub(super) code: u32,
    pub(super) mask: u32,
}

impl Default for Filter {
    fn default() -> Self {
        Self { code: 0, mask: u32::MAX }
    }
}

impl Filter {
    /// Returns whether the client gets this frame.
    pub(super) fn accepts(self, frame: &Frame) -> bool {
        // What filter 1 and filter 2 look at, and in which bits.
        let (seen, cared) = match (frame.id(), frame.data().first()) {
            (Id::Extended(id), _) => {
                let head = id.as_raw() >> 13;
                (head << 16 | head, [0xFFFF_0000, 0x0000_FFFF])
            }
            (Id::Standard(id), byte) => {
                let head = u32::from(id.as_raw()) << 5 | u32::from(frame.is_remote()) << 4;
                let (byte, byte_cared) = byte.map_or((0, 0), |byte| (u32::from(*byte), 0x000F_000F));
                let data = (byte >> 4) << 16 | byte & 0xF;
                (head << 16 | head | data, [0xFFF0_0000 | byte_cared, 0x0000_FFF0])
            }
        };
        cared.iter().any(|cared| (seen ^ self.code) & !self.mask & cared == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passes(code: u32, mask: u32, frame: &str) -> bool {
        Filter { code, mask }.accepts(&frame.parse().expect(frame))
    }

    #[test]
    fn everything_passes_at_first() {
        for frame in ["000:", "7FF: FF", "1FFFFFFF: 00", "123: R"] {
            let Ok(frame) = frame.parse() else { continue };
            assert!(Filter::default().accepts(&frame), "{frame}");
        }
    }

    #[test]
    fn one_identifier_in_each_of_the_two_filters() {
        // 1A0 in filter 1, 720 in filter 2; RTR and data do not matter
        let (code, mask) = (0x1A0 << 21 | 0x720 << 5, 0x001F_001F);
        assert!(passes(code, mask, "1A0: 09 00"));
        assert!(passes(code, mask, "720: 05"));
        assert!(!passes(code, mask, "1A1: 09 00"));
        assert!(!passes(code, mask, "721:"));
    }

    #[test]
    fn the_first_data_byte_counts_where_there_is_one() {
        let (code, mask) = (0x5A0 << 21 | 0x0004_0003, 0x0010_0010);
        assert!(passes(code, mask, "5A0: 43 18"));
        assert!(!passes(code, mask, "5A0: 44 18"));
        assert!(passes(code, mask, "5A0:"));
    }

    #[test]
    fn remote_frames_can_be_told_from_data() {
        let remote = Frame::remote(protocol_core::frame::standard(0x123).into(), 1);
        let code = 0x123 << 21 | 1 << 20 | 0x123 << 5 | 1 << 4;
        assert!(Filter { code, mask: 0x000F_000F }.accepts(&remote));
        assert!(!passes(code, 0x000F_000F, "123: 01"));
    }

    #[test]
    fn the_upper_half_of_a_29_bit_identifier() {
        let (code, mask) = (0x18FE_CA83 >> 13 << 16, 0x0000_0000);
        assert!(passes(code, mask, "18FECA83: 00"));
        assert!(!passes(code, mask, "18EEFF83: 00"));
    }
}
