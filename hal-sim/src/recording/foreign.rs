//! Files of other formats, refused as a whole instead of line by line.

/// The remedy, for the refusal.
macro_rules! refusal {
    ($what:literal) => {
        concat!(
            $what,
            "; accepted: candump's log or screen, ASC, pcapng; can_logconvert of python-can makes ASC of others"
        )
    };
}

/// Lines at the begin of a text that may fail to parse before the text is no recording.
pub(super) const LINES: usize = 10;

pub(super) const EMPTY: &str = refusal!("nothing in it");
pub(super) const UNKNOWN: &str = refusal!("no recording of a known format");

/// First bytes of the older format of Wireshark: either byte order, times in microseconds or nanoseconds.
const PCAP: [&[u8]; 4] =
    [&[0xD4, 0xC3, 0xB2, 0xA1], &[0xA1, 0xB2, 0xC3, 0xD4], &[0x4D, 0x3C, 0xB2, 0xA1], &[0xA1, 0xB2, 0x3C, 0x4D]];

/// Returns why a file that begins with these four bytes is none; `None` for one that may be a recording.
pub(super) fn by_magic(head: &[u8]) -> Option<&'static str> {
    match head {
        b"LOGG" => Some(refusal!("a file of BLF")),
        b"MDF " | b"UnFi" => Some(refusal!("a file of MDF (MF4)")),
        b"SQLi" => Some(refusal!("a database of SQLite")),
        [0x1F, 0x8B, ..] => Some("a file of gzip; accepted: what is packed in it"),
        head if PCAP.contains(&head) => {
            Some("a file of pcap; accepted: pcapng, as `editcap -F pcapng` makes it, ASC, and candump's")
        }
        _ => None,
    }
}

/// Returns why a text with this first line, which is none of a recording, is none; `None` for a line like any other.
pub(super) fn by_line(line: &str) -> Option<&'static str> {
    // Room that was never written has zeros, colours of a terminal have escapes.
    let is_binary = |char: char| {
        char == char::REPLACEMENT_CHARACTER
            || char.is_control() && !char.is_whitespace() && !matches!(char, '\0' | '\x1B')
    };
    if line.starts_with(';') {
        Some(refusal!("a file of TRC"))
    } else if line.starts_with("timestamp,") {
        Some(refusal!("a file of CSV"))
    } else {
        line.contains(is_binary).then_some(UNKNOWN)
    }
}
