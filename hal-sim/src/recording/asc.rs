//! Vector's ASC: a text format with one event per line and times since the start of the measurement.
//!
//! Only frames and error frames of classic CAN are read; other events (statistics, chip states, variables, comments)
//! are skipped. Error frames have no class in this format.

use std::fmt::Write as _;
use std::io::{self, Write};

use protocol_core::frame::{Frame, Id, identifier};

use super::date::{self, Date};
use crate::log::candump::FD;
use crate::log::{Entry, ErrorFrame, Reason, Record, Timestamp};

/// The channel of all written frames.
const CHANNEL: u8 = 1;

/// Writes the file header for a measurement that starts at `start`. Returns the origin of all times: `start` rounded
/// down to milliseconds, the resolution of the date in the header.
pub(super) fn write_head(out: &mut impl Write, start: Timestamp) -> io::Result<Timestamp> {
    let origin = Timestamp::from_micros(start.as_micros() / 1000 * 1000);
    let date = Date(origin);
    writeln!(out, "date {date}\nbase hex  timestamps absolute\ninternal events logged")?;
    writeln!(out, "Begin Triggerblock {date}\n   0.000000 Start of measurement")?;
    Ok(origin)
}

/// Writes an entry. An entry before the origin is written with the time of the origin.
pub(super) fn write(out: &mut impl Write, origin: Timestamp, Record { at, entry }: &Record) -> io::Result<()> {
    let micros = at.as_micros().saturating_sub(origin.as_micros());
    let mut line = format!("{:>4}.{:06} {CHANNEL}  ", micros / 1_000_000, micros % 1_000_000);
    match entry {
        Entry::Error(_) => line.push_str("ErrorFrame"),
        Entry::Frame(frame) => {
            let id = match frame.id() {
                Id::Standard(id) => format!("{:X}", id.as_raw()),
                Id::Extended(id) => format!("{:X}x", id.as_raw()),
            };
            let kind = if frame.is_remote() { 'r' } else { 'd' };
            // Writing to a string cannot fail.
            let _ = write!(line, "{id:<15} Rx   {kind} {:x}", frame.len());
            for byte in frame.data() {
                let _ = write!(line, " {byte:02X}");
            }
        }
    }
    line.push('\n');
    out.write_all(line.as_bytes())
}

pub(super) fn write_comment(out: &mut impl Write, origin: Timestamp, at: Timestamp, text: &str) -> io::Result<()> {
    let micros = at.as_micros().saturating_sub(origin.as_micros());
    let line = format!("// {}.{:06} {text}\n", micros / 1_000_000, micros % 1_000_000);
    out.write_all(line.as_bytes())
}

pub(super) fn write_end(out: &mut impl Write) -> io::Result<()> {
    out.write_all(b"End TriggerBlock\n")
}

/// Returns whether a line can be the first line of an ASC file.
pub(super) fn is_head(line: &str) -> bool {
    let mut words = line.split_whitespace();
    let first = words.next().unwrap_or_default().to_ascii_lowercase();
    match first.as_str() {
        "date" => true,
        "base" => words.next().is_some_and(|base| radix(base).is_some()),
        first => first.starts_with("//"),
    }
}

/// A line-by-line parser of an ASC file.
#[derive(Debug)]
pub(super) struct Parser {
    /// The number base of identifiers, lengths and data.
    radix: u32,
    /// True if times are relative to the previous event instead of the start of the measurement.
    relative: bool,
    /// The start of the measurement.
    origin: Timestamp,
    /// True once a block has set the origin. Later blocks of the same measurement do not change the origin.
    is_begun: bool,
    /// The time of the previous event.
    last: Timestamp,
    /// The channel of the last frame, from 1.
    pub(super) channel: u16,
}

impl Default for Parser {
    fn default() -> Self {
        let zero = Timestamp::from_micros(0);
        Self { radix: 16, relative: false, origin: zero, is_begun: false, last: zero, channel: CHANNEL.into() }
    }
}

impl Parser {
    /// Parses a line; `None` for a valid line without a frame.
    ///
    /// # Errors
    /// The reason why the line is invalid.
    pub(super) fn line(&mut self, line: &str) -> Result<Option<Record>, Reason> {
        let line = line.trim();
        let (first, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim_start();
        match first.to_ascii_lowercase().as_str() {
            "date" => {
                self.start(date::parse(rest));
                self.is_begun = false;
            }
            "base" => self.base(rest)?,
            "begin" if self.is_begun => {}
            "begin" => {
                self.start(rest.split_once(char::is_whitespace).and_then(|(_, date)| date::parse(date)));
                self.is_begun = true;
            }
            "end" | "internal" | "no" => {}
            first if first.starts_with("//") => {}
            first => return self.event(first, rest),
        }
        Ok(None)
    }

    /// Sets the origin to a date. An unreadable date leaves the origin unchanged.
    fn start(&mut self, date: Option<Timestamp>) {
        self.origin = date.unwrap_or(self.origin);
        self.last = self.origin;
    }

    /// Parses the header line with the number base: `hex  timestamps absolute`.
    fn base(&mut self, rest: &str) -> Result<(), Reason> {
        let words: Vec<&str> = rest.split_whitespace().collect();
        self.radix = words.first().and_then(|base| radix(base)).ok_or("the base must be hex or dec")?;
        self.relative = words.last().is_some_and(|times| times.eq_ignore_ascii_case("relative"));
        Ok(())
    }

    fn event(&mut self, time: &str, rest: &str) -> Result<Option<Record>, Reason> {
        let passed: Timestamp = time.parse().map_err(|_| "not an ASC line")?;
        let from = if self.relative { self.last } else { self.origin };
        let at = Timestamp::from_micros(from.as_micros().saturating_add(passed.as_micros()));
        self.last = at;
        let words: Vec<&str> = rest.split_whitespace().collect();
        let entry = match words.as_slice() {
            [device, channel, direction, rest @ ..] if device.eq_ignore_ascii_case("CANFD") && is_on_bus(direction) => {
                self.channel = channel.parse().map_err(|_| "invalid channel")?;
                Entry::Frame(self.frame_of_fd_controller(rest)?)
            }
            [device, ..] if device.eq_ignore_ascii_case("CANFD") => return Err(FD),
            // A line without a channel is not a frame.
            [channel, ..] if channel.parse::<u16>().is_err() => return Ok(None),
            [channel, error, ..] if error.eq_ignore_ascii_case("ErrorFrame") => {
                self.channel = channel.parse().unwrap_or(self.channel);
                Entry::Error(ErrorFrame::UNTOLD)
            }
            [channel, id, direction, rest @ ..] if is_on_bus(direction) => {
                self.channel = channel.parse().unwrap_or(self.channel);
                Entry::Frame(self.frame(id, rest)?)
            }
            // A transmit request; a separate line contains the transmitted frame.
            [_, _, direction, ..] if direction.eq_ignore_ascii_case("TxRq") => return Ok(None),
            [_, event, ..] if is_other_event(event) => return Ok(None),
            _ => return Err("not a known ASC event"),
        };
        Ok(Some(Record { at, entry }))
    }

    /// Parses a classic CAN frame in the line format of CAN FD controllers: identifier, name, BRS, ESI, length code,
    /// length, data, two durations, flags.
    fn frame_of_fd_controller(&self, words: &[&str]) -> Result<Frame, Reason> {
        /// The flags for remote frames and CAN FD frames.
        const REMOTE: u32 = 1 << 4;
        const EXTENDED_DATA_LENGTH: u32 = 1 << 12;
        let words: Vec<&str> = match words {
            [id, name, rest @ ..] if !matches!(*name, "0" | "1") => [&[*id], rest].concat(),
            words => words.to_vec(),
        };
        let [id, _, _, code, length, rest @ ..] = words.as_slice() else { return Err("incomplete frame") };
        let length: usize = length.parse().map_err(|_| "invalid length")?;
        let flags = rest.get(length.saturating_add(2)).and_then(|flags| u32::from_str_radix(flags, 16).ok());
        match flags {
            Some(flags) if flags & EXTENDED_DATA_LENGTH != 0 => Err(FD),
            Some(flags) if flags & REMOTE != 0 => self.frame(id, &["r", code]),
            Some(_) => self.frame(id, &[&["d", code], rest].concat()),
            None => Err(FD),
        }
    }

    /// Parses a frame from its identifier and the text after the direction.
    fn frame(&self, id: &str, rest: &[&str]) -> Result<Frame, Reason> {
        let number = |text: &str| u32::from_str_radix(text, self.radix).ok().filter(|_| !text.starts_with('+'));
        let (digits, is_extended) = id.strip_suffix(['x', 'X']).map_or((id, false), |id| (id, true));
        let id = number(digits).and_then(|number| identifier(number, is_extended)).ok_or("invalid identifier")?;
        let length = |text: &str| number(text).and_then(|code| u8::try_from(code).ok()).filter(|code| *code <= 15);
        match *rest {
            ["r" | "R", ref rest @ ..] => {
                Ok(Frame::remote(id, rest.first().and_then(|text| length(text)).unwrap_or(0)))
            }
            ["d" | "D", code, ref rest @ ..] => {
                let wanted = length(code).ok_or("invalid length")?.min(8);
                let mut data = [0; 8];
                let bytes = rest.get(..usize::from(wanted)).ok_or("fewer bytes than the stated length")?;
                // A byte in base hex has two digits; a truncated file may lack the second one.
                let is_whole = |byte: &&str| self.radix != 16 || byte.len() == 2;
                let value = |byte| number(byte).and_then(|byte| u8::try_from(byte).ok());
                for (room, byte) in data.iter_mut().zip(bytes) {
                    *room = Some(*byte).filter(is_whole).and_then(value).ok_or("invalid data byte")?;
                }
                Ok(Frame::with_len(id, data, wanted))
            }
            _ => Err("the frame type must be d or r"),
        }
    }
}

fn radix(base: &str) -> Option<u32> {
    match base.to_ascii_lowercase().as_str() {
        "hex" => Some(16),
        "dec" => Some(10),
        _ => None,
    }
}

fn is_on_bus(direction: &str) -> bool {
    direction.eq_ignore_ascii_case("Rx") || direction.eq_ignore_ascii_case("Tx")
}

/// Returns whether the word after a channel starts an event other than a frame: `Statistic:`, `CAN Status:`, `J1939TP`.
fn is_other_event(word: &str) -> bool {
    word.ends_with(':') || ["CAN", "J1939TP", "OverloadFrame"].iter().any(|known| word.eq_ignore_ascii_case(known))
}
