//! The platform of the driver: the wall clock, and messages of clients.

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

/// The spin before an event while a client listens: the usual wake-up delay of a thread.
pub(super) const WAKE_UP: Duration = Duration::from_micros(50);

/// The spin after a message, at speeds above 1. A client that works back to back sends its next message within this
/// time, and a wake-up of the thread would delay the client more than the bus does.
pub(super) const SPIN_TIME: Duration = Duration::from_micros(200);

/// The maximum time for which the gateway and its clients usually occupy a yielded processor. A longer time indicates
/// other programs.
const TAKEN: Duration = Duration::from_micros(100);

/// The time for which the processor counts as contended after use by other programs.
const SHARED: Duration = Duration::from_millis(100);

/// The system's clock, and the clients of the gateways.
#[derive(Debug)]
pub(super) struct System {
    inbox: Inbox,
    /// Whether all gateways have ended.
    deserted: bool,
    /// The end of the time in which the processor counts as contended.
    shared_until: WallInstant,
}

impl System {
    pub(super) fn new(inbox: Inbox) -> Self {
        Self { inbox, deserted: false, shared_until: WallInstant::now() }
    }
}

impl Platform for System {
    fn now(&mut self) -> WallInstant {
        WallInstant::now()
    }

    fn is_ending(&self) -> bool {
        self.deserted || self.inbox.is_ending()
    }

    fn take(&mut self) -> Option<Arrival> {
        let taken = self.inbox.messages.try_recv();
        self.deserted |= matches!(taken, Err(TryRecvError::Disconnected));
        taken.ok()
    }

    /// On a contended processor the thread sleeps instead of yielding, because a thread that has used up its share
    /// waits longer for the next share than a wake-up takes. The thread always spins for the last [`WAKE_UP`].
    fn wait(&mut self, until: Option<WallInstant>, spin: Duration) -> Option<Arrival> {
        let Some(until) = until else { return self.sleep(None) };
        let mut now = WallInstant::now();
        let early = until.checked_sub(spin).unwrap_or(now);
        if early > now {
            if let Some(arrival) = self.sleep(Some(early)) {
                return Some(arrival);
            }
            now = WallInstant::now();
        }
        while now < until && !self.is_ending() {
            if let Some(arrival) = self.take() {
                return Some(arrival);
            }
            let before = now;
            if until.saturating_duration_since(now) <= WAKE_UP {
                std::hint::spin_loop();
            } else if now < self.shared_until {
                return self.sleep(Some(until));
            } else {
                std::thread::yield_now();
            }
            now = WallInstant::now();
            if now.saturating_duration_since(before) > TAKEN {
                self.shared_until = now + SHARED;
            }
        }
        None
    }
}

impl System {
    fn sleep(&mut self, until: Option<WallInstant>) -> Option<Arrival> {
        let waited = match until {
            Some(until) => self.inbox.messages.recv_timeout(until.saturating_duration_since(WallInstant::now())),
            None => self.inbox.messages.recv().map_err(|_| RecvTimeoutError::Disconnected),
        };
        self.deserted |= matches!(waited, Err(RecvTimeoutError::Disconnected));
        waited.ok()
    }
}
