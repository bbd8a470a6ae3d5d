//! The end of a run: a signal, or a closed stdout.

use std::io;

use tokio::sync::watch;

use super::system::{self, Signals};

/// The signal handlers and the watch on stdout. A run creates them first, so that no signal interrupts the start.
pub(super) struct End {
    signals: Signals,
    reader_gone: watch::Receiver<bool>,
    teller: watch::Sender<bool>,
}

impl End {
    /// Installs the signal handlers, and starts watching stdout.
    pub(super) fn listen() -> io::Result<Self> {
        let (teller, reader_gone) = watch::channel(false);
        watch_stdout(teller.clone());
        Ok(Self { signals: Signals::listen()?, reader_gone, teller })
    }

    /// Returns the sender by which a writer reports that stdout is closed.
    pub(super) fn teller(&self) -> watch::Sender<bool> {
        self.teller.clone()
    }

    /// Waits for a signal or a closed stdout.
    pub(super) async fn come(&mut self) {
        let Self { signals, reader_gone, .. } = self;
        tokio::select! {
            () = signals.come() => {}
            _ = reader_gone.wait_for(|gone| *gone) => {}
        }
    }
}

/// Watches stdout from a separate thread: on a quiet bus no write would reveal that it is closed.
fn watch_stdout(teller: watch::Sender<bool>) {
    // If the thread cannot start, the next write of the trace fails instead.
    let _ = std::thread::Builder::new().name("stdout".to_owned()).spawn(move || {
        if system::wait_for_hangup() {
            teller.send_replace(true);
        }
    });
}
