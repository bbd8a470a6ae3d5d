//! Unix: signals and poll.

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
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcgetpgrp, tcsetattr};
use tokio::signal::unix::{self, SignalKind, signal};

/// The time between two looks at whose the terminal is: the shell reads what is typed now, and needs time to do so.
const BACKGROUND: Duration = Duration::from_millis(200);

/// The signals that end a run.
#[derive(Debug)]
pub(in crate::run) struct Signals(Vec<unix::Signal>);

impl Signals {
    /// Listens to SIGINT, SIGTERM and SIGHUP; not to a SIGHUP that is ignored, as under `nohup`.
    pub(in crate::run) fn listen() -> io::Result<Self> {
        let mut kinds = vec![SignalKind::interrupt(), SignalKind::terminate()];
        if !hangup_is_ignored() {
            kinds.push(SignalKind::hangup());
        }
        kinds.into_iter().map(signal).collect::<io::Result<_>>().map(Self)
    }

    /// Waits for one of the signals.
    pub(in crate::run) async fn come(&mut self) {
        std::future::poll_fn(|context| {
            let came = self.0.iter_mut().any(|signal| signal.poll_recv(context).is_ready());
            if came { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
    }
}

/// Returns whether this process was started with SIGHUP ignored. Only Linux tells that to safe code.
fn hangup_is_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    ignores_hangup(&status)
}

/// Reads the mask of ignored signals, a hex number; SIGHUP is its lowest bit.
fn ignores_hangup(status: &str) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask & 1 != 0)
}

/// Waits until nobody reads stdout; returns whether that was found out. A file has no reader.
pub(in crate::run) fn wait_for_hangup() -> bool {
    let stdout = io::stdout();
    loop {
        // With no event asked for, poll returns for an error or a hang-up only.
        let mut polled = [PollFd::from_borrowed_fd(stdout.as_fd(), PollFlags::empty())];
        match poll(&mut polled, None) {
            Err(Errno::INTR) => {}
            Err(_) => return false,
            Ok(_) => return polled[0].revents().intersects(PollFlags::ERR | PollFlags::HUP),
        }
    }
}

/// Waits until stdin can be read; returns whether there is one. A job in the background must not read from its
/// terminal: the system would stop it.
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

/// Returns false in the foreground, and without a terminal.
fn is_in_background() -> bool {
    tcgetpgrp(io::stdin()).is_ok_and(|foreground| foreground != getpgrp())
}

/// Whether a key stops a job, which the shell continues in the background or in the foreground.
pub(in crate::run) const HAS_JOBS: bool = true;

/// Stops this job, as the terminal does for Ctrl-Z. Returns when it goes on, or when nobody could continue it.
pub(in crate::run) fn suspend() {
    let _ = kill_current_process_group(Signal::TSTP);
    // Another thread may take the signal, and stops this one a little later.
    std::thread::sleep(BACKGROUND);
}

/// Interrupts this job, as the terminal does for Ctrl-C.
pub(in crate::run) fn interrupt() {
    let _ = kill_current_process_group(Signal::INT);
}

/// The modes of the terminal.
#[derive(Debug)]
pub(in crate::run) struct Modes(Termios);

impl Modes {
    /// Returns the modes of the terminal that is stdin, stdout and stderr; `None` when they are not one.
    pub(in crate::run) fn of_the_terminal() -> Option<Self> {
        let device = fstat(io::stdin()).ok()?.st_rdev;
        let is_one = fstat(io::stdout()).ok()?.st_rdev == device && fstat(io::stderr()).ok()?.st_rdev == device;
        tcgetattr(io::stdin()).ok().filter(|_| is_one).map(Self)
    }

    /// Restores them, unless the terminal is another job's.
    pub(in crate::run) fn restore(&self) {
        if !is_in_background() {
            // At once: a terminal that takes no output would never drain.
            let _ = tcsetattr(io::stdin(), OptionalActions::Now, &self.0);
        }
    }
}

/// Returns how many files this process may have open; `None` without a limit.
pub(in crate::run) fn max_open_files() -> Option<u64> {
    getrlimit(Resource::Nofile).current
}

/// Takes the timer slack from this thread: Linux would delay each wake-up by 50 µs to wake several threads at once.
pub(in crate::run) fn be_punctual() {
    #[cfg(target_os = "linux")]
    let _ = rustix::thread::set_current_timer_slack(std::num::NonZeroU64::new(1));
}

/// Opens a file to write, and keeps others from doing so by this function; `None` when another process has it. Where
/// the file system has no locks, nobody looks after that.
pub(in crate::run) fn open_alone(options: &OpenOptions, path: &Path) -> io::Result<Option<File>> {
    let file = options.open(path)?;
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => Ok(None),
        Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => Ok(Some(file)),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

/// Returns whether both are one file under two names.
pub(in crate::run) fn is_same_file(one: &Metadata, other: &Metadata) -> bool {
    (one.dev(), one.ino()) == (other.dev(), other.ino())
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
