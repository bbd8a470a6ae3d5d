//! A state file as text: rows of bytes in hex behind their place, without those that are erased.

use std::fmt::Write as _;

const ROW: usize = 32;
const ERASED: u8 = 0xFF;

/// The text of a file.
pub(crate) fn print(bytes: &[u8]) -> String {
    let mut text = format!("{} bytes, those that are not here are FF\n", bytes.len());
    for (number, row) in bytes.chunks(ROW).enumerate().filter(|(_, row)| row.iter().any(|byte| *byte != ERASED)) {
        let hex: String = row.iter().map(|byte| format!("{byte:02x}")).collect();
        let _ = writeln!(text, "{:05x} {hex}", number * ROW);
    }
    text
}

/// The file of a text.
pub(crate) fn parse(text: &str) -> Vec<u8> {
    let (size, rows) = text.split_once(" bytes, those that are not here are FF\n").expect("a size");
    let mut bytes = vec![ERASED; size.parse().expect("a number")];
    for row in rows.lines() {
        let (place, hex) = row.split_once(' ').expect("a place");
        let place = usize::from_str_radix(place, 16).expect("hex");
        let digits = hex.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).expect("text"));
        for (offset, pair) in digits.enumerate() {
            bytes[place + offset] = u8::from_str_radix(pair, 16).expect("hex");
        }
    }
    bytes
}

#[test]
fn what_was_printed_is_read() {
    let mut bytes = vec![ERASED; 100];
    bytes[40] = 0x12;
    bytes[99] = 0;
    assert_eq!(print(&bytes).lines().count(), 3);
    assert_eq!(parse(&print(&bytes)), bytes);
}
