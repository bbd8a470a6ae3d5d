//! The folders for the files of each thread that plays cases.

use std::fs;
use std::path::PathBuf;

use tempfile::TempDir;

thread_local! {
    static FOLDER: TempDir = TempDir::new().expect("a temporary folder");
}

/// Returns the path of a file in the folder of the thread.
pub(crate) fn path(name: &str) -> PathBuf {
    FOLDER.with(|folder| folder.path().join(name))
}

/// Writes a file into the folder of the thread. Returns its path.
pub(crate) fn file(name: &str, content: &[u8]) -> PathBuf {
    let path = path(name);
    fs::write(&path, content).expect("room for a file");
    path
}

/// Asserts that the user gets one line of limited length.
pub(crate) fn assert_one_line(text: &str) {
    assert!(!text.is_empty(), "an empty line");
    assert!(!text.chars().any(char::is_control), "not one line: {text:?}");
}
