//! The line formats of `candump`. The log format `(1700000000.000000) vcan0 18A#0102` is written and read; the screen
//! format `(1700000000.000000)  vcan0  18A   [2]  01 02` is only read.

use std::fmt::Write;

use protocol_core::frame::{ExtendedId, Frame, Id};

use super::{ERROR_FLAG, EXTENDED_FLAG, Entry, ErrorFrame, REMOTE_FLAG, Reason, Timestamp, write_hex};

/// Writes a frame without a line end. A 29-bit identifier has eight digits. A remote frame has `R` and its length, if
/// above 0, instead of data.
pub fn write_frame(out: &mut String, at: Timestamp, bus: &str, frame: &Frame) {
    // Writing to a string cannot fail.
    let _ = match frame.id() {
        Id::Standard(id) => write!(out, "({at}) {bus} {:03X}#", id.as_raw()),
        Id::Extended(id) => write!(out, "({at}) {bus} {:08X}#", id.as_raw()),
    };
    if frame.is_remote() {
        out.push('R');
        if !frame.is_empty() {
            let _ = write!(out, "{}", frame.len());
        }
    }
    write_hex(out, frame.data());
}

/// Writes a frame, or an error frame with the error-frame flag and eight data bytes, without a line end.
pub fn write_entry(out: &mut String, at: Timestamp, bus: &str, entry: &Entry) {
    match entry {
        Entry::Frame(frame) => write_frame(out, at, bus, frame),
        Entry::Error(ErrorFrame { class, data }) => {
            let data = u64::from_be_bytes(*data);
            let _ = write!(out, "({at}) {bus} {:08X}#{data:016X}", ERROR_FLAG | class);
        }
    }
}

/// The message for CAN FD frames, in all recording formats.
pub(crate) const FD: Reason = "CAN FD frames are not supported";

pub(crate) const NO_LINE: Reason = "not a candump line";

const MORE: Reason = "unexpected text after the frame";

/// Parses a line in log or screen format. Returns the time, if any, the bus name, and the entry. In log format, the
/// frame may be followed by the direction `R` or `T`, or by two blanks and the explanation written by `pve-sim`.
///
/// # Errors
/// The reason why the line contains no entry.
pub fn parse(line: &str) -> Result<(Option<Timestamp>, &str, Entry), Reason> {
    let line = line.trim();
    let (at, rest) = match line.strip_prefix('(').map(|rest| rest.split_once(')')) {
        Some(Some((time, rest))) => (Some(time.trim().parse()?), rest),
        Some(None) => return Err(NO_LINE),
        None => (None, line),
    };
    let (bus, rest) = word(rest);
    let (token, rest) = word(rest);
    if let Some((id, data)) = token.split_once('#') {
        if !rest.starts_with("  ") && !matches!(rest.trim(), "" | "R" | "T") {
            return Err(MORE);
        }
        return Ok((at, bus, logged(id, data)?));
    }
    // With -x, the direction and two flags precede the identifier.
    let (id, rest) = match token {
        "RX" | "TX" => {
            let (_, rest) = word(rest);
            let (_, rest) = word(rest);
            word(rest)
        }
        id => (id, rest),
    };
    shown(id, rest).map(|entry| (at, bus, entry))
}

/// Splits a text into its first word and the rest.
fn word(text: &str) -> (&str, &str) {
    let text = text.trim_start();
    text.split_at(text.find(' ').unwrap_or(text.len()))
}

/// Parses an identifier of three or eight digits. Returns the identifier with the flags of a `struct can_frame`.
fn can_id(digits: &str) -> Result<u32, Reason> {
    const LENGTH: Reason = "an identifier must have three or eight digits";
    if digits.is_empty() || !is_hex(digits) {
        return Err(NO_LINE);
    }
    let raw = u32::from_str_radix(digits, 16).map_err(|_| LENGTH)?;
    match (digits.len(), raw & !ExtendedId::MAX.as_raw()) {
        (3, _) => Ok(raw),
        (8, 0) => Ok(raw | EXTENDED_FLAG),
        (8, ERROR_FLAG) => Ok(raw),
        (8, _) => Err("identifier out of range"),
        _ => Err(LENGTH),
    }
}

/// Returns whether a text consists of hex digits only. The number parsers alone would also accept a sign.
fn is_hex(text: &str) -> bool {
    text.bytes().all(|digit| digit.is_ascii_hexdigit())
}

/// Parses a line in log format, from the identifier onwards.
fn logged(id: &str, data: &str) -> Result<Entry, Reason> {
    let id = can_id(id)?;
    if data.starts_with('#') {
        return Err(FD);
    }
    // Newer candump versions append a data length code above 8, which stands for 8 bytes.
    let has_code = |(data, code): &(&str, &str)| {
        (data.len() == 16 || *data == "R8") && matches!(code.as_bytes(), [b'9' | b'A'..=b'F' | b'a'..=b'f'])
    };
    let data = data.split_once('_').filter(has_code).map_or(data, |(data, _)| data);
    if let Some(length) = data.strip_prefix(['R', 'r']) {
        return remote(id, if length.is_empty() { "0" } else { length });
    }
    if !data.is_ascii() || !data.len().is_multiple_of(2) {
        return Err("data must be whole bytes in hex");
    }
    entry(id, (0..data.len()).step_by(2).filter_map(|at| data.get(at..at + 2)))
}

/// Parses a line in screen format, from the length onwards.
fn shown(id: &str, rest: &str) -> Result<Entry, Reason> {
    let (length, rest) = word(rest);
    let length = length.strip_prefix('[').and_then(|length| length.strip_suffix(']')).ok_or(NO_LINE)?;
    let id = can_id(id)?;
    if let Some(rest) = rest.trim_start().strip_prefix("remote request") {
        return if rest.is_empty() { remote(id, length) } else { Err(MORE) };
    }
    // A length of two digits indicates a CAN FD frame.
    let wanted = length.parse().ok().filter(|wanted| *wanted <= 8 && length.len() == 1).ok_or(FD)?;
    let (mut bytes, mut rest) = (Vec::with_capacity(wanted), rest);
    for _ in 0..wanted {
        let (byte, after) = word(rest);
        if byte.is_empty() {
            return Err("fewer bytes than the stated length");
        }
        bytes.push(byte);
        rest = after;
    }
    // With -a, the bytes follow as characters, one each.
    let rest = rest.trim_start();
    let is_text = rest.len() == wanted + 2 && rest.starts_with('\'') && rest.ends_with('\'');
    if !is_text && !matches!(rest, "" | "ERRORFRAME") {
        return Err(MORE);
    }
    entry(id, bytes.into_iter())
}

fn remote(id: u32, length: &str) -> Result<Entry, Reason> {
    let length = length.parse().ok().filter(|length| *length <= 8).ok_or("remote frame length above 8")?;
    if id & ERROR_FLAG != 0 {
        return Err("an error frame cannot be a remote frame");
    }
    Entry::of_can_frame(id | REMOTE_FLAG, length, [0; 8])
}

fn entry<'a>(id: u32, pairs: impl Iterator<Item = &'a str>) -> Result<Entry, Reason> {
    let (mut data, mut length) = ([0; 8], 0);
    for pair in pairs {
        let byte = data.get_mut(usize::from(length)).ok_or("more than 8 data bytes")?;
        let number = u8::from_str_radix(pair, 16).ok().filter(|_| pair.len() == 2 && is_hex(pair));
        *byte = number.ok_or("data must be whole bytes in hex")?;
        length += 1;
    }
    Entry::of_can_frame(id, length, data)
}

#[cfg(test)]
mod tests {
    use protocol_core::frame::{extended, standard};
    use protocol_core::time::Instant;

    use super::super::ErrorClass;
    use super::*;

    fn line(frame: &Frame) -> String {
        let mut out = String::new();
        let start = Timestamp::from_micros(1_700_000_000_000_000);
        write_frame(&mut out, start.at(Instant::from_micros(42)), "pve0", frame);
        out
    }

    #[test]
    fn frames_as_candump_logs_them() {
        let sdo = Frame::of(standard(0x5A0).into(), &[0x43, 0x18, 0x10, 0x01, 0x19, 0x00, 0x00, 0x01]).unwrap();
        assert_eq!(line(&sdo), "(1700000000.000042) pve0 5A0#4318100119000001");
        assert_eq!(line(&Frame::of(standard(0x80).into(), &[]).unwrap()), "(1700000000.000042) pve0 080#");
        assert_eq!(line(&Frame::of(extended(0x80).into(), &[1]).unwrap()), "(1700000000.000042) pve0 00000080#01");
    }

    #[test]
    fn remote_frames_have_no_data() {
        assert_eq!(line(&Frame::remote(standard(0x720).into(), 0)), "(1700000000.000042) pve0 720#R");
        assert_eq!(line(&Frame::remote(standard(0x720).into(), 1)), "(1700000000.000042) pve0 720#R1");
        assert_eq!(line(&Frame::remote(extended(0x720).into(), 8)), "(1700000000.000042) pve0 00000720#R8");
    }

    #[test]
    fn error_frames_carry_linux_s_mark() {
        let line = |class| {
            let mut out = String::new();
            write_entry(&mut out, Timestamp::from_micros(5), "pve0", &Entry::Error(ErrorFrame::from(class)));
            out
        };
        assert_eq!(line(ErrorClass::BusOff), "(0.000005) pve0 20000040#0000000000000000");
        assert_eq!(line(ErrorClass::BusError), "(0.000005) pve0 20000080#0000000000000000");
        assert_eq!(line(ErrorClass::ErrorPassive), "(0.000005) pve0 20000004#0030000000000000");
        assert_eq!(line(ErrorClass::ErrorActive), "(0.000005) pve0 20000004#0040000000000000");
        assert_eq!(line(ErrorClass::Restarted), "(0.000005) pve0 20000100#0000000000000000");
    }

    /// Written lines are parsed, including lines with a direction, an explanation or a CR after the frame.
    #[test]
    fn a_log_is_read_as_it_was_written() {
        for text in ["5A0: 43 18 10 01 19 00 00 01", "080:", "00000080: 01", "720: R0", "00000720: R8", "7FF: R1"] {
            let frame: Frame = text.parse().unwrap();
            for end in ["", " R", " T", "  pvea-canopen: boot-up", "\r"] {
                let line = line(&frame) + end;
                let at = Some(Timestamp::from_micros(1_700_000_000_000_042));
                assert_eq!(parse(&line), Ok((at, "pve0", Entry::Frame(frame))), "{line}");
            }
        }
        let mut line = String::new();
        let error = Entry::Error(ErrorClass::ErrorPassive.into());
        write_entry(&mut line, Timestamp::from_micros(5), "can0", &error);
        assert_eq!(parse(&line), Ok((Some(Timestamp::from_micros(5)), "can0", error)));
    }

    /// Newer versions of candump append a data length code above 8, which stands for 8 bytes.
    #[test]
    fn a_raw_data_length_code_is_read() {
        for (line, text) in [
            ("(1.0) can0 5A0#4318100119000001_9", "5A0: 43 18 10 01 19 00 00 01"),
            ("(1.0) can0 5A0#4318100119000001_F", "5A0: 43 18 10 01 19 00 00 01"),
            ("(1.0) can0 720#R8_C", "720: R8"),
        ] {
            let at = Some(Timestamp::from_micros(1_000_000));
            assert_eq!(parse(line), Ok((at, "can0", Entry::Frame(text.parse().unwrap()))), "{line}");
        }
    }

    /// Lines written with and without -t, -x and -a are parsed.
    #[test]
    fn the_screen_is_read() {
        let at = Some(Timestamp::from_micros(1_700_000_000_000_042));
        for (line, at, text) in [
            ("  vcan0  5A0   [8]  43 18 10 01 19 00 00 01", None, "5A0: 43 18 10 01 19 00 00 01"),
            (" (1700000000.000042)  vcan0  080   [0] ", at, "080:"),
            (" (1700000000.000042)  vcan0  RX - -  00000080   [1]  41   'A'", at, "00000080: 41"),
            ("  vcan0  5A0   [3]  20 27 20   ' ' '", None, "5A0: 20 27 20"),
            ("  vcan0  080   [0]   ''", None, "080:"),
            ("  vcan0  TX B E  720   [0]  remote request", None, "720: R0"),
            ("  vcan0  720   [1]  remote request", None, "720: R1"),
        ] {
            assert_eq!(parse(line), Ok((at, "vcan0", Entry::Frame(text.parse().unwrap()))), "{line}");
        }
        let passive = "  can0  20000004   [8]  00 30 00 00 00 00 00 00   ERRORFRAME";
        assert_eq!(parse(passive), Ok((None, "can0", Entry::Error(ErrorClass::ErrorPassive.into()))));
    }

    #[test]
    fn a_line_that_is_none_says_why() {
        const BYTES: &str = "data must be whole bytes in hex";
        const REMOTE: &str = "remote frame length above 8";
        for (line, reason) in [
            ("", NO_LINE),
            ("pve-sim ready", NO_LINE),
            ("(1700000000.000042 pve0 5A0#", NO_LINE),
            ("(1.0) pve0 #00", NO_LINE),
            ("(2023-11-14 22:13:20) pve0 5A0#", "invalid timestamp"),
            ("(1.0) pve0 5A#00", "an identifier must have three or eight digits"),
            ("(1.0) pve0 800#00", "identifier out of range"),
            ("(1.0) pve0 40000000#00", "identifier out of range"),
            ("(1.0) pve0 5A0#0", BYTES),
            ("(1.0) pve0 5A0#+1", BYTES),
            ("(1.0) pve0 5A0#ä", BYTES),
            ("(1.0) pve0 5A0#000102030405060708", "more than 8 data bytes"),
            ("(1.0) pve0 5A0#R9", REMOTE),
            ("(1.0) pve0 5A0##100", FD),
            ("(1.0) pve0 5A0#00 and more", MORE),
            ("(1.0) pve0 5A0 [2] 00", "fewer bytes than the stated length"),
            ("(1.0) pve0 5A0 [1] 00 01", MORE),
            ("(1.0) pve0 5A0 [2] 41 00 '.'", MORE),
            ("(1.0) pve0 5A0 [0] 'A'", MORE),
            ("(1.0) pve0 5A0 [1] 41 'A' 42", MORE),
            ("(1.0) pve0 20000004 [8] 00 30 00 00 00 00 00 00 ERRORFRAME 00", MORE),
            ("(1.0) pve0 720 [1] remote request 00", MORE),
            ("(1.0) pve0 720#00_hello", BYTES),
            ("(1.0) pve0 720#00_9", BYTES),
            ("(1.0) pve0 0A0#0000000000000000_00000000", BYTES),
            ("(1.0) pve0 0A0#0000000000000000_8", "more than 8 data bytes"),
            ("(1.0) pve0 0A0#0000000000000000_", BYTES),
            ("(1.0) pve0 620#40181001_00000000", BYTES),
            ("(1.0) pve0 620#R4_9", REMOTE),
            ("(1.0) pve0 5A0 [12] 00", FD),
        ] {
            assert_eq!(parse(line), Err(reason), "{line}");
        }
    }
}
