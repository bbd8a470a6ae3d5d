//! Recordings of a bus in files: written by `--log`, read by `decode` and `replay`.
//!
//! ```text
//! writer   writes a file in any format
//! reader   reads a file in any format, entry by entry
//! asc      the format of Vector's tools; candump's is in `log`
//! pcapng   the format of Wireshark
//! date     dates of ASC
//! foreign  files in unsupported formats, which are refused
//! ```
//!
//! A recording is processed entry by entry, never loaded as a whole.

mod asc;
mod date;
mod foreign;
mod pcapng;
mod reader;
mod writer;

pub use reader::Reader;
pub use writer::Writer;

use std::io;
use std::path::Path;

use crate::log::Record;

/// The format of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// The log format of `candump -L`.
    Candump,
    /// Vector's ASC.
    Asc,
    /// pcapng with the link type of SocketCAN.
    Pcapng,
}

impl Format {
    /// Returns the format for a file name: `.asc` or `.pcapng`; `candump -L` for any other extension.
    #[must_use]
    pub fn of(path: &Path) -> Self {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        if ending.eq_ignore_ascii_case("asc") {
            Self::Asc
        } else if ending.eq_ignore_ascii_case("pcapng") {
            Self::Pcapng
        } else {
            Self::Candump
        }
    }
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

fn invalid(reason: &'static str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason)
}

#[cfg(test)]
mod tests;
