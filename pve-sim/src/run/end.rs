//! The end of a run: by a signal, or because the reader of stdout has gone.

use std::io;

use tokio::sync::watch;

use super::system::{self, Signals};

/// The signals, and the watch on stdout. A run creates them first, so that no signal finds it half started.
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

    /// Returns the sender by which a writer of stdout reports that its reader has gone.
    pub(super) fn teller(&self) -> watch::Sender<bool> {
        self.teller.clone()
    }

    /// Waits for the end.
    pub(super) async fn come(&mut self) {
        let Self { signals, reader_gone, .. } = self;
        tokio::select! {
            () = signals.come() => {}
            _ = reader_gone.wait_for(|gone| *gone) => {}
        }
    }
}

/// Watches stdout from a thread of its own: on a quiet bus no write would fail.
fn watch_stdout(teller: watch::Sender<bool>) {
    // Without the thread, the next line of the trace fails instead.
    let _ = std::thread::Builder::new().name("stdout".to_owned()).spawn(move || {
        if system::wait_for_hangup() {
            teller.send_replace(true);
        }
    });
}
