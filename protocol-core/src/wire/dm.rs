//! Diagnostic messages DM1 and DM2: the lamp status, then trouble codes with their occurrence counts (SAE J1939-73
//! 5.7.1 and 5.7.2; SPEC 5).

use heapless::Vec;

use super::dtc::Dtc;

/// The lamp status of a diagnostic message. Values are ordered by severity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Lamp(u8);

impl Lamp {
    /// No lamp: no fault.
    pub const OFF: Self = Self(0x00);
    /// Amber warning lamp.
    pub const AMBER: Self = Self(0x04);
    /// Red stop lamp.
    pub const RED: Self = Self(0x10);

    /// Creates a lamp status from any byte.
    #[must_use]
    pub const fn new(raw: u8) -> Self {
        Self(raw)
    }

    /// Returns the lamp status as the byte on the bus.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }
}

/// The maximum occurrence count.
pub const MAX_COUNT: u8 = 127;

/// The second byte of a message, the flash status of the lamps: always "not available".
const FLASH_STATUS: u8 = 0xFF;

/// The fill byte after the trouble code in a single frame.
const FILL: u8 = 0xFF;

/// The number of bytes before the first trouble code: lamp status and flash status.
const HEAD: usize = 2;

/// The number of bytes of a trouble code with its occurrence count.
const TROUBLE_LEN: usize = 4;

/// Returns the length of a payload with this many trouble codes.
#[must_use]
pub const fn payload_len(troubles: usize) -> usize {
    troubles.saturating_mul(TROUBLE_LEN).saturating_add(HEAD)
}

/// A trouble code, its occurrence count, and its lamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trouble {
    /// The lamp that the fault lights.
    pub lamp: Lamp,
    /// The code.
    pub dtc: Dtc,
    /// The occurrence count. Values above [`MAX_COUNT`] are sent as [`MAX_COUNT`].
    pub count: u8,
}

impl Trouble {
    /// Encodes the code and its count; the conversion method, the top bit, is 0.
    const fn emit(self) -> [u8; TROUBLE_LEN] {
        let [low, middle, high] = self.dtc.to_bytes();
        let count = if self.count > MAX_COUNT { MAX_COUNT } else { self.count };
        [low, middle, high, count]
    }
}

/// Encodes a message with at most one trouble code as a single frame.
#[must_use]
pub const fn single(trouble: Option<Trouble>) -> [u8; 8] {
    match trouble {
        Some(trouble) => {
            let [low, middle, high, count] = trouble.emit();
            [trouble.lamp.0, FLASH_STATUS, low, middle, high, count, FILL, FILL]
        }
        None => [Lamp::OFF.0, FLASH_STATUS, 0, 0, 0, 0, FILL, FILL],
    }
}

/// Encodes a message with these trouble codes for the transport protocol. The lamp is the most severe lamp of all
/// codes. Codes that do not fit into `N` bytes, see [`payload_len`], are left out.
#[must_use]
pub fn payload<const N: usize>(troubles: impl Iterator<Item = Trouble> + Clone) -> Vec<u8, N> {
    let lamp = troubles.clone().map(|trouble| trouble.lamp).max().unwrap_or(Lamp::OFF);
    let mut payload = Vec::new();
    let mut room = payload.extend_from_slice(&[lamp.0, FLASH_STATUS]).is_ok();
    for trouble in troubles {
        room = room && payload.extend_from_slice(&trouble.emit()).is_ok();
    }
    payload
}

/// Decodes the lamp and the trouble codes of a single frame or a transport protocol payload. Returns `None` for a
/// payload that is too short for a trouble code.
pub fn parse(payload: &[u8]) -> Option<(Lamp, impl Iterator<Item = (Dtc, u8)>)> {
    let &[lamp, _, ref troubles @ ..] = payload else { return None };
    let (troubles, _) = troubles.as_chunks::<TROUBLE_LEN>();
    let codes = troubles
        .iter()
        .map(|&[low, middle, high, count]| (Dtc::from_bytes([low, middle, high]), count & MAX_COUNT))
        .filter(|(dtc, _)| *dtc != Dtc::NONE);
    (!troubles.is_empty()).then_some((Lamp(lamp), codes))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec;
    use std::vec::Vec;

    use super::*;

    const SUPPLY_LOW: Trouble = Trouble { lamp: Lamp::AMBER, dtc: Dtc::from_printed(0x040273), count: 1 };
    const NOT_AT_SET_POINT: Trouble = Trouble { lamp: Lamp::RED, dtc: Dtc::from_printed(0x878FEC), count: 127 };
    const NONE: [u8; 8] = [0x00, 0xFF, 0, 0, 0, 0, 0xFF, 0xFF];

    fn read(payload: &[u8]) -> Option<(u8, Vec<(u32, u8)>)> {
        let (lamp, troubles) = parse(payload)?;
        Some((lamp.get(), troubles.map(|(dtc, count)| (dtc.printed(), count)).collect()))
    }

    #[test]
    fn single_frames_as_the_manual_prints_them() {
        assert_eq!(single(Some(SUPPLY_LOW)), [0x04, 0xFF, 0x73, 0x02, 0x04, 0x01, 0xFF, 0xFF]);
        assert_eq!(single(Some(NOT_AT_SET_POINT)), [0x10, 0xFF, 0xEC, 0x8F, 0x87, 0x7F, 0xFF, 0xFF]);
        assert_eq!(single(None), NONE);
    }

    #[test]
    fn payloads_as_the_manual_prints_them() {
        let bytes = [0x10, 0xFF, 0xEC, 0x8F, 0x87, 0x7F, 0x73, 0x02, 0x04, 0x01];
        assert_eq!(payload::<{ payload_len(2) }>([NOT_AT_SET_POINT, SUPPLY_LOW].into_iter()), bytes);
        assert_eq!(payload::<34>(core::iter::empty()), [0x00, 0xFF]);
    }

    #[test]
    fn the_lamp_is_the_most_severe() {
        assert_eq!(payload::<34>([SUPPLY_LOW, NOT_AT_SET_POINT, SUPPLY_LOW].into_iter()).first(), Some(&0x10));
        assert_eq!(payload::<34>([SUPPLY_LOW, SUPPLY_LOW].into_iter()).first(), Some(&0x04));
    }

    #[test]
    fn whole_codes_or_none() {
        assert_eq!(payload::<9>([SUPPLY_LOW, NOT_AT_SET_POINT].into_iter()), [0x10, 0xFF, 0x73, 0x02, 0x04, 0x01]);
        assert_eq!(payload::<1>([SUPPLY_LOW].into_iter()), []);
    }

    #[test]
    fn a_counter_stays_within_seven_bits() {
        assert_eq!(single(Some(Trouble { count: 200, ..SUPPLY_LOW }))[5], 127);
        assert_eq!(read(&[4, 0xFF, 0x73, 0x02, 0x04, 0x81, 0xFF, 0xFF]), Some((4, vec![(0x040273, 1)])));
    }

    #[test]
    fn both_forms_are_read_back() {
        assert_eq!(read(&single(Some(SUPPLY_LOW))), Some((0x04, vec![(0x040273, 1)])));
        assert_eq!(read(&single(None)), Some((0x00, vec![])));
        let several = payload::<34>([NOT_AT_SET_POINT, SUPPLY_LOW].into_iter());
        assert_eq!(read(&several), Some((0x10, vec![(0x878FEC, 127), (0x040273, 1)])));
        for short in 0..6 {
            assert_eq!(read(&NONE[..short]), None);
        }
    }
}
