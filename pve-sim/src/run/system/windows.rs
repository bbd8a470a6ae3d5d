//! Windows: events of the console, and exclusive files.

use std::fs::{File, Metadata, OpenOptions};
use std::io;
use std::os::windows::fs::OpenOptionsExt as _;
use std::path::Path;

use tokio::signal::windows::{
    CtrlBreak, CtrlC, CtrlClose, CtrlLogoff, CtrlShutdown, ctrl_break, ctrl_c, ctrl_close, ctrl_logoff, ctrl_shutdown,
};

/// The console events that end a run.
#[derive(Debug)]
pub(crate) struct Signals {
    interrupt: CtrlC,
    brk: CtrlBreak,
    close: CtrlClose,
    log_off: CtrlLogoff,
    shutdown: CtrlShutdown,
}

impl Signals {
    /// Listens to Ctrl-C, Ctrl-Break, the closed window, and the end of the session and of the system.
    pub(crate) fn install() -> io::Result<Self> {
        Ok(Self {
            interrupt: ctrl_c()?,
            brk: ctrl_break()?,
            close: ctrl_close()?,
            log_off: ctrl_logoff()?,
            shutdown: ctrl_shutdown()?,
        })
    }

    /// Waits for one of the events. After a closed window, a log-off or a shutdown, Windows grants the process some
    /// seconds.
    pub(crate) async fn wait(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.brk.recv() => {}
            _ = self.close.recv() => {}
            _ = self.log_off.recv() => {}
            _ = self.shutdown.recv() => {}
        }
    }
}

/// Returns false immediately: a stdout without a reader is detected by the next line.
pub(in crate::run) const fn wait_for_hangup() -> bool {
    false
}

/// Returns immediately: reads block, and no job is stopped for them.
pub(in crate::run) const fn wait_for_input() -> bool {
    true
}

/// Returns immediately, like [`wait_for_input`].
pub(in crate::run) const fn wait_for_foreground() {}

/// Whether a key stops the job: never on Windows.
pub(in crate::run) const HAS_JOBS: bool = false;

/// Does nothing: no key suspends the job.
pub(in crate::run) const fn suspend() {}

/// Does nothing: the caller ends the run.
pub(in crate::run) const fn interrupt() {}

/// The modes of the console. Only its line editor restores them, because the standard library cannot.
#[derive(Debug)]
pub(in crate::run) struct Modes;

impl Modes {
    /// Returns the modes without a search for the terminal, because a process has at most one console.
    #[expect(clippy::unnecessary_wraps, reason = "Unix has several terminals")]
    pub(in crate::run) const fn of_the_terminal() -> Option<Self> {
        Some(Self)
    }

    /// Does nothing: no key stops a job.
    #[expect(clippy::unused_self, reason = "Unix uses self")]
    pub(in crate::run) const fn without_suspend_key(&self) {}

    /// Does nothing: the shell sets its own modes.
    #[expect(clippy::unused_self, reason = "Unix uses self")]
    pub(in crate::run) const fn restore(&self) {}
}

/// Returns `None`: files and sockets have no common limit.
pub(in crate::run) const fn max_open_files() -> Option<u64> {
    None
}

/// Does nothing: threads have no timer slack.
pub(in crate::run) const fn disable_timer_slack() {}

/// Opens a file for writing, while others may only read it; `None` when another process has it open. A lock would also
/// prevent others from reading.
pub(crate) fn open_exclusively(options: &OpenOptions, path: &Path) -> io::Result<Option<File>> {
    const FILE_SHARE_READ: u32 = 1;
    const ERROR_SHARING_VIOLATION: i32 = 32;

    match options.clone().share_mode(FILE_SHARE_READ).open(path) {
        Ok(file) => Ok(Some(file)),
        Err(error) if error.raw_os_error() == Some(ERROR_SHARING_VIOLATION) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Returns false: the standard library cannot compare the files behind hard links.
pub(in crate::run) const fn is_same_file(_: &Metadata, _: &Metadata) -> bool {
    false
}

/// Returns false, for the same reason.
pub(in crate::run) const fn is_output(_: &Metadata) -> bool {
    false
}
