//! The conditions for the transmission of a TPDO: type, SYNC count, inhibit time and event timer (CiA 301 7.5.2.37).

use crate::time::{Duration, Instant, NEVER, delayed, since};

/// The event-driven transmission type of the device profile. A valve sends the TPDO at once after an RPDO, a sensor at
/// each end of the event timer.
pub(crate) const EVENT_DRIVEN: u8 = 0xFF;

/// The manufacturer-specific transmission type. A sensor sends the TPDO at each end of the event timer.
pub(crate) const MANUFACTURER: u8 = 0xFE;

/// The transmission type of a TPDO that is sent at a SYNC if its data have changed.
pub(crate) const ON_CHANGE: u8 = 0;

/// The unit of the inhibit time, in µs.
const INHIBIT_UNIT_US: u64 = 100;

/// The effect of a SYNC on a TPDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AtSync {
    /// The TPDO is not due: it is off, its type is not synchronous, or its type (1–240) demands further SYNCs.
    Nothing,
    /// The TPDO is due.
    Due,
    /// The TPDO is due if its data differ from the last sent data.
    OnChange,
}

/// The conditions that make a TPDO due.
#[derive(Clone, Debug)]
pub(crate) struct Transmission {
    kind: u8,
    /// The inhibit time in units of 100 µs; 0 for none.
    inhibit: u16,
    /// The event timer in ms; 0 for none.
    event_timer: u16,
    /// The number of SYNCs since the last synchronous transmission.
    syncs: u8,
    /// The next end of the event timer.
    due: Instant,
    /// The due time of a transmission that waits for the end of the inhibit time.
    requested: Option<Instant>,
    inhibited_until: Instant,
}

impl Transmission {
    /// Creates an event-driven transmission without timers.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self {
            kind: EVENT_DRIVEN,
            inhibit: 0,
            event_timer: 0,
            syncs: 0,
            due: NEVER,
            requested: None,
            inhibited_until: Instant::MIN,
        }
    }

    /// Returns the transmission type, sub-index 2.
    #[must_use]
    pub(crate) const fn kind(&self) -> u8 {
        self.kind
    }

    /// Returns the inhibit time in units of 100 µs, sub-index 3.
    #[must_use]
    pub(crate) const fn inhibit(&self) -> u16 {
        self.inhibit
    }

    /// Returns the event timer in ms, sub-index 5.
    #[must_use]
    pub(crate) const fn event_timer(&self) -> u16 {
        self.event_timer
    }

    /// Sets the transmission type, which takes effect at [`restart`](Self::restart).
    pub(crate) const fn set_kind(&mut self, kind: u8) {
        self.kind = kind;
    }

    /// Sets the inhibit time for the next transmission. Ends a running inhibit time.
    pub(crate) const fn set_inhibit(&mut self, inhibit: u16) {
        self.inhibit = inhibit;
        self.inhibited_until = Instant::MIN;
    }

    /// Sets the event timer, which takes effect at [`restart_timer`](Self::restart_timer).
    pub(crate) const fn set_event_timer(&mut self, event_timer: u16) {
        self.event_timer = event_timer;
    }

    /// Restarts the SYNC count and, if the PDO `sends`, the event timer.
    pub(crate) fn restart(&mut self, now: Instant, sends: bool) {
        self.syncs = 0;
        self.restart_timer(now, sends);
    }

    /// Restarts the event timer: its first period begins at `now`. Stops the timer unless the PDO `sends` and its type
    /// uses the timer. Drops a transmission that waits for the end of the inhibit time, but not the running inhibit
    /// time (A).
    pub(crate) fn restart_timer(&mut self, now: Instant, sends: bool) {
        self.requested = None;
        self.due = NEVER;
        if sends && self.event_timer != 0 && matches!(self.kind, MANUFACTURER | EVENT_DRIVEN) {
            self.due = delayed(now, self.period());
        }
    }

    /// Counts a SYNC.
    #[inline]
    pub(crate) const fn sync(&mut self) -> AtSync {
        match self.kind {
            ON_CHANGE => return AtSync::OnChange,
            1..=240 => {}
            _ => return AtSync::Nothing,
        }
        self.syncs = self.syncs.saturating_add(1);
        if self.syncs < self.kind {
            return AtSync::Nothing;
        }
        self.syncs = 0;
        AtSync::Due
    }

    /// Returns the due time of a TPDO, if the event timer has ended and no inhibit time runs. If calls missed ends of
    /// the timer, only the last missed end counts. Later ends keep their phase.
    pub(crate) fn poll(&mut self, now: Instant) -> Option<Instant> {
        if now >= self.due {
            let mut at = self.due;
            let mut next = delayed(at, self.period());
            if next <= now {
                at = self.last_period(now);
                next = delayed(at, self.period());
            }
            self.due = next;
            self.requested = Some(at);
        }
        let at = self.requested?.max(self.inhibited_until);
        if at > now {
            return None;
        }
        self.requested = None;
        self.inhibited_until =
            delayed(at, Duration::from_micros(u64::from(self.inhibit).saturating_mul(INHIBIT_UNIT_US)));
        Some(at)
    }

    /// Returns the time at which [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub(crate) fn deadline(&self) -> Instant {
        match self.requested {
            None => self.due,
            Some(at) => self.due.min(at.max(self.inhibited_until)),
        }
    }

    const fn period(&self) -> Duration {
        Duration::from_millis(self.event_timer as u64)
    }

    /// Returns the last scheduled end of the event timer up to `now`.
    #[cold]
    fn last_period(&self, now: Instant) -> Instant {
        let over = since(now, self.due).as_ticks().checked_rem(self.period().as_ticks()).unwrap_or(0);
        Instant::from_ticks(now.as_ticks().saturating_sub(over))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    fn cyclic(event_timer: u16, inhibit: u16) -> Transmission {
        let mut transmission = Transmission::new();
        transmission.set_kind(MANUFACTURER);
        transmission.set_inhibit(inhibit);
        transmission.set_event_timer(event_timer);
        transmission.restart(Instant::from_micros(7), true);
        transmission
    }

    /// Polls at the deadlines only, and returns the times of the transmissions.
    fn sent(transmission: &mut Transmission, until_us: u64) -> std::vec::Vec<u64> {
        let mut sent = std::vec::Vec::new();
        while transmission.deadline().as_micros() <= until_us {
            let now = transmission.deadline();
            if let Some(at) = transmission.poll(now) {
                assert_eq!(at, now);
                sent.push(at.as_micros());
            }
            assert!(transmission.deadline() > now);
        }
        sent
    }

    #[test]
    fn the_event_timer_keeps_its_grid_for_an_hour() {
        let mut transmission = cyclic(1, 0);
        let sent = sent(&mut transmission, 3_600_000_007);
        assert_eq!(sent.len(), 3_600_000);
        assert!(sent.iter().zip(1..).all(|(at, n)| *at == 7 + n * 1000));
    }

    #[test]
    fn missed_periods_merge_and_the_grid_stays() {
        let mut transmission = cyclic(10, 0);
        assert_eq!(transmission.poll(Instant::from_micros(55_000)), Some(Instant::from_micros(50_007)));
        assert_eq!(transmission.poll(Instant::from_micros(55_001)), None);
        assert_eq!(transmission.deadline(), Instant::from_micros(60_007));
        // Exactly at the end of a period: that period counts, not the one before.
        assert_eq!(transmission.poll(Instant::from_micros(70_007)), Some(Instant::from_micros(70_007)));
        assert_eq!(transmission.deadline(), Instant::from_micros(80_007));
    }

    #[test]
    fn periods_missed_for_ever_merge() {
        let mut transmission = cyclic(65_535, 0);
        let end = Instant::from_micros(7 + 65_535_000 * 1_000_000_000);
        assert_eq!(transmission.poll(end + Duration::from_micros(65_534_999)), Some(end));
    }

    #[test]
    fn the_inhibit_time_counts_from_the_last_request() {
        // 2.5 ms
        let mut transmission = cyclic(1, 25);
        assert_eq!(sent(&mut transmission, 9_000), [1_007, 3_507, 6_007, 8_507]);
        // From the due time, not from a late poll.
        let mut transmission = cyclic(1, 25);
        assert_eq!(transmission.poll(Instant::from_micros(1_400)), Some(Instant::from_micros(1_007)));
        assert_eq!(sent(&mut transmission, 7_000), [3_507, 6_007]);
        // An inhibit time equal to the period.
        let mut transmission = cyclic(1, 10);
        assert_eq!(sent(&mut transmission, 3_007), [1_007, 2_007, 3_007]);
    }

    #[test]
    fn other_types_have_no_event_timer() {
        for kind in [0, 1, 240] {
            let mut transmission = cyclic(1, 0);
            transmission.set_kind(kind);
            transmission.restart(Instant::from_micros(7), true);
            assert_eq!(transmission.deadline(), NEVER);
        }
    }
}
