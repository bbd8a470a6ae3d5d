//! Reads recordings in all formats. The content determines the format; for ambiguous text, the extension decides.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::Path;

use super::pcapng::{MAGIC, Packets};
use super::{Format, Logged, ReadError, asc, foreign, invalid};
use crate::log::candump;
use crate::log::{Reason, Record, Timestamp};

/// The maximum length of a line in bytes, far above the line length of any supported format.
const LINE_MAX: u64 = 4096;

/// The maximum length of an unreadable line quoted in messages, in characters.
const SHOWN: usize = 80;

/// A reader of a recording, entry by entry.
pub struct Reader {
    source: Source,
    /// The unreadable lines before the first entry, and the first entry itself.
    held: VecDeque<Result<Logged, ReadError>>,
    ended: bool,
}

enum Source {
    Text(Box<Text>),
    Packets(Box<Packets>),
}

struct Text {
    input: BufReader<Box<dyn Read + Send>>,
    style: Style,
    /// The time of the last entry.
    last: Timestamp,
    /// The bus name of the last entry.
    bus: String,
    /// The number of the current line, from 1.
    number: u64,
    /// The current line, as it was read.
    bytes: Vec<u8>,
    line: String,
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
    /// [`io::Error`] if `source` cannot be read, or if its beginning shows an unsupported or damaged format.
    pub fn new(mut source: impl Read + Send + 'static, ending: Format) -> io::Result<Self> {
        let mut head = Vec::new();
        (&mut source).take(MAGIC.len() as u64).read_to_end(&mut head)?;
        if let Some(refusal) = foreign::by_magic(&head) {
            return Err(invalid(refusal));
        }
        let is_packets = head == MAGIC;
        let whole = Box::new(Cursor::new(head).chain(source));
        if is_packets {
            let source = Source::Packets(Box::new(Packets::new(whole)?));
            return Ok(Self { source, held: VecDeque::new(), ended: false });
        }
        let mut text = Text {
            input: BufReader::new(whole),
            style: Style::Unseen(ending),
            last: Timestamp::from_micros(0),
            bus: "can0".to_owned(),
            number: 0,
            bytes: Vec::new(),
            line: String::new(),
            is_too_long: false,
        };
        let held = text.read_head()?;
        Ok(Self { source: Source::Text(Box::new(text)), held, ended: false })
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
}

impl Iterator for Reader {
    type Item = Result<Logged, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        if !self.held.is_empty() || self.ended {
            return self.held.pop_front();
        }
        let read = match &mut self.source {
            Source::Text(text) => text.next(),
            Source::Packets(packets) => packets.next(),
        };
        self.ended = matches!(read, Ok(None) | Err(ReadError::Io(_)));
        read.transpose()
    }
}

impl Text {
    /// Reads up to the first entry. Returns this entry, after the unreadable lines before it. Refuses a text that
    /// begins with too many unreadable lines, or has only lines that cannot come from a recording.
    fn read_head(&mut self) -> io::Result<VecDeque<Result<Logged, ReadError>>> {
        let mut held = VecDeque::new();
        while held.len() < foreign::LINES {
            match self.next() {
                Err(ReadError::Io(error)) => return Err(error),
                Ok(None) if held.len() > 1 && held.iter().all(is_no_line) => break,
                Ok(None) => return Ok(held),
                Ok(Some(logged)) => {
                    held.push_back(Ok(logged));
                    return Ok(held);
                }
                Err(unreadable) => held.push_back(Err(unreadable)),
            }
        }
        Err(invalid(foreign::UNKNOWN))
    }

    /// Reads the next entry or unreadable line. Returns `None` at the end of the file.
    fn next(&mut self) -> Result<Option<Logged>, ReadError> {
        while self.next_line()? {
            self.number += 1;
            let (number, is_blank) = (self.number, is_blank(&self.line));
            if !is_blank {
                self.find_style()?;
            }
            let found = match self.is_too_long {
                true => Err("line too long"),
                false if is_blank => continue,
                false => self.entry(),
            };
            match found {
                Ok(None) => {}
                Ok(Some(record)) => return Ok(Some(Logged { number, record })),
                Err(reason) => {
                    let text = self.line.trim().chars().take(SHOWN).collect();
                    return Err(ReadError::NoEntry { number, reason, text });
                }
            }
        }
        if matches!(self.style, Style::Unseen(_)) { Err(invalid(foreign::EMPTY).into()) } else { Ok(None) }
    }

    /// Reads the next line up to the maximum length. Returns false at the end of the file.
    fn next_line(&mut self) -> io::Result<bool> {
        self.bytes.clear();
        if (&mut self.input).take(LINE_MAX).read_until(b'\n', &mut self.bytes)? == 0 {
            return Ok(false);
        }
        self.is_too_long = !self.bytes.ends_with(b"\n") && self.bytes.len() as u64 == LINE_MAX;
        if self.is_too_long {
            self.input.skip_until(b'\n')?;
        }
        self.line.clear();
        // ASC files use the encoding of the machine that wrote them. Windows editors may put a byte order mark at the
        // start of the file.
        self.line.push_str(String::from_utf8_lossy(&self.bytes).trim_start_matches('\u{FEFF}'));
        Ok(true)
    }

    /// Determines the format from the first line that is not blank. Refuses a line that shows an unsupported format.
    fn find_style(&mut self) -> io::Result<()> {
        let Style::Unseen(ending) = self.style else { return Ok(()) };
        let (is_asc, is_candump) = (asc::is_head(&self.line), candump::parse(&self.line).is_ok());
        if let Some(refusal) = foreign::by_line(self.line.trim()).filter(|_| !is_asc && !is_candump) {
            return Err(invalid(refusal));
        }
        if !self.is_too_long {
            let is_asc = is_asc || (ending == Format::Asc && !is_candump);
            self.style = if is_asc { Style::Asc(asc::Parser::default()) } else { Style::Candump };
        }
        Ok(())
    }

    /// Parses the current line; `None` for a valid line without an entry.
    fn entry(&mut self) -> Result<Option<Record>, Reason> {
        if let Style::Asc(asc) = &mut self.style {
            let before = asc.channel;
            let record = asc.line(&self.line)?;
            if asc.channel != before {
                // ASC channels are numbered from 1, candump names from 0.
                self.bus = format!("can{}", asc.channel.saturating_sub(1));
            }
            return Ok(record);
        }
        let (at, bus, entry) = candump::parse(&self.line)?;
        if self.bus != bus {
            bus.clone_into(&mut self.bus);
        }
        self.last = at.unwrap_or(self.last);
        Ok(Some(Record { at: self.last, entry }))
    }
}

/// Returns whether a line is blank, a comment, or the ready line, with which the output of a run begins.
fn is_blank(line: &str) -> bool {
    line.trim().is_empty() || line.starts_with('#') || line.starts_with("pve-sim ready ")
}

/// Returns whether a line cannot come from a recording, not even from a damaged one.
fn is_no_line(read: &Result<Logged, ReadError>) -> bool {
    matches!(read, Err(ReadError::NoEntry { reason: candump::NO_LINE, .. }))
}
