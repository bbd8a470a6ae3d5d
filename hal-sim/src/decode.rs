//! `pve-sim decode`: explains a recording line by line, with the same texts as the live trace.

use std::io::{self, Write};
use std::path::PathBuf;

use crate::devices::NamedDevice;
use crate::explain::{Explainer, Node, explain_error_frame};
use crate::log::Entry;
use crate::log::candump::write_entry;
use crate::recording::{Logged, ReadError, Reader};

/// The options of `decode`.
#[derive(Clone, Debug, PartialEq)]
pub struct DecodeOptions {
    /// The recording; `-` reads stdin.
    pub file: PathBuf,
    /// The known devices on the recorded bus.
    pub devices: Vec<NamedDevice>,
}

/// An error of [`decode`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The recording cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The output cannot be written.
    #[error("stdout: {0}")]
    Write(#[from] io::Error),
}

/// Writes each line of a recording with its explanation to `out`, and passes a message about each unreadable line to
/// `warn`. Returns whether every line was readable. If `out` is a closed pipe, decoding ends early without an error.
///
/// # Errors
/// [`DecodeError`] if the recording cannot be read or `out` cannot be written.
pub fn decode(options: &DecodeOptions, out: &mut impl Write, mut warn: impl FnMut(&str)) -> Result<bool, DecodeError> {
    let mut all_read = true;
    let warn = |line: &str| {
        all_read = false;
        warn(line);
    };
    match explain(options, out, warn) {
        Err(DecodeError::Write(error)) if error.kind() == io::ErrorKind::BrokenPipe => {}
        explained => explained?,
    }
    Ok(all_read)
}

fn explain(options: &DecodeOptions, out: &mut impl Write, mut warn: impl FnMut(&str)) -> Result<(), DecodeError> {
    let unread = |source| DecodeError::Read { path: options.file.clone(), source };
    let mut reader = Reader::open(&options.file).map_err(unread)?;
    let node = |device: &NamedDevice| Node {
        name: device.name.clone(),
        kind: device.setup.kind,
        node_id: device.setup.node_id,
    };
    let mut explainer = Explainer::new(options.devices.iter().map(node).collect());
    let mut line = String::new();
    loop {
        // Flushes before a read that may block, so that all explanations so far are visible.
        if reader.may_wait() {
            out.flush()?;
        }
        match reader.next() {
            None => return Ok(out.flush()?),
            Some(Ok(Logged { record, .. })) => {
                line.clear();
                write_entry(&mut line, record.at, reader.bus(), &record.entry);
                let meaning = match &record.entry {
                    Entry::Frame(frame) => {
                        explainer.learn(frame);
                        let meaning = explainer.explain(frame, None);
                        explainer.observe(frame);
                        meaning
                    }
                    Entry::Error(error) => explain_error_frame(error),
                };
                writeln!(out, "{line}  {meaning}")?;
            }
            Some(Err(error @ ReadError::NoEntry { .. })) => {
                // Keeps the order of lines and messages if both outputs share a terminal.
                out.flush()?;
                warn(&format!("{}:{error}", options.file.display()));
            }
            Some(Err(ReadError::Io(source))) => {
                out.flush()?;
                return Err(unread(source));
            }
        }
    }
}
