//! The platform of the driver: the wall clock and the messages of clients.

use std::sync::atomic::Ordering;
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

/// The wall clock of the system, and the inbox of the world. The run has a sender of messages until the world has
/// ended, so the channel is never disconnected.
impl Platform for Inbox {
    fn now(&mut self) -> WallInstant {
        WallInstant::now()
    }

    fn is_ending(&self) -> bool {
        self.ending.load(Ordering::Acquire)
    }

    fn take(&mut self) -> Option<Arrival> {
        self.messages.try_recv().ok()
    }

    fn wait(&mut self, until: Option<WallInstant>, spin: Duration) -> Option<Arrival> {
        let Some(until) = until else { return self.messages.recv().ok() };
        let sleep = until.saturating_duration_since(WallInstant::now() + spin);
        if !sleep.is_zero()
            && let Ok(arrival) = self.messages.recv_timeout(sleep)
        {
            return Some(arrival);
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
