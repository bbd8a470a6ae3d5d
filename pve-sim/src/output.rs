//! The output of commands, and their errors. A write error of stdout is reported at the end of the command.

use std::fmt::Display;
use std::io::{self, Write};
use std::path::Path;

/// The reason why a command did not run to its end.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// Wrong usage, such as a file that cannot be read; one line for each file.
    #[error("{0}")]
    Refused(String),
    /// Any other failure.
    #[error("{0}")]
    Failed(String),
}

impl CommandError {
    /// Returns the failure of a file.
    pub(crate) fn of(path: &Path, reason: impl Display) -> Self {
        Self::Failed(format!("{}: {reason}", path.display()))
    }

    /// Returns the failure to write the file of an option.
    pub(crate) fn unwritten(option: &str, path: &Path, error: &io::Error) -> Self {
        Self::Failed(format!("{option} {}: {error}", path.display()))
    }
}

/// The output of a command. After an error, further writes are dropped, and [`finish`](Self::finish) reports the error.
#[derive(Debug)]
pub struct Output<W: Write> {
    out: W,
    failure: Option<io::Error>,
}

impl<W: Write> Output<W> {
    /// Creates an output that writes to `out`.
    pub const fn new(out: W) -> Self {
        Self { out, failure: None }
    }

    /// Flushes the output.
    ///
    /// # Errors
    /// The first error of `out`. A closed pipe is not an error, because its reader needs no more output.
    pub fn finish(mut self) -> io::Result<()> {
        let flushed = self.flush();
        debug_assert!(flushed.is_ok());
        match self.failure {
            Some(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error),
            _ => Ok(()),
        }
    }

    /// Applies a function to `out`; does nothing after an error.
    fn attempt<T>(&mut self, otherwise: T, act: impl FnOnce(&mut W) -> io::Result<T>) -> io::Result<T> {
        if self.failure.is_some() {
            return Ok(otherwise);
        }
        match act(&mut self.out) {
            Err(error) if error.kind() != io::ErrorKind::Interrupted => {
                self.failure = Some(error);
                Ok(otherwise)
            }
            done => done,
        }
    }
}

impl<W: Write> Write for Output<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(bytes.len(), |out| out.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.attempt((), Write::flush)
    }
}

/// Makes a write beyond the file size limit (`ulimit -f`) return an error, as on a full disk. By default, Unix ends the
/// process with a signal.
#[cfg(unix)]
pub fn outlive_file_size_limit() {
    use tokio::signal::unix::{SignalKind, signal};

    // The handler stays installed for the rest of the process. If it fails, the signal keeps its effect.
    if let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_io().build() {
        let _context = runtime.enter();
        drop(signal(SignalKind::from_raw(rustix::process::Signal::XFSZ.as_raw())));
    }
}

/// Does nothing: Windows has no such limit.
#[cfg(not(unix))]
pub const fn outlive_file_size_limit() {}

#[cfg(test)]
mod tests {
    use super::*;

    /// A writer with space for some bytes.
    struct Room(usize, io::ErrorKind);

    impl Write for Room {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let room = bytes.len().min(self.0);
            self.0 -= room;
            if room == 0 { Err(self.1.into()) } else { Ok(room) }
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn what_does_not_come_to_its_place_is_told_at_the_end() {
        for (room, kind, told) in [
            (3, io::ErrorKind::StorageFull, Some(io::ErrorKind::StorageFull)),
            (3, io::ErrorKind::BrokenPipe, None),
            (20, io::ErrorKind::StorageFull, None),
        ] {
            let mut output = Output::new(Room(room, kind));
            for _ in 0..5 {
                output.write_all(b"abcd").unwrap();
            }
            assert_eq!(output.finish().err().map(|error| error.kind()), told);
        }
    }
}
