//! The end of a run: a signal, or a stdout that nobody reads any more.

use std::io;

use tokio::sync::watch;

/// The signals and the watch on stdout. A run makes them first, so that no signal finds it half started.
pub(super) struct End {
    #[cfg(unix)]
    signals: Vec<tokio::signal::unix::Signal>,
    reader_gone: watch::Receiver<bool>,
    teller: watch::Sender<bool>,
}

impl End {
    /// Listens to SIGINT, SIGTERM and SIGHUP, which may be ignored as under `nohup`, and watches stdout.
    pub(super) fn listen() -> io::Result<Self> {
        let (teller, reader_gone) = watch::channel(false);
        watch_stdout(teller.clone());
        Ok(Self {
            #[cfg(unix)]
            signals: signals()?,
            reader_gone,
            teller,
        })
    }

    /// Returns the place where a writer of stdout tells that nobody reads it.
    pub(super) fn teller(&self) -> watch::Sender<bool> {
        self.teller.clone()
    }

    /// Waits for the end.
    pub(super) async fn come(&mut self) {
        let Self { reader_gone, .. } = self;
        tokio::select! {
            () = any(
                #[cfg(unix)]
                &mut self.signals
            ) => {}
            _ = reader_gone.wait_for(|gone| *gone) => {}
        }
    }
}

#[cfg(unix)]
fn signals() -> io::Result<Vec<tokio::signal::unix::Signal>> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut kinds = vec![SignalKind::interrupt(), SignalKind::terminate()];
    if !hangup_is_ignored() {
        kinds.push(SignalKind::hangup());
    }
    kinds.into_iter().map(signal).collect()
}

/// Waits for one of the signals.
#[cfg(unix)]
async fn any(signals: &mut [tokio::signal::unix::Signal]) {
    std::future::poll_fn(|context| {
        let came = signals.iter_mut().any(|signal| signal.poll_recv(context).is_ready());
        if came { std::task::Poll::Ready(()) } else { std::task::Poll::Pending }
    })
    .await;
}

#[cfg(not(unix))]
async fn any() {
    if tokio::signal::ctrl_c().await.is_err() {
        std::future::pending::<()>().await;
    }
}

/// Whether this process was started with SIGHUP ignored. Only Linux tells that to safe code.
#[cfg(unix)]
fn hangup_is_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    ignores_hangup(&status)
}

/// Reads the mask of ignored signals, a hex number; SIGHUP is its lowest bit.
#[cfg(unix)]
fn ignores_hangup(status: &str) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask & 1 != 0)
}

/// Watches stdout from a thread of its own: on a quiet bus no write would fail.
#[cfg(unix)]
fn watch_stdout(teller: watch::Sender<bool>) {
    use rustix::event::{PollFd, PollFlags, poll};
    use rustix::io::Errno;
    use std::os::fd::AsFd as _;

    // Without the thread, the next line of the trace notices.
    let _ = std::thread::Builder::new().name("stdout".to_owned()).spawn(move || {
        let stdout = io::stdout();
        loop {
            // With no event asked for, poll returns for an error or a hang-up only; a file has neither.
            let mut polled = [PollFd::from_borrowed_fd(stdout.as_fd(), PollFlags::empty())];
            match poll(&mut polled, None) {
                Err(Errno::INTR) => {}
                Err(_) => return,
                Ok(_) => {
                    if polled[0].revents().intersects(PollFlags::ERR | PollFlags::HUP) {
                        teller.send_replace(true);
                    }
                    return;
                }
            }
        }
    });
}

#[cfg(not(unix))]
fn watch_stdout(_: watch::Sender<bool>) {}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn the_signals_that_are_ignored_are_read_from_the_status() {
        assert!(ignores_hangup("Name:\tpve-sim\nSigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\n"));
        assert!(!ignores_hangup("Name:\tpve-sim\nSigIgn:\t0000000000001000\nSigCgt:\t0000000000000001\n"));
        assert!(!ignores_hangup(""));
    }
}
