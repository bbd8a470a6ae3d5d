//! The file of `--log`: every frame, in the format of `candump -L`.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use super::RunError;

/// The file of `--log`, a new one.
#[derive(Debug)]
pub(super) struct Log {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Log {
    pub(super) fn create(path: &Path) -> Result<Self, RunError> {
        match File::create(path) {
            Ok(file) => Ok(Self { path: path.to_owned(), file: BufWriter::new(file) }),
            Err(source) => Err(RunError::File { path: path.to_owned(), source }),
        }
    }

    /// Adds a line; the error is the line for the user.
    pub(super) fn write(&mut self, line: &str) -> Result<(), String> {
        writeln!(self.file, "{line}").map_err(|error| self.complaint(&error))
    }

    /// Hands everything to the system; the error is the line for the user.
    pub(super) fn flush(&mut self) -> Result<(), String> {
        self.file.flush().map_err(|error| self.complaint(&error))
    }

    fn complaint(&self, error: &std::io::Error) -> String {
        format!("{}: {error}; nothing more is logged", self.path.display())
    }
}
