//! The end of a run: a signal, or a stdout that nobody reads any more.

use std::io;

use tokio::sync::watch;

use super::system::{self, Signals};

/// The signals and the watch on stdout. A run makes them first, so that no signal finds it half started.
pub(super) struct End {
    signals: Signals,
    reader_gone: watch::Receiver<bool>,
    teller: watch::Sender<bool>,
}

impl End {
    /// Listens to the system's signals, and watches stdout.
    pub(super) fn listen() -> io::Result<Self> {
        let (teller, reader_gone) = watch::channel(false);
        watch_stdout(teller.clone());
        Ok(Self { signals: Signals::listen()?, reader_gone, teller })
    }

    /// Returns the place where a writer of stdout tells that nobody reads it.
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
    // Without the thread, the next line of the trace notices.
    let _ = std::thread::Builder::new().name("stdout".to_owned()).spawn(move || {
        if system::wait_for_hangup() {
            teller.send_replace(true);
        }
    });
}
