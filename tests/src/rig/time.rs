//! The time of the rig.

use protocol_core::time::{Duration, Instant, after};

use super::Rig;

/// The cycle of the manual's controller.
const CYCLE_MS: u64 = 100;

impl Rig {
    /// Advances the time by a number of milliseconds.
    pub fn advance(&mut self, ms: u64) {
        self.advance_by(Duration::from_millis(ms));
    }

    /// Advances the time, with a stop at every deadline of device and memory.
    pub fn advance_by(&mut self, duration: Duration) {
        let end = after(self.now, duration);
        loop {
            let due = self
                .write
                .as_ref()
                .map_or(self.device.as_dyn().deadline(), |write| write.done.min(self.device.as_dyn().deadline()));
            if due > end {
                break;
            }
            self.now = self.now.max(due);
            self.pump();
        }
        self.now = end;
        self.pump();
    }

    /// Advances the time by a number of milliseconds, with this frame every 100 ms as from a machine controller. The
    /// first frame comes after 100 ms.
    pub fn advance_cyclic(&mut self, ms: u64, text: &str) {
        for _ in 0..ms / CYCLE_MS {
            self.advance(CYCLE_MS);
            self.send(text);
        }
        self.advance(ms % CYCLE_MS);
    }

    /// Advances the time in one leap, with a poll at its end only.
    pub fn leap(&mut self, duration: Duration) {
        self.now = after(self.now, duration);
        self.pump();
    }

    /// Sets the clock of the platform back. The time of the device must stand still until the clock has caught up.
    pub fn turn_back(&mut self, duration: Duration) {
        self.now = Instant::from_ticks(self.now.as_ticks().saturating_sub(duration.as_ticks()));
        self.pump();
    }

    /// Advances the time in one leap. A frame comes at its end, before the poll.
    pub fn leap_to(&mut self, duration: Duration, text: &str) {
        self.now = after(self.now, duration);
        self.send(text);
    }
}
