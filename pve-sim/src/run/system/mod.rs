//! Functions of the operating system beyond the standard library, with a file for each system.
//!
//! | | Linux | macOS | Windows |
//! | --- | --- | --- | --- |
//! | a signal ends the run | SIGINT, SIGTERM, SIGHUP | the same | Ctrl-C, Ctrl-Break, close, log-off, shutdown |
//! | SIGHUP ignored by a parent stays ignored | yes | no | no SIGHUP |
//! | a closed stdout is detected | immediately | with the next line | with the next line |
//! | a job in the background leaves the terminal alone | yes | yes | no such jobs |
//! | the terminal of a line editor is restored | yes | yes | not by Ctrl-Break |
//! | clients limited by the files that may be open | yes | yes | no such limit |
//! | a second name of a file is recognised | links | links | symbolic links |
//! | the file of stdout or stderr is recognised | yes | yes | no |
//! | a log or a results file has one writer | by a lock | by a lock | by how it is opened |
//! | wake-ups without slack | yes | no | no |
//!
//! Windows and macOS are compile-tested only.

#[cfg(unix)]
#[path = "unix.rs"]
mod own;
#[cfg(windows)]
#[path = "windows.rs"]
mod own;

pub(super) use own::{
    HAS_JOBS, Modes, disable_timer_slack, interrupt, is_output, is_same_file, max_open_files, suspend,
    wait_for_foreground, wait_for_hangup, wait_for_input,
};
pub(crate) use own::{Signals, open_exclusively};
