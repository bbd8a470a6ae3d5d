//! How time passes on the rig.

use protocol_core::time::{Duration, Instant, after};

use super::Rig;

/// The cycle in which the manual's controller sends.
const CYCLE_MS: u64 = 100;

impl Rig {
    /// Lets so many milliseconds pass.
    pub fn advance(&mut self, ms: u64) {
        self.advance_by(Duration::from_millis(ms));
    }

    /// Lets time pass, stopping at every deadline of the device and of the memory.
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

    /// Lets so many milliseconds pass, as a machine controller does: with this frame every 100 ms, the first after 100
    /// ms.
    pub fn advance_cyclic(&mut self, ms: u64, text: &str) {
        for _ in 0..ms / CYCLE_MS {
            self.advance(CYCLE_MS);
            self.send(text);
        }
        self.advance(ms % CYCLE_MS);
    }

    /// Lets time pass in one leap: the device is polled at its end alone.
    pub fn leap(&mut self, duration: Duration) {
        self.now = after(self.now, duration);
        self.pump();
    }

    /// Turns the platform's clock back: for a device, time must stand still until it has caught up.
    pub fn turn_back(&mut self, duration: Duration) {
        self.now = Instant::from_ticks(self.now.as_ticks().saturating_sub(duration.as_ticks()));
        self.pump();
    }

    /// Lets time pass in one leap, at whose end a frame comes before the device is polled.
    pub fn leap_to(&mut self, duration: Duration, text: &str) {
        self.now = after(self.now, duration);
        self.send(text);
    }
}
