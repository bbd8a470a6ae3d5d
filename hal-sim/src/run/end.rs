//! What ends the simulator: a signal, or nobody who reads its stdout any more.

use std::io;

use tokio::sync::watch;

/// Waits for the end. Made as the very first thing, so that nothing is half done when a signal comes.
pub(super) struct End {
    #[cfg(unix)]
    signals: Vec<tokio::signal::unix::Signal>,
    reader_gone: watch::Receiver<bool>,
    teller: watch::Sender<bool>,
}

impl End {
    /// Listens to SIGINT, SIGTERM and SIGHUP, unless that is ignored, as under `nohup`; and to the end of stdout.
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

    /// To be told when stdout has no reader: by whoever writes to it.
    pub(super) fn teller(&self) -> watch::Sender<bool> {
        self.teller.clone()
    }

    /// Waits until the simulator is to end.
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

/// Whether whoever started this process has SIGHUP ignored. Only Linux says so to safe code; elsewhere it counts as not.
#[cfg(unix)]
fn hangup_is_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    ignores_hangup(&status)
}

/// The signals that are ignored are one hex number, in which SIGHUP, the first of all, is the lowest bit.
#[cfg(unix)]
fn ignores_hangup(status: &str) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask & 1 != 0)
}

/// A quiet bus writes nothing, and only who writes learns that nobody reads: a thread of its own waits for that.
#[cfg(unix)]
fn watch_stdout(teller: watch::Sender<bool>) {
    use rustix::event::{PollFd, PollFlags, poll};
    use rustix::io::Errno;
    use std::os::fd::AsFd as _;

    // Without the thread it is noticed with the next line.
    let _ = std::thread::Builder::new().name("stdout".to_owned()).spawn(move || {
        let stdout = io::stdout();
        loop {
            // No event is asked for, so what comes is an error or the end; a file never has either.
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
