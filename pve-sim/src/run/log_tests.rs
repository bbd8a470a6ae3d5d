//! Files that a log may or must not replace.

use std::fs;

use super::*;
use hal_sim::log::{Entry, Record};

fn log(path: &Path, overwrite: bool) -> LogOptions {
    LogOptions { path: path.to_owned(), overwrite }
}

/// Returns the refusal of a file; empty if it is accepted.
fn refusal(path: &Path, overwrite: bool, state: Option<&Path>) -> String {
    Log::check(&log(path, overwrite), state).err().map(|error| error.to_string()).unwrap_or_default()
}

#[test]
fn a_file_that_has_something_in_it_is_replaced_only_when_that_is_meant() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("frames.log");
    assert_eq!(refusal(&path, false, None), "");
    fs::write(&path, "").unwrap();
    assert_eq!(refusal(&path, false, None), "");
    fs::write(&path, "of yesterday").unwrap();
    let line = refusal(&path, false, None);
    assert!(line.contains("frames.log") && line.contains("--log-overwrite"), "{line}");
    assert_eq!(fs::read_to_string(&path).unwrap(), "of yesterday");
    assert_eq!(refusal(&path, true, None), "");
    let at = Timestamp::from_micros(1_000_000);
    let mut log = Log::create(&log(&path, true), None, "pve0", at).unwrap();
    log.write(|log| log.write(&Record { at, entry: Entry::Frame("080:".parse().unwrap()) })).unwrap();
    log.finish().unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "(1.000000) pve0 080#\n");
}

#[test]
fn what_is_no_regular_file_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    for path in [dir.path(), Path::new("/dev/null"), Path::new("/dev/full")] {
        for overwrite in [false, true] {
            let line = refusal(path, overwrite, None);
            assert!(line.contains("must be a regular file"), "{line}");
        }
    }
}

#[cfg(unix)]
#[test]
fn nothing_in_the_folder_of_the_state_files_is_a_log() {
    let dir = tempfile::tempdir().unwrap();
    let state = dir.path().join("state");
    // Also before the folder exists.
    assert!(refusal(&state.join("frames.log"), false, Some(&state)).contains("--state"));
    fs::create_dir(&state).unwrap();
    let memory = state.join("valve.nvm");
    fs::write(&memory, "stored").unwrap();
    let (soft, hard, round) = (dir.path().join("soft"), dir.path().join("hard"), dir.path().join("state/../state/new"));
    std::os::unix::fs::symlink(&memory, &soft).unwrap();
    fs::hard_link(&memory, &hard).unwrap();
    for path in [&memory, &state.join("frames.log"), &soft, &hard, &round] {
        let line = refusal(path, true, Some(&state));
        assert!(line.contains("--state"), "{}: {line}", path.display());
    }
    // A link in the folder to a memory elsewhere.
    let elsewhere = dir.path().join("elsewhere");
    fs::write(&elsewhere, "stored").unwrap();
    assert_eq!(refusal(&elsewhere, true, Some(&state)), "");
    std::os::unix::fs::symlink(&elsewhere, state.join("other.nvm")).unwrap();
    assert!(refusal(&elsewhere, true, Some(&state)).contains("--state"));
    assert_eq!(fs::read_to_string(&memory).unwrap(), "stored");
}

/// Paths that lead into the folder only once it exists.
#[cfg(unix)]
#[test]
fn a_state_file_that_was_not_there_before_the_log_is_safe_from_it() {
    let dir = tempfile::tempdir().unwrap();
    let (state, link, dangling) = (dir.path().join("state"), dir.path().join("link"), dir.path().join("dangling"));
    std::os::unix::fs::symlink(dir.path(), &link).unwrap();
    std::os::unix::fs::symlink(state.join("valve.nvm"), &dangling).unwrap();
    let logs = [link.join("state/valve.nvm"), dangling];
    for path in &logs {
        assert_eq!(refusal(path, true, Some(&state)), "", "the folder is not there yet");
    }
    fs::create_dir(&state).unwrap();
    fs::write(state.join("valve.nvm"), "stored").unwrap();
    for path in &logs {
        for overwrite in [false, true] {
            let line = Log::create(&log(path, overwrite), Some(&state), "pve0", Timestamp::from_micros(0))
                .unwrap_err()
                .to_string();
            assert!(line.contains("--state"), "{}: {line}", path.display());
        }
    }
    assert_eq!(fs::read_to_string(state.join("valve.nvm")).unwrap(), "stored");
}
