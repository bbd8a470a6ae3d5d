//! The end of a run: a signal, or a closed stdout.

use std::io;

use tokio::sync::watch;

use super::system::{self, Signals};

/// The signal handlers and the watch on stdout. A run creates them first, so that no signal interrupts the start.
pub(super) struct End {
    signals: Signals,
    reader_gone: watch::Receiver<bool>,
    closed_sender: watch::Sender<bool>,
}

impl End {
    /// Installs the signal handlers, and starts watching stdout.
    pub(super) fn install() -> io::Result<Self> {
        let (closed_sender, reader_gone) = watch::channel(false);
        watch_stdout(closed_sender.clone());
        Ok(Self { signals: Signals::install()?, reader_gone, closed_sender })
    }

    /// Returns the sender by which a writer reports that stdout is closed.
    pub(super) fn closed_sender(&self) -> watch::Sender<bool> {
        self.closed_sender.clone()
    }

    /// Waits for a signal or a closed stdout.
    pub(super) async fn wait(&mut self) {
        let Self { signals, reader_gone, .. } = self;
        tokio::select! {
            () = signals.wait() => {}
            _ = reader_gone.wait_for(|gone| *gone) => {}
        }
    }
}

/// Watches stdout from a separate thread: on a quiet bus no write would reveal that it is closed.
fn watch_stdout(closed_sender: watch::Sender<bool>) {
    // If the thread cannot start, the next write of the trace fails instead.
    let _ = std::thread::Builder::new().name("stdout".to_owned()).spawn(move || {
        if system::wait_for_hangup() {
            closed_sender.send_replace(true);
        }
    });
}
