//! The heartbeat producer (CiA 301 7.2.8.3.2, object 0x1017).

use crate::time::{Duration, Instant, NEVER, delayed};
use crate::wire::sdo::AbortCode;

/// The unit of object 0x1017 (R). The manual's example implies 10 ms; three other sentences and CiA 301 say 1 ms.
pub(crate) const UNIT: Duration = Duration::from_millis(1);

/// The unit of object 0x1017 in clock ticks.
const TICKS: u32 = UNIT.as_ticks() as u32;

/// A product's rules for its heartbeat.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// The resolution of the period, in units, at least 1. The period is rounded up to a multiple of the resolution.
    pub(crate) resolution: u32,
    /// The maximum heartbeat time, in units.
    pub(crate) max: u16,
}

/// The heartbeat producer, which decides when a heartbeat is due.
#[derive(Clone, Debug)]
pub(crate) struct HeartbeatProducer {
    rules: &'static Rules,
    /// The heartbeat time as written, in units. 0 switches the heartbeat off.
    time: u16,
    next: Instant,
}

impl HeartbeatProducer {
    /// Creates a producer that is off.
    #[must_use]
    pub(crate) const fn new(rules: &'static Rules) -> Self {
        Self { rules, time: 0, next: NEVER }
    }

    /// Returns the heartbeat time as written, in units.
    #[must_use]
    pub(crate) const fn time(&self) -> u16 {
        self.time
    }

    /// Writes the heartbeat time. The first heartbeat is due at once.
    ///
    /// # Errors
    /// Returns [`AbortCode::TOO_HIGH`] above the maximum of the product.
    pub(crate) fn write(&mut self, time: u16, now: Instant) -> Result<(), AbortCode> {
        if time > self.rules.max {
            return Err(AbortCode::TOO_HIGH);
        }
        self.time = time;
        self.next = if time == 0 { NEVER } else { now };
        Ok(())
    }

    /// Loads a stored time, which takes effect at the next [`boot`](Self::boot).
    pub(crate) const fn load(&mut self, time: u16) {
        self.time = time;
        self.stop();
    }

    /// Stops the heartbeat until the next [`boot`](Self::boot).
    pub(crate) const fn stop(&mut self) {
        self.next = NEVER;
    }

    /// Starts the first period at the boot-up message, which counts as a heartbeat.
    pub(crate) fn boot(&mut self, now: Instant) {
        self.next = self.following(now);
    }

    /// Returns whether a heartbeat is due, and schedules the following heartbeat.
    pub(crate) fn poll(&mut self, now: Instant) -> bool {
        let due = now >= self.next;
        if due {
            let planned = self.following(self.next);
            // After a pause longer than a period, the next period begins now: missed heartbeats are not sent.
            self.next = if planned > now { planned } else { self.following(now) };
        }
        due
    }

    /// Returns the time at which [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub(crate) const fn deadline(&self) -> Instant {
        self.next
    }

    fn following(&self, instant: Instant) -> Instant {
        if self.time == 0 {
            return NEVER;
        }
        // The computation is in units, because 64-bit ticks would need a division routine of 1 KiB in a small image.
        let time = u32::from(self.time);
        let period = time.checked_next_multiple_of(self.rules.resolution).unwrap_or(time);
        delayed(instant, Duration::from_ticks(TICKS.saturating_mul(period).into()))
    }
}
