//! A recording that is being read, in any format: what is in the file decides, and for a text that says nothing its
//! ending.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::Path;

use super::pcapng::{MAGIC, PacketError, Packets};
use super::{Format, asc};
use crate::trace::candump::{self, Reason};
use crate::trace::{Record, Timestamp};

/// The longest line that is read, in bytes: more than any line of a log has.
const LINE_MAX: u64 = 4096;

/// How much of a line that is none is shown, in characters.
const SHOWN: usize = 80;

const UNREADABLE: &str = "cannot be read on";

/// What the older format of Wireshark begins with: either byte order, times in microseconds or nanoseconds.
const PCAP: [&[u8]; 4] =
    [&[0xD4, 0xC3, 0xB2, 0xA1], &[0xA1, 0xB2, 0xC3, 0xD4], &[0x4D, 0x3C, 0xB2, 0xA1], &[0xA1, 0xB2, 0x3C, 0x4D]];

const OLD_FORMAT: &str = "a file of pcap; accepted: pcapng, as `editcap -F pcapng` makes it, ASC, and candump's";

/// Reads a recording, entry by entry.
pub struct Reader {
    source: Source,
    /// The number of the line or the packet that was read last, from 1.
    number: u64,
    ended: bool,
}

enum Source {
    Text(Text),
    Packets(Box<Packets>),
}

struct Text {
    input: BufReader<Box<dyn Read + Send>>,
    style: Style,
    /// The time of the last entry.
    last: Timestamp,
    /// The bus of the last entry.
    bus: String,
    line: Vec<u8>,
    /// Whether the line was longer than what is kept of it.
    is_too_long: bool,
}

/// The format of a text.
enum Style {
    /// The first line decides, and where that says nothing the ending.
    Unseen(Format),
    Candump,
    Asc(asc::Parser),
}

/// An entry, and the line or the packet that it is in, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Logged {
    /// The number of the line, or of the packet.
    pub number: u64,
    /// The entry.
    pub record: Record,
}

/// Why there is no entry.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// A line or a packet that is none; the next one is read as if it was not there.
    #[error("{number}: {reason}{}", quoted(text))]
    NoEntry {
        /// The number of the line, or of the packet.
        number: u64,
        /// What it is.
        reason: &'static str,
        /// The begin of the line; empty for a packet.
        text: String,
    },
    /// The file cannot be read on.
    #[error("{0}")]
    Io(#[from] io::Error),
}

fn quoted(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!(": {text:?}") }
}

impl Reader {
    /// Opens a file; `-` is stdin.
    ///
    /// # Errors
    /// When the file cannot be opened or read.
    pub fn open(path: &Path) -> io::Result<Self> {
        if path == Path::new("-") {
            return Self::new(io::stdin(), Format::Candump);
        }
        let file = File::open(path)?;
        if file.metadata()?.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        Self::new(file, Format::of(path))
    }

    /// Reads `source`, in the format of what is in it; a text whose first line is none of ASC has the format of
    /// `ending`.
    ///
    /// # Errors
    /// When nothing can be read from `source`.
    pub fn new(mut source: impl Read + Send + 'static, ending: Format) -> io::Result<Self> {
        let mut head = Vec::new();
        (&mut source).take(MAGIC.len() as u64).read_to_end(&mut head)?;
        if PCAP.contains(&head.as_slice()) {
            return Err(io::Error::new(io::ErrorKind::InvalidData, OLD_FORMAT));
        }
        let is_packets = head == MAGIC;
        let whole = Cursor::new(head).chain(source);
        let source = if is_packets {
            Source::Packets(Box::new(Packets::new(Box::new(whole)).map_err(|error| match error {
                PacketError::End(reason) | PacketError::Packet(reason) => {
                    io::Error::new(io::ErrorKind::InvalidData, reason)
                }
                PacketError::Io => io::Error::other(UNREADABLE),
            })?))
        } else {
            let last = Timestamp::from_micros(0);
            Source::Text(Text {
                input: BufReader::new(Box::new(whole)),
                style: Style::Unseen(ending),
                last,
                bus: "can0".to_owned(),
                line: Vec::new(),
                is_too_long: false,
            })
        };
        Ok(Self { source, number: 0, ended: false })
    }

    /// Returns the name of the bus that the last entry was on.
    #[must_use]
    pub fn bus(&self) -> &str {
        match &self.source {
            Source::Text(text) => &text.bus,
            Source::Packets(packets) => packets.bus(),
        }
    }

    /// Returns whether the next entry may have to be waited for, at a pipe.
    #[must_use]
    pub fn may_wait(&self) -> bool {
        match &self.source {
            Source::Text(text) => text.input.buffer().is_empty(),
            Source::Packets(packets) => packets.may_wait(),
        }
    }

    fn end(&mut self, error: ReadError) -> Option<Result<Logged, ReadError>> {
        self.ended = true;
        Some(Err(error))
    }
}

impl Iterator for Reader {
    type Item = Result<Logged, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        loop {
            self.number += 1;
            let number = self.number;
            let (found, text) = match &mut self.source {
                Source::Packets(packets) => match packets.next()? {
                    Ok(record) => (Ok(record), String::new()),
                    Err(PacketError::Packet(reason)) => (Err(reason), String::new()),
                    Err(PacketError::End(reason)) => {
                        return self.end(ReadError::NoEntry { number, reason, text: String::new() });
                    }
                    Err(PacketError::Io) => return self.end(io::Error::other(UNREADABLE).into()),
                },
                Source::Text(text) => match text.next_line() {
                    Err(error) => return self.end(error.into()),
                    Ok(false) => return None,
                    Ok(true) => match text.entry() {
                        Ok(None) => continue,
                        Ok(Some(record)) => (Ok(record), String::new()),
                        Err(reason) => (Err(reason), text.shown()),
                    },
                },
            };
            return Some(match found {
                Ok(record) => Ok(Logged { number, record }),
                Err(reason) => Err(ReadError::NoEntry { number, reason, text }),
            });
        }
    }
}

impl Text {
    /// Reads the next line, as far as it is kept; returns whether there is one.
    fn next_line(&mut self) -> io::Result<bool> {
        self.line.clear();
        if (&mut self.input).take(LINE_MAX).read_until(b'\n', &mut self.line)? == 0 {
            return Ok(false);
        }
        self.is_too_long = !self.line.ends_with(b"\n") && self.line.len() as u64 == LINE_MAX;
        if self.is_too_long {
            self.input.skip_until(b'\n')?;
        }
        Ok(true)
    }

    /// Returns the entry of the line; `None` when it has none to have.
    fn entry(&mut self) -> Result<Option<Record>, Reason> {
        if self.is_too_long {
            return Err("a line that is too long");
        }
        // ASC is written in the encoding of its machine.
        let line = String::from_utf8_lossy(&self.line);
        // Editors of Windows put a byte order mark before the first line.
        let line = line.trim_start_matches('\u{FEFF}');
        if line.trim().is_empty() || line.starts_with('#') {
            return Ok(None);
        }
        if let Style::Unseen(ending) = self.style {
            let is_asc = asc::is_head(line) || (ending == Format::Asc && candump::parse(line).is_err());
            self.style = if is_asc { Style::Asc(asc::Parser::default()) } else { Style::Candump };
        }
        if let Style::Asc(asc) = &mut self.style {
            let before = asc.channel();
            let record = asc.line(line)?;
            if asc.channel() != before {
                // Channels count from 1, the names of candump from 0.
                self.bus = format!("can{}", asc.channel().saturating_sub(1));
            }
            return Ok(record);
        }
        let (at, bus, entry) = candump::parse(line)?;
        if self.bus != bus {
            bus.clone_into(&mut self.bus);
        }
        self.last = at.unwrap_or(self.last);
        Ok(Some(Record { at: self.last, entry }))
    }

    fn shown(&self) -> String {
        String::from_utf8_lossy(&self.line).trim().chars().take(SHOWN).collect()
    }
}
