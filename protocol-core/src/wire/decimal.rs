//! Decimal numbers in ASCII.

use heapless::Vec;

/// The maximum number of digits of a u32.
pub const DIGITS: usize = 10;

/// The highest power of ten that fits a u32.
const HIGHEST: u32 = 1_000_000_000;

/// Returns the digits of a number without leading zeros.
#[must_use]
pub fn decimal(number: u32) -> Vec<u8, DIGITS> {
    let mut digits = Vec::new();
    let mut unit = HIGHEST;
    // The loop ends when `unit` is 0, where `checked_div` returns `None`.
    while let Some(leading) = number.checked_div(unit) {
        if leading != 0 || unit == 1 {
            // There is room: at most one digit per unit.
            let _ = digits.push(b'0' | (leading % 10) as u8);
        }
        unit /= 10;
    }
    digits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_length() {
        for (number, digits) in [
            (0, "0"),
            (7, "7"),
            (10, "10"),
            (909, "909"),
            (24_000, "24000"),
            (999_999_999, "999999999"),
            (1_000_000_000, "1000000000"),
            (u32::MAX, "4294967295"),
        ] {
            assert_eq!(decimal(number), digits.as_bytes());
        }
    }
}
