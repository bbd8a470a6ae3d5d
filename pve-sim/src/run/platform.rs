//! The platform of the driver: the wall clock and the messages of clients.

use std::sync::mpsc::{RecvTimeoutError, TryRecvError};
use std::time::{Duration, Instant as WallInstant};

use crate::inbox::{Arrival, Inbox};

/// The wall clock and the messages of clients. In tests the clock advances only while the driver waits.
pub trait Platform {
    /// Returns the wall time.
    fn now(&mut self) -> WallInstant;

    /// Returns whether the simulator is shutting down.
    fn is_ending(&self) -> bool;

    /// Takes the next message, if there is one.
    fn take(&mut self) -> Option<Arrival>;

    /// Waits for the next message until an instant, or forever; returns `None` on time-out or at the end of the run.
    /// Spins for the last `spin` before that instant, to avoid the wake-up delay.
    fn wait(&mut self, until: Option<WallInstant>, spin: Duration) -> Option<Arrival>;
}

/// The duration of the spin before an event while a client listens: the usual wake-up delay of a thread.
pub(super) const SPIN: Duration = Duration::from_micros(50);

/// The wall clock of the system, and the inbox of the world.
#[derive(Debug)]
pub(super) struct System {
    inbox: Inbox,
    /// Whether all senders of messages have ended.
    is_disconnected: bool,
}

impl System {
    pub(super) const fn new(inbox: Inbox) -> Self {
        Self { inbox, is_disconnected: false }
    }
}

impl Platform for System {
    fn now(&mut self) -> WallInstant {
        WallInstant::now()
    }

    fn is_ending(&self) -> bool {
        self.is_disconnected || self.inbox.is_ending()
    }

    fn take(&mut self) -> Option<Arrival> {
        let taken = self.inbox.messages.try_recv();
        self.is_disconnected |= matches!(taken, Err(TryRecvError::Disconnected));
        taken.ok()
    }

    fn wait(&mut self, until: Option<WallInstant>, spin: Duration) -> Option<Arrival> {
        let Some(until) = until else {
            let waited = self.inbox.messages.recv();
            self.is_disconnected |= waited.is_err();
            return waited.ok();
        };
        let sleep = until.saturating_duration_since(WallInstant::now() + spin);
        if !sleep.is_zero() {
            match self.inbox.messages.recv_timeout(sleep) {
                Ok(arrival) => return Some(arrival),
                Err(RecvTimeoutError::Disconnected) => self.is_disconnected = true,
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
        while WallInstant::now() < until && !self.is_ending() {
            if let Some(arrival) = self.take() {
                return Some(arrival);
            }
            std::hint::spin_loop();
        }
        None
    }
}
