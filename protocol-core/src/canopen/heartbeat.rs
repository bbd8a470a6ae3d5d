//! Heartbeat producer (CiA 301 7.2.8.3.2, object 0x1017).

use crate::time::{Duration, Instant, NEVER, delayed};
use crate::wire::sdo::AbortCode;

/// The unit of object 0x1017 (R): the manual's example reads as 10 ms, three other sentences and CiA 301 say 1 ms.
pub(crate) const UNIT: Duration = Duration::from_millis(1);

/// The same in ticks of the clock.
const TICKS: u32 = UNIT.as_ticks() as u32;

/// The rules of a product for its heartbeat.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// Periods are rounded up to a multiple of it, in units; not 0.
    pub(crate) resolution: u32,
    /// The longest time that can be set, in units.
    pub(crate) max: u16,
}

/// The producer of the heartbeat, which tells the NMT state periodically.
#[derive(Clone, Debug)]
pub(crate) struct HeartbeatProducer {
    rules: &'static Rules,
    /// As written, in units; 0 is off.
    time: u16,
    next: Instant,
}

impl HeartbeatProducer {
    /// Returns a producer that is off.
    #[must_use]
    pub(crate) const fn new(rules: &'static Rules) -> Self {
        Self { rules, time: 0, next: NEVER }
    }

    /// Returns the time as written, in units.
    #[must_use]
    pub(crate) const fn time(&self) -> u16 {
        self.time
    }

    /// Writes object 0x1017: the first heartbeat is due at once.
    ///
    /// # Errors
    /// [`AbortCode::TOO_HIGH`] above the product's limit.
    pub(crate) fn write(&mut self, time: u16, now: Instant) -> Result<(), AbortCode> {
        if time > self.rules.max {
            return Err(AbortCode::TOO_HIGH);
        }
        self.time = time;
        self.next = if time == 0 { NEVER } else { now };
        Ok(())
    }

    /// Takes a stored time; due from the next [`boot`](Self::boot).
    pub(crate) const fn load(&mut self, time: u16) {
        self.time = time;
        self.stop();
    }

    /// Sends nothing until the next [`boot`](Self::boot).
    pub(crate) const fn stop(&mut self) {
        self.next = NEVER;
    }

    /// Notes that the boot-up goes out: it counts as the first heartbeat.
    pub(crate) fn boot(&mut self, now: Instant) {
        self.next = self.following(now);
    }

    /// Returns whether a heartbeat is due; the next one is a period after this one was.
    pub(crate) fn poll(&mut self, now: Instant) -> bool {
        let due = now >= self.next;
        if due {
            let planned = self.following(self.next);
            // After a pause longer than a period there is no burst of what was missed.
            self.next = if planned > now { planned } else { self.following(now) };
        }
        due
    }

    /// Returns when [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub(crate) const fn deadline(&self) -> Instant {
        self.next
    }

    fn following(&self, instant: Instant) -> Instant {
        if self.time == 0 {
            return NEVER;
        }
        // In units: a division of ticks is one of 64 bits, which takes 1 KiB of a small image.
        let time = u32::from(self.time);
        let period = time.checked_next_multiple_of(self.rules.resolution).unwrap_or(time);
        delayed(instant, Duration::from_ticks(TICKS.saturating_mul(period).into()))
    }
}
