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

pub use reader::{Logged, ReadError, Reader};
pub use writer::Writer;

use std::io;
use std::path::Path;

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

fn invalid(reason: &'static str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason)
}

#[cfg(test)]
mod tests;
