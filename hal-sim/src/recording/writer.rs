//! Writes recordings in any format.

use std::fmt::Write as _;
use std::io::{self, Write};

use super::{Format, asc, pcapng};
use crate::log::candump::write_entry;
use crate::log::{Record, Timestamp};

/// Writes a recording.
#[derive(Debug)]
pub struct Writer<W> {
    out: W,
    bus: String,
    style: Style,
    /// The current line; the buffer is reused.
    line: String,
}

/// The state of a format.
#[derive(Debug)]
enum Style {
    Candump,
    /// The origin of the times.
    Asc(Timestamp),
    /// The comments of the next packet.
    Pcapng(Vec<String>),
}

impl<W: Write> Writer<W> {
    /// Starts a recording at a time, and writes the file header.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn new(mut out: W, format: Format, bus: &str, start: Timestamp) -> io::Result<Self> {
        let style = match format {
            Format::Candump => Style::Candump,
            Format::Asc => Style::Asc(asc::write_head(&mut out, start)?),
            Format::Pcapng => {
                pcapng::write_head(&mut out, bus)?;
                Style::Pcapng(Vec::new())
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
            Style::Pcapng(comments) => pcapng::write(&mut self.out, record, std::mem::take(comments)),
        }
    }

    /// Adds a comment at a time, where the format has comments: tools for the logs of candump refuse lines without a
    /// frame.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn comment(&mut self, at: Timestamp, text: &str) -> io::Result<()> {
        match &mut self.style {
            Style::Candump => Ok(()),
            Style::Asc(origin) => asc::write_comment(&mut self.out, *origin, at, text),
            Style::Pcapng(comments) => {
                comments.push(text.to_owned());
                Ok(())
            }
        }
    }

    /// Flushes the recording to the system.
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
        if let Style::Asc(_) = self.style {
            asc::write_end(&mut self.out)?;
        }
        self.out.flush()?;
        Ok(self.out)
    }
}
