//! Decodes slcan lines into commands, and encodes frames as slcan lines. Performs no I/O; the only state is an
//! incomplete line.

use std::fmt::Write;

use protocol_core::frame::{Digits, Frame, Id, MAX_LEN, identifier};

use crate::gateway::guard::Verdict;
use hal_sim::log::{Timestamp, write_hex};

/// The maximum length of a line without its CR: a frame with a 29-bit identifier, its length and eight bytes.
const LINE_MAX: usize = 1 + 8 + 1 + 2 * MAX_LEN;

/// The answer to an executed command.
pub(super) const OK: &str = "\r";
/// The answer to a line that is not executed.
pub(super) const BELL: &str = "\x07";
/// The answer to a frame with an 11-bit identifier.
pub(super) const SENT_STANDARD: &str = "z\r";
/// The answer to a frame with a 29-bit identifier.
pub(super) const SENT_EXTENDED: &str = "Z\r";
/// The answers to `F`: bit 7 indicates a bus error.
pub(super) const NO_ERROR: &str = "F00\r";
pub(super) const BUS_ERROR: &str = "F80\r";
/// The versions of the hardware, 1.0, and of the program.
pub(super) const VERSION: &str = concat!("V10", env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"), "\r");
/// The serial number of the adapter: four characters.
pub(super) const SERIAL: &str = "NPVE0\r";

/// The bit rates of `S0` to `S8`, in bit/s.
const RATES: [u32; 9] = [10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000];

/// The clock for the bit-timing registers that the command `s` sets, in Hz: half of 16 MHz, as on an adapter with an
/// SJA1000.
const TIMING_CLOCK: u32 = 8_000_000;

/// The modulus of the time stamps, which count milliseconds.
const STAMP_END: u64 = 60_000;

/// A command of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// `S0` to `S8`, `sXXYY`: the bit rate of the client's bus, in bit/s, with the channel closed.
    SetRate(u32),
    /// `O`: opens the channel.
    Open,
    /// `L`: opens the channel in listen-only mode.
    Listen,
    /// `C`: closes the channel.
    Close,
    /// `tIIILDD…`, `TIIIIIIIILDD…`, `rIIIL`, `RIIIIIIIIL`: sends a frame.
    Send(Frame),
    /// `F`: reads the status flags.
    Flags,
    /// `V`: reads the versions.
    Version,
    /// `N`: reads the serial number.
    Serial,
    /// `Z1`, `Z0`: time stamps on or off.
    Stamps(bool),
    /// `X1`: automatic reception, which is always on.
    AutoSend,
    /// An empty line, by which clients discard an incomplete command.
    Nothing,
}

/// An unknown or unsupported command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused;

/// Parses lines from a byte stream, independent of read boundaries.
#[derive(Debug, Default)]
pub struct Parser {
    /// The incomplete line, at most [`LINE_MAX`] + 1 bytes. A line of that length is too long: further bytes are
    /// dropped, and the line is refused.
    line: Vec<u8>,
}

impl Parser {
    /// Processes the next byte; returns a command if the byte ends a line.
    pub fn push(&mut self, byte: u8) -> Option<Result<Command, Refused>> {
        match byte {
            b'\r' => {
                let command = parse(&self.line).ok_or(Refused);
                self.line.clear();
                Some(command)
            }
            // Some clients end a line with CR LF.
            b'\n' => None,
            _ => {
                if self.line.len() <= LINE_MAX {
                    self.line.push(byte);
                }
                None
            }
        }
    }
}

/// Judges a byte of the first line of a connection. A slcan command has only letters and digits before its CR, but the
/// request line of HTTP has a space.
#[must_use]
pub(super) const fn judge(byte: u8) -> Verdict {
    match byte {
        b'\r' => Verdict::Client,
        b'\n' | b'0'..=b'9' | b'A'..=b'Z' | b'a'..=b'z' => Verdict::Undecided,
        _ => Verdict::Foreign,
    }
}

fn parse(line: &[u8]) -> Option<Command> {
    match line {
        [] => Some(Command::Nothing),
        [b'S', index @ b'0'..=b'8'] => RATES.get(usize::from(index - b'0')).copied().map(Command::SetRate),
        [b's', registers @ ..] if registers.len() == 4 => hex(registers).map(timing).map(Command::SetRate),
        b"O" => Some(Command::Open),
        b"L" => Some(Command::Listen),
        b"C" => Some(Command::Close),
        b"F" => Some(Command::Flags),
        b"V" => Some(Command::Version),
        b"N" => Some(Command::Serial),
        b"Z0" => Some(Command::Stamps(false)),
        b"Z1" => Some(Command::Stamps(true)),
        b"X1" => Some(Command::AutoSend),
        [kind @ (b't' | b'T' | b'r' | b'R'), rest @ ..] => {
            let is_extended = kind.is_ascii_uppercase();
            let (id, rest) = rest.split_at_checked(if is_extended { 8 } else { 3 })?;
            frame(identifier(hex(id)?, is_extended)?, rest, kind.eq_ignore_ascii_case(&b'r')).map(Command::Send)
        }
        _ => None,
    }
}

/// Parses the data length, one digit, followed by that number of data bytes; a remote frame has no data bytes.
fn frame(id: Id, text: &[u8], is_remote: bool) -> Option<Frame> {
    let (digit, text) = text.split_first()?;
    let len = digit.checked_sub(b'0').filter(|len| usize::from(*len) <= MAX_LEN)?;
    if is_remote {
        return text.is_empty().then(|| Frame::remote(id, len));
    }
    if text.len() != 2 * usize::from(len) {
        return None;
    }
    let mut data = [0; MAX_LEN];
    for (slot, digits) in data.iter_mut().zip(text.chunks_exact(2)) {
        *slot = u8::try_from(hex(digits)?).ok()?;
    }
    Some(Frame::with_len(id, data, len))
}

/// Parses a number of at most eight hex digits.
fn hex(digits: &[u8]) -> Option<u32> {
    digits.iter().try_fold(0, |number, digit| Some(number << 4 | char::from(*digit).to_digit(16)?))
}

/// Returns the bit rate of the bit timing registers BTR0 (prescaler) and BTR1 (segments) of an SJA1000, in bit/s.
const fn timing(registers: u32) -> u32 {
    let prescaler = (registers >> 8 & 0x3F) + 1;
    let segment_1 = (registers & 0xF) + 1;
    let segment_2 = (registers >> 4 & 0x7) + 1;
    TIMING_CLOCK / (prescaler * (1 + segment_1 + segment_2))
}

/// Appends a frame as a line, with a time stamp in milliseconds if requested.
pub fn emit_frame(out: &mut String, frame: &Frame, stamp: Option<Timestamp>) {
    let kind = if frame.is_remote() { 'r' } else { 't' };
    let kind = if frame.is_extended() { kind.to_ascii_uppercase() } else { kind };
    // Writing to a string cannot fail.
    let _ = write!(out, "{kind}{}{}", Digits(frame.id()), frame.len());
    write_hex(out, frame.data());
    if let Some(at) = stamp {
        let _ = write!(out, "{:04X}", at.as_micros() / 1000 % STAMP_END);
    }
    out.push('\r');
}

#[cfg(test)]
#[path = "protocol_tests.rs"]
mod tests;
