//! Reads recordings in all formats. The content determines the format; for ambiguous text, the extension decides.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::Path;

use super::pcapng::{MAGIC, PacketError, Packets};
use super::{Format, asc, foreign, invalid};
use crate::log::candump::{self, Reason};
use crate::log::{Record, Timestamp};

/// The maximum length of a line in bytes, far above the line length of any supported format.
const LINE_MAX: u64 = 4096;

/// The maximum length of an unreadable line quoted in messages, in characters.
const SHOWN: usize = 80;

/// A reader of a recording, entry by entry.
pub struct Reader {
    source: Source,
    /// The number of the last line or packet, from 1.
    number: u64,
    ended: bool,
    /// True once the first entry, or the magic of pcapng, has shown that the file is a recording.
    is_known: bool,
    /// The unreadable lines before the first entry, and the first entry itself.
    held: VecDeque<Result<Logged, ReadError>>,
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
    /// The bus name of the last entry.
    bus: String,
    line: Vec<u8>,
    /// True if the current line exceeds the maximum length.
    is_too_long: bool,
}

/// The text format of a recording.
enum Style {
    /// Not yet determined: the first line decides, or the extension if the first line is ambiguous.
    Unseen(Format),
    Candump,
    Asc(asc::Parser),
}

/// An entry with its line or packet number, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Logged {
    /// The number of the line or packet, from 1.
    pub number: u64,
    /// The entry.
    pub record: Record,
}

/// The reason why an entry cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// An unreadable line or packet. Reading can continue.
    #[error("{number}: {reason}{}", quoted(text))]
    NoEntry {
        /// The number of the line or packet, from 1.
        number: u64,
        /// The reason.
        reason: &'static str,
        /// The beginning of the unreadable line; empty for a packet.
        text: String,
    },
    /// A read error.
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
    /// [`io::Error`] if the file cannot be opened or read.
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

    /// Reads a recording from `source`, whose content determines the format. A text whose first line is neither ASC nor
    /// candump is read as ASC if `ending` is [`Format::Asc`], otherwise as candump.
    ///
    /// # Errors
    /// [`io::Error`] if `source` cannot be read, or if its first bytes show an unsupported or damaged format.
    pub fn new(mut source: impl Read + Send + 'static, ending: Format) -> io::Result<Self> {
        let mut head = Vec::new();
        (&mut source).take(MAGIC.len() as u64).read_to_end(&mut head)?;
        if let Some(refusal) = foreign::by_magic(&head) {
            return Err(invalid(refusal));
        }
        let is_known = head == MAGIC;
        let whole = Box::new(Cursor::new(head).chain(source));
        let source = if is_known {
            Source::Packets(Box::new(Packets::new(whole)?))
        } else {
            Source::Text(Text {
                input: BufReader::new(whole),
                style: Style::Unseen(ending),
                last: Timestamp::from_micros(0),
                bus: "can0".to_owned(),
                line: Vec::new(),
                is_too_long: false,
            })
        };
        Ok(Self { source, number: 0, ended: false, is_known, held: VecDeque::new() })
    }

    /// Returns the bus name of the last entry.
    #[must_use]
    pub fn bus(&self) -> &str {
        match &self.source {
            Source::Text(text) => &text.bus,
            Source::Packets(packets) => packets.bus(),
        }
    }

    /// Returns whether the buffer is empty, so that the next read may block, as on a pipe.
    #[must_use]
    pub fn may_wait(&self) -> bool {
        match &self.source {
            Source::Text(text) => text.input.buffer().is_empty(),
            Source::Packets(packets) => packets.may_wait(),
        }
    }

    /// Reads the next entry or unreadable line.
    fn read_one(&mut self) -> Option<Result<Logged, ReadError>> {
        loop {
            self.number += 1;
            let number = self.number;
            let none = |reason, text| ReadError::NoEntry { number, reason, text };
            let found = match &mut self.source {
                Source::Packets(packets) => match packets.next()? {
                    Ok(record) => Ok(record),
                    Err(PacketError::Packet(reason)) => Err(none(reason, String::new())),
                    Err(PacketError::End(reason)) => {
                        self.ended = true;
                        Err(none(reason, String::new()))
                    }
                    Err(PacketError::Io) => Err(io::Error::other("the rest of the file cannot be read").into()),
                },
                Source::Text(text) => match text.next_line() {
                    Err(error) => Err(error.into()),
                    Ok(false) if matches!(text.style, Style::Unseen(_)) => Err(invalid(foreign::EMPTY).into()),
                    Ok(false) => return None,
                    Ok(true) => match (text.refusal(), text.entry()) {
                        (Some(reason), _) => Err(invalid(reason).into()),
                        (None, Ok(None)) => continue,
                        (None, Ok(Some(record))) => Ok(record),
                        (None, Err(reason)) => Err(none(reason, text.shown())),
                    },
                },
            };
            self.ended |= matches!(found, Err(ReadError::Io(_)));
            return Some(found.map(|record| Logged { number, record }));
        }
    }
}

/// Returns whether a line cannot come from a recording, not even from a damaged one.
fn is_no_line(read: &Result<Logged, ReadError>) -> bool {
    matches!(read, Err(ReadError::NoEntry { reason: candump::NO_LINE, .. }))
}

impl Iterator for Reader {
    type Item = Result<Logged, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.is_known && !self.ended {
            let read = self.read_one();
            self.is_known = !matches!(read, Some(Err(ReadError::NoEntry { .. })));
            let is_short = read.is_none() && self.held.len() > 1 && self.held.iter().all(is_no_line);
            self.held.extend(read);
            if is_short || self.held.len() >= foreign::LINES && !self.is_known {
                self.ended = true;
                self.held.clear();
                return Some(Err(invalid(foreign::UNKNOWN).into()));
            }
        }
        match self.held.pop_front() {
            None if self.ended => None,
            None => self.read_one(),
            held => held,
        }
    }
}

impl Text {
    /// Reads the next line up to the maximum length. Returns false at the end of the file.
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

    /// Returns the error message if the first line shows that the text has an unsupported format.
    fn refusal(&self) -> Option<&'static str> {
        let line = String::from_utf8_lossy(&self.line);
        let line = line.trim_start_matches('\u{FEFF}').trim();
        let is_first = matches!(self.style, Style::Unseen(_)) && !line.is_empty() && !line.starts_with('#');
        let is_known = || asc::is_head(line) || candump::parse(line).is_ok();
        if is_first && !is_known() { foreign::by_line(line) } else { None }
    }

    /// Parses the current line; `None` for a valid line without an entry.
    fn entry(&mut self) -> Result<Option<Record>, Reason> {
        if self.is_too_long {
            return Err("line too long");
        }
        // ASC files use the encoding of the machine that wrote them.
        let line = String::from_utf8_lossy(&self.line);
        // Windows editors may put a byte order mark at the start of the file.
        let line = line.trim_start_matches('\u{FEFF}');
        if line.trim().is_empty() || line.starts_with('#') {
            return Ok(None);
        }
        if let Style::Unseen(ending) = self.style {
            let is_asc = asc::is_head(line) || (ending == Format::Asc && candump::parse(line).is_err());
            self.style = if is_asc { Style::Asc(asc::Parser::default()) } else { Style::Candump };
        }
        if let Style::Asc(asc) = &mut self.style {
            let before = asc.channel;
            let record = asc.line(line)?;
            if asc.channel != before {
                // ASC channels are numbered from 1, candump names from 0.
                self.bus = format!("can{}", asc.channel.saturating_sub(1));
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
