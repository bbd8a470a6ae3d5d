//! Unix: signals, polling, terminal modes and file locks.

use std::fs::{File, Metadata, OpenOptions, TryLockError};
use std::io;
use std::os::fd::AsFd as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::task::Poll;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::fstat;
use rustix::io::Errno;
use rustix::process::{Resource, Signal, getpgrp, getrlimit, kill_current_process_group};
use rustix::termios::{OptionalActions, SpecialCodeIndex, Termios, tcgetattr, tcgetpgrp, tcsetattr};
use tokio::runtime::Builder;
use tokio::signal::unix::{self, SignalKind, signal};
use tokio::time::timeout;

/// The interval at which a background job checks whether it has returned to the foreground. Until then the shell reads
/// the terminal's input.
const BACKGROUND: Duration = Duration::from_millis(200);

/// The maximum time to wait for the stop and continuation of this job, because without a shell the system ignores the
/// stop signal. A stopped process does not time out until it is continued.
const STOP: Duration = Duration::from_secs(2);

/// The signals that end a run.
#[derive(Debug)]
pub(crate) struct Signals(Vec<unix::Signal>);

impl Signals {
    /// Installs handlers of SIGINT, SIGTERM and SIGHUP, except for a SIGHUP that is ignored, as under `nohup`.
    pub(crate) fn install() -> io::Result<Self> {
        let mut kinds = vec![SignalKind::interrupt(), SignalKind::terminate()];
        if !hangup_is_ignored() {
            kinds.push(SignalKind::hangup());
        }
        kinds.into_iter().map(signal).collect::<io::Result<_>>().map(Self)
    }

    pub(crate) async fn wait(&mut self) {
        std::future::poll_fn(|context| {
            let came = self.0.iter_mut().any(|signal| signal.poll_recv(context).is_ready());
            if came { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
    }
}

/// Returns whether this process was started with SIGHUP ignored. Always `false` except on Linux, where `/proc` has the
/// ignored signals.
fn hangup_is_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    ignores_hangup(&status)
}

/// Returns whether the ignored signals in the text of `/proc/self/status`, a hex mask, include SIGHUP, the lowest bit.
fn ignores_hangup(status: &str) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask & 1 != 0)
}

/// Waits until stdout has lost its reader, and returns `true`; returns `false` if the loss cannot be detected. A file
/// never loses its reader.
pub(in crate::run) fn wait_for_hangup() -> bool {
    let stdout = io::stdout();
    loop {
        // Without requested events, poll returns only for an error or a hang-up.
        let mut polled = [PollFd::from_borrowed_fd(stdout.as_fd(), PollFlags::empty())];
        match poll(&mut polled, None) {
            Err(Errno::INTR) => {}
            Err(_) => return false,
            Ok(_) => return polled[0].revents().intersects(PollFlags::ERR | PollFlags::HUP),
        }
    }
}

/// Waits until stdin is readable, and returns `true`; returns `false` if stdin cannot be polled. A background job also
/// waits for the foreground, because the system stops a background job that reads from its terminal.
pub(in crate::run) fn wait_for_input() -> bool {
    let stdin = io::stdin();
    loop {
        let mut polled = [PollFd::new(&stdin, PollFlags::IN)];
        match poll(&mut polled, None) {
            Err(Errno::INTR) => continue,
            Err(_) => return false,
            Ok(_) => {}
        }
        if !is_in_background() {
            return true;
        }
        std::thread::sleep(BACKGROUND);
    }
}

/// Waits until this job may use the terminal.
pub(in crate::run) fn wait_for_foreground() {
    while is_in_background() {
        std::thread::sleep(BACKGROUND);
    }
}

fn is_in_background() -> bool {
    tcgetpgrp(io::stdin()).is_ok_and(|foreground| foreground != getpgrp())
}

/// Whether a key can stop the job, which the shell then continues in the background or foreground.
pub(in crate::run) const HAS_JOBS: bool = true;

/// Stops this job, as the terminal does for Ctrl-Z. Returns once the job is continued, or after [`STOP`] if the job was
/// not stopped.
pub(in crate::run) fn suspend() {
    let Ok(runtime) = Builder::new_current_thread().enable_all().build() else { return };
    runtime.block_on(async {
        let continued = signal(SignalKind::from_raw(Signal::CONT.as_raw()));
        let _ = kill_current_process_group(Signal::TSTP);
        if let Ok(mut continued) = continued {
            // Another thread may take the signal, which then stops this thread a little later. Until then, this thread
            // must not touch the terminal, which the shell is about to take.
            let _ = timeout(STOP, continued.recv()).await;
        }
    });
}

/// Interrupts this job, as the terminal does for Ctrl-C.
pub(in crate::run) fn interrupt() {
    let _ = kill_current_process_group(Signal::INT);
}

/// The modes of the terminal.
#[derive(Debug)]
pub(in crate::run) struct Modes(Termios);

impl Modes {
    /// Returns the modes of the terminal, if stdin, stdout and stderr are the same one.
    pub(in crate::run) fn of_the_terminal() -> Option<Self> {
        let device = fstat(io::stdin()).ok()?.st_rdev;
        let is_one = fstat(io::stdout()).ok()?.st_rdev == device && fstat(io::stderr()).ok()?.st_rdev == device;
        tcgetattr(io::stdin()).ok().filter(|_| is_one).map(Self)
    }

    /// Makes Ctrl-Z a character for the line editor, also between two lines. Otherwise the terminal could stop the job
    /// at any point; after continuation in the background, its next access to the terminal would stop it again.
    pub(in crate::run) fn without_suspend_key(&self) {
        let mut modes = self.0.clone();
        modes.special_codes[SpecialCodeIndex::VSUSP] = NO_KEY;
        set(&modes);
    }

    /// Restores the modes, unless the terminal belongs to another job.
    pub(in crate::run) fn restore(&self) {
        set(&self.0);
    }
}

fn set(modes: &Termios) {
    if !is_in_background() {
        // Without waiting for the output: a terminal with blocked output would never drain.
        let _ = tcsetattr(io::stdin(), OptionalActions::Now, modes);
    }
}

/// The value that disables a special character of the terminal, `_POSIX_VDISABLE`.
const NO_KEY: u8 = if cfg!(target_os = "linux") { 0 } else { 0xFF };

/// Returns the limit of open files; `None` without a limit.
pub(in crate::run) fn max_open_files() -> Option<u64> {
    getrlimit(Resource::Nofile).current
}

/// Sets the timer slack of this thread to 1 ns: Linux would delay each wake-up by up to 50 µs to combine several.
pub(in crate::run) fn disable_timer_slack() {
    #[cfg(target_os = "linux")]
    let _ = rustix::thread::set_current_timer_slack(std::num::NonZeroU64::new(1));
}

/// Opens a file for writing, with a lock against other calls of this function; `None` when another process has it. File
/// systems without locks are not protected.
pub(crate) fn open_exclusively(options: &OpenOptions, path: &Path) -> io::Result<Option<File>> {
    let file = options.open(path)?;
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => Ok(None),
        Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => Ok(Some(file)),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

pub(in crate::run) fn is_same_file(one: &Metadata, other: &Metadata) -> bool {
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

/// Returns whether stdout or stderr is a file.
pub(in crate::run) fn is_output(file: &Metadata) -> bool {
    let outputs = [io::stdout().as_fd().try_clone_to_owned(), io::stderr().as_fd().try_clone_to_owned()];
    outputs.into_iter().flatten().any(|output| File::from(output).metadata().is_ok_and(|of| is_same_file(&of, file)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_signals_that_are_ignored_are_read_from_the_status() {
        assert!(ignores_hangup("Name:\tpve-sim\nSigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\n"));
        assert!(!ignores_hangup("Name:\tpve-sim\nSigIgn:\t0000000000001000\nSigCgt:\t0000000000000001\n"));
        assert!(!ignores_hangup(""));
    }
}
