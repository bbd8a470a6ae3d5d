//! A folder of its own for the files of each thread that plays cases.

use std::fs;
use std::path::PathBuf;

use tempfile::TempDir;

thread_local! {
    static FOLDER: TempDir = TempDir::new().expect("a temporary folder");
}

/// Returns the path of a file of that name in the thread's folder.
pub(crate) fn path(name: &str) -> PathBuf {
    FOLDER.with(|folder| folder.path().join(name))
}

/// Writes a file of that name into the thread's folder; returns its path.
pub(crate) fn file(name: &str, content: &[u8]) -> PathBuf {
    let path = path(name);
    fs::write(&path, content).expect("room for a file");
    path
}

/// Asserts that the user gets one line, of a bounded length.
pub(crate) fn assert_one_line(text: &str) {
    assert!(!text.is_empty(), "an empty line");
    assert!(!text.chars().any(char::is_control), "not one line: {text:?}");
}
