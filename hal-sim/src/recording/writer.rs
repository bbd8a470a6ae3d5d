//! Writes recordings in all formats.

use std::fmt::Write as _;
use std::io::{self, Write};

use super::{Format, asc, pcapng};
use crate::log::candump::write_entry;
use crate::log::{Record, Timestamp};

/// A writer of a recording. It passes each entry to its output in one piece.
#[derive(Debug)]
pub struct Writer<W> {
    out: W,
    bus: String,
    style: Style,
    /// The reusable buffer of the current line.
    line: String,
}

/// The writer state of each format.
#[derive(Debug)]
enum Style {
    Candump,
    /// The time of the measurement start, to which all times refer.
    Asc(Timestamp),
    /// The comments that the next packet will contain, and the time of the last comment.
    Pcapng(Vec<String>, Timestamp),
}

impl<W: Write> Writer<W> {
    /// Creates a recording that starts at `start`, and writes the file header.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn new(mut out: W, format: Format, bus: &str, start: Timestamp) -> io::Result<Self> {
        let style = match format {
            Format::Candump => Style::Candump,
            Format::Asc => Style::Asc(asc::write_head(&mut out, start)?),
            Format::Pcapng => {
                pcapng::write_head(&mut out, bus)?;
                Style::Pcapng(Vec::new(), start)
            }
        };
        Ok(Self { out, bus: bus.to_owned(), style, line: String::new() })
    }

    /// Adds an entry.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn write(&mut self, record: &Record) -> io::Result<()> {
        match &mut self.style {
            Style::Candump => {
                self.line.clear();
                write_entry(&mut self.line, record.at, &self.bus, &record.entry);
                // Writing to a string cannot fail.
                let _ = self.line.write_char('\n');
                self.out.write_all(self.line.as_bytes())
            }
            Style::Asc(origin) => asc::write(&mut self.out, *origin, record),
            Style::Pcapng(comments, _) => pcapng::write(&mut self.out, record, &std::mem::take(comments)),
        }
    }

    /// Adds a comment, if the format supports comments. The tools for candump logs refuse lines without a frame.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn comment(&mut self, at: Timestamp, text: &str) -> io::Result<()> {
        match &mut self.style {
            Style::Candump => Ok(()),
            Style::Asc(origin) => asc::write_comment(&mut self.out, *origin, at, text),
            Style::Pcapng(comments, last) => {
                comments.push(text.to_owned());
                *last = at;
                Ok(())
            }
        }
    }

    /// Flushes `out`.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// Writes the end of the file and flushes.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn finish(mut self) -> io::Result<W> {
        match &self.style {
            Style::Asc(_) => asc::write_end(&mut self.out)?,
            Style::Pcapng(comments, last) if !comments.is_empty() => {
                pcapng::write_end(&mut self.out, *last, comments)?;
            }
            Style::Candump | Style::Pcapng(..) => {}
        }
        self.out.flush()?;
        Ok(self.out)
    }
}
