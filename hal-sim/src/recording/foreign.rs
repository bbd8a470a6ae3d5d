//! Detects files in unsupported formats, so that a single message can refuse them as a whole.

/// Appends the accepted formats and the remedy to an error message.
macro_rules! refusal {
    ($what:literal) => {
        concat!(
            $what,
            "; accepted: candump log or screen output, ASC, pcapng; python-can's can_logconvert converts others to ASC"
        )
    };
}

/// The number of leading unreadable lines after which a text is refused as a whole.
pub(super) const LINES: usize = 10;

pub(super) const EMPTY: &str = "no frame in the recording";
pub(super) const UNKNOWN: &str = refusal!("not a recording in a known format");

/// The first bytes of Wireshark's older pcap format, in both byte orders, with microsecond or nanosecond timestamps.
const PCAP: [&[u8]; 4] =
    [&[0xD4, 0xC3, 0xB2, 0xA1], &[0xA1, 0xB2, 0xC3, 0xD4], &[0x4D, 0x3C, 0xB2, 0xA1], &[0xA1, 0xB2, 0x3C, 0x4D]];

/// Returns the error message for a file in an unsupported format, recognised by its first four bytes; `None` if the
/// file may be a recording.
pub(super) fn by_magic(head: &[u8]) -> Option<&'static str> {
    match head {
        b"LOGG" => Some(refusal!("a BLF file")),
        b"MDF " | b"UnFi" => Some(refusal!("an MDF file (MF4)")),
        b"SQLi" => Some(refusal!("an SQLite database")),
        [0x1F, 0x8B, ..] => Some("a gzip file; decompress it first"),
        head if PCAP.contains(&head) => Some("a pcap file; convert it to pcapng with `editcap -F pcapng`"),
        _ => None,
    }
}

/// Returns the error message for a text in an unsupported format, recognised by an unreadable line; `None` if the
/// format is not recognised.
pub(super) fn by_line(line: &str) -> Option<&'static str> {
    // Zero bytes occur in unwritten parts of a file, escape characters in coloured terminal output.
    let is_binary = |char: char| {
        char == char::REPLACEMENT_CHARACTER
            || char.is_control() && !char.is_whitespace() && !matches!(char, '\0' | '\x1B')
    };
    if line.starts_with(';') {
        Some(refusal!("a TRC file"))
    } else if line.starts_with("timestamp,") {
        Some(refusal!("a CSV file"))
    } else {
        line.contains(is_binary).then_some(UNKNOWN)
    }
}
