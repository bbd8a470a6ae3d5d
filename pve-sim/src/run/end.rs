//! The end of a run: a signal, or a closed stdout.

use std::io;

use tokio_util::sync::CancellationToken;

use super::system::{self, Signals};

/// The signal handlers and the watch on stdout. A run creates them first, so that no signal interrupts the start.
pub(super) struct End {
    signals: Signals,
    /// Cancelled to end the run without a signal.
    pub(super) stop: CancellationToken,
}

impl End {
    /// Installs the signal handlers, and starts watching stdout.
    pub(super) fn install() -> io::Result<Self> {
        let stop = CancellationToken::new();
        watch_stdout(stop.clone());
        Ok(Self { signals: Signals::install()?, stop })
    }

    /// Waits for a signal or for `stop`.
    pub(super) async fn wait(&mut self) {
        tokio::select! {
            () = self.signals.wait() => {}
            () = self.stop.cancelled() => {}
        }
    }
}

/// Watches stdout from a separate thread: on a quiet bus no write would reveal that it is closed.
fn watch_stdout(stop: CancellationToken) {
    // If the thread cannot start, the next write of the trace fails instead.
    let _ = std::thread::Builder::new().name("stdout".to_owned()).spawn(move || {
        if system::wait_for_hangup() {
            stop.cancel();
        }
    });
}
