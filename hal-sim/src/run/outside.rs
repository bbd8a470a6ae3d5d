//! The outside of the world, as the driver sees it: the wall clock, and messages of clients.

use std::sync::mpsc::{RecvTimeoutError, TryRecvError};
use std::time::{Duration, Instant as WallInstant};

use crate::gateway::{Arrival, Inbox};

/// The wall clock, and messages of clients. In tests the clock runs only while the driver waits.
pub trait Outside {
    /// Returns the wall time.
    fn now(&mut self) -> WallInstant;

    /// Whether the simulator is to end.
    fn is_ending(&self) -> bool;

    /// Takes the next message, if there is one.
    fn take(&mut self) -> Option<Arrival>;

    /// Waits for the next message, until an instant or for ever; `None` when the time is up.
    fn wait(&mut self, until: Option<WallInstant>) -> Option<Arrival>;

    /// Waits as [`wait`](Self::wait) does, and returns without the delay of waking up.
    fn wait_punctually(&mut self, until: WallInstant) -> Option<Arrival>;
}

/// The time that a system mostly takes to wake a thread up.
const WAKE_UP: Duration = Duration::from_micros(50);

/// The system's clock, and the clients of the gateways.
#[derive(Debug)]
pub(super) struct System {
    inbox: Inbox,
    /// Whether all gateways have ended.
    deserted: bool,
}

impl System {
    pub(super) const fn new(inbox: Inbox) -> Self {
        Self { inbox, deserted: false }
    }
}

impl Outside for System {
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

    fn wait(&mut self, until: Option<WallInstant>) -> Option<Arrival> {
        let waited = match until {
            Some(until) => self.inbox.messages.recv_timeout(until.saturating_duration_since(WallInstant::now())),
            None => self.inbox.messages.recv().map_err(|_| RecvTimeoutError::Disconnected),
        };
        self.deserted |= matches!(waited, Err(RecvTimeoutError::Disconnected));
        waited.ok()
    }

    /// Stays awake for the last [`WAKE_UP`].
    fn wait_punctually(&mut self, until: WallInstant) -> Option<Arrival> {
        let sleep = until.checked_sub(WAKE_UP).filter(|until| *until > WallInstant::now());
        let arrival = sleep.and_then(|until| self.wait(Some(until)));
        if arrival.is_some() {
            return arrival;
        }
        while !self.is_ending() {
            if let Some(arrival) = self.take() {
                return Some(arrival);
            }
            if WallInstant::now() >= until {
                break;
            }
            std::hint::spin_loop();
        }
        None
    }
}
