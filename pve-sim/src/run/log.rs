//! The file of `--log`: every frame, in the format that the file's extension selects.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::system::{is_output, is_same_file, open_exclusively};
use super::{LogOptions, RunError};
use hal_sim::log::Timestamp;
use hal_sim::recording::{Format, Writer};

/// The buffer holds whole entries, because the writer passes each entry in one piece.
pub(super) type Output = Writer<BufWriter<WholeFile>>;

/// A file to which each write is appended as a whole, or not at all: a truncated line of candump would be another
/// frame.
#[derive(Debug)]
pub(super) struct WholeFile {
    file: File,
    length: u64,
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if let Err(error) = self.file.write_all(bytes) {
            // The first error counts.
            let _ = self.file.set_len(self.length);
            let _ = self.file.seek(SeekFrom::Start(self.length));
            return Err(error);
        }
        self.length += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// The file of `--log`. The file is locked against other runs until this value is dropped.
#[derive(Debug)]
pub(super) struct Log {
    path: PathBuf,
    writer: Output,
}

impl Log {
    /// Refuses a file that a log must not replace; changes nothing. Call this before any file is created.
    ///
    /// # Errors
    /// [`RunError`] for anything but a regular file, for files in the folder of the state files, for a state file
    /// under another name, for the file of stdout or stderr, for the log of another run, and for a non-empty file unless
    /// it may be overwritten.
    pub(super) fn check(log: &LogOptions, state: Option<&Path>) -> Result<(), RunError> {
        Self::check_place(log, state)?;
        if matches!(open_exclusively(OpenOptions::new().write(true), &log.path), Ok(None)) {
            return refuse(log, IN_USE);
        }
        Self::check_content(log)
    }

    fn check_place(log: &LogOptions, state: Option<&Path>) -> Result<(), RunError> {
        if let Some(state) = state
            && is_kept_in(&log.path, state)
        {
            return refuse(log, "a log must not be in the --state folder or replace a state file");
        }
        match fs::metadata(&log.path) {
            Ok(found) if !found.is_file() => refuse(log, "a log must be a regular file"),
            Ok(found) if is_output(&found) => refuse(log, "a log must not be the file of stdout or stderr"),
            _ => Ok(()),
        }
    }

    fn check_content(log: &LogOptions) -> Result<(), RunError> {
        match fs::metadata(&log.path) {
            Ok(found) if found.len() > 0 && !log.overwrite => {
                refuse(log, "the file is not empty; --log-overwrite overwrites it")
            }
            _ => Ok(()),
        }
    }

    /// Opens and truncates the file, and begins the log of a bus at the given time. Call this after the state files
    /// exist.
    ///
    /// # Errors
    /// [`RunError`] when the file cannot be opened, or as [`check`](Self::check), whose checks are repeated
    /// because links and folders may have appeared since.
    pub(super) fn create(
        log: &LogOptions,
        state: Option<&Path>,
        bus: &str,
        start: Timestamp,
    ) -> Result<Self, RunError> {
        let failed = |error| RunError::file(&log.path, error);
        // Truncated only after the second check.
        let mut options = OpenOptions::new();
        let file = open_exclusively(options.write(true).create(true).truncate(false), &log.path).map_err(failed)?;
        let Some(file) = file else { return refuse(log, IN_USE) };
        Self::check_place(log, state)?;
        Self::check_content(log)?;
        file.set_len(0).map_err(failed)?;
        let file = BufWriter::new(WholeFile { file, length: 0 });
        let writer = Writer::new(file, Format::of(&log.path), bus, start).map_err(failed)?;
        Ok(Self { path: log.path.clone(), writer })
    }

    /// Writes to the log; the error is the message for the user.
    pub(super) fn write(&mut self, act: impl FnOnce(&mut Output) -> io::Result<()>) -> Result<(), String> {
        act(&mut self.writer).map_err(|error| complaint(&self.path, &error))
    }

    /// Writes the end of the log; the error is the message for the user.
    pub(super) fn finish(self) -> Result<(), String> {
        self.writer.finish().map(drop).map_err(|error| complaint(&self.path, &error))
    }
}

const IN_USE: &str = "another pve-sim is writing to this log";

fn refuse<T>(log: &LogOptions, reason: &str) -> Result<T, RunError> {
    Err(RunError::file(&log.path, reason))
}

fn complaint(path: &Path, error: &io::Error) -> String {
    format!("{}: {error}; logging has stopped", path.display())
}

/// Returns whether a path leads into a folder, or is another name of a file in the folder.
fn is_kept_in(path: &Path, folder: &Path) -> bool {
    let Ok(folder) = fs::canonicalize(folder) else {
        // The folder does not exist yet, so the paths are compared.
        return std::path::absolute(path)
            .ok()
            .zip(std::path::absolute(folder).ok())
            .is_some_and(|(p, f)| p.starts_with(f));
    };
    let within = fs::canonicalize(path).or_else(|_| {
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Ok::<_, io::Error>(fs::canonicalize(parent)?.join(path.file_name().unwrap_or_default()))
    });
    if within.is_ok_and(|path| path.starts_with(&folder)) {
        return true;
    }
    let (Ok(found), Ok(files)) = (fs::metadata(path), fs::read_dir(&folder)) else { return false };
    files.filter_map(|file| fs::metadata(file.ok()?.path()).ok()).any(|file| is_same_file(&file, &found))
}

#[cfg(test)]
#[path = "log_tests.rs"]
mod tests;
