//! The frames that the master of the rig sends and receives, in the notation of the manuals.

use protocol_core::device;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant};

use super::Rig;
use crate::Inputs;

/// Parses a frame in the notation of the manuals, `5A0: 43 18 10 01 19 00 00 01`.
///
/// # Panics
/// Panics for any other text.
#[must_use]
pub fn frame(text: &str) -> Frame {
    text.parse().unwrap_or_else(|error| panic!("{text:?}: {error}"))
}

impl Rig {
    /// Sends a frame to the device.
    pub fn send(&mut self, text: &str) {
        self.send_frame(frame(text));
    }

    /// Sends a frame to the device, even if its filters reject the frame: the core does not rely on them.
    ///
    /// # Panics
    /// Panics if the device reacts to a frame that its filters reject.
    #[track_caller]
    pub fn send_frame(&mut self, frame: Frame) {
        let passes = !frame.is_remote() && self.filters().iter().any(|filter| filter.passes(&frame));
        let sent = self.wire.sent.len();
        self.finish_write();
        self.device.as_dyn_mut().handle(&frame, self.now);
        self.pump();
        assert!(passes || self.wire.sent.len() == sent, "{frame} is answered, but passes no filter");
    }

    /// Takes the next frame that the device has sent.
    pub fn take_next(&mut self) -> Option<Frame> {
        self.wire.sent.pop_front().map(|(_, frame)| frame)
    }

    /// Takes all frames that the device has sent, in the notation of the manuals.
    pub fn take(&mut self) -> Vec<String> {
        self.take_timed().into_iter().map(|(_, frame)| frame.to_string()).collect()
    }

    /// Takes all frames that the device has sent, with their times.
    pub fn take_timed(&mut self) -> Vec<(Instant, Frame)> {
        self.wire.sent.drain(..).collect()
    }

    /// Takes all frames that the device has sent. Returns those with this identifier.
    pub fn take_under(&mut self, id: &str) -> Vec<String> {
        let under = |frame: &String| frame.split_once(':').is_some_and(|(of_frame, _)| of_frame == id);
        self.take().into_iter().filter(under).collect()
    }

    /// Takes the next frame that the device has sent, and asserts it.
    #[track_caller]
    pub fn expect(&mut self, text: &str) {
        let sent = self.take_next().map(|frame| frame.to_string());
        assert_eq!(sent.as_deref(), Some(text), "at {} us", self.now.as_micros());
    }

    /// Asserts that the device has sent nothing more.
    #[track_caller]
    pub fn expect_nothing(&mut self) {
        let sent = self.take();
        assert!(sent.is_empty(), "at {} us: {sent:?}", self.now.as_micros());
    }

    /// Sends a frame, and asserts that the device sends exactly these frames.
    #[track_caller]
    pub fn exchange(&mut self, request: &str, answers: &[&str]) {
        self.send(request);
        let sent = self.take();
        assert_eq!(sent, answers, "answers to {request}");
    }

    /// Sends these frames in order.
    #[track_caller]
    pub fn send_all(&mut self, requests: &[&str]) {
        for request in requests {
            self.send(request);
        }
    }

    /// Sends these frames, and asserts that the device answers none of them.
    #[track_caller]
    pub fn silent_to(&mut self, requests: &[&str]) {
        for request in requests {
            self.exchange(request, &[]);
        }
    }

    /// Advances the time by a number of milliseconds, and asserts that the device sends nothing.
    #[track_caller]
    pub fn silent_for(&mut self, ms: u64) {
        self.advance(ms);
        self.expect_nothing();
    }

    /// Advances the time by a number of milliseconds, and asserts that the device sends exactly these frames.
    #[track_caller]
    pub fn advance_sends(&mut self, ms: u64, frames: &[impl AsRef<str>]) {
        self.advance(ms);
        self.expect_all(frames);
    }

    /// Switches the power off and on, and asserts that the device sends exactly these frames.
    #[track_caller]
    pub fn power_cycle_sends(&mut self, frames: &[impl AsRef<str>]) {
        self.power_cycle();
        self.expect_all(frames);
    }

    /// Releases the bus, and asserts that the device sends exactly these frames.
    #[track_caller]
    pub fn free_bus_sends(&mut self, frames: &[impl AsRef<str>]) {
        self.hold_bus(false);
        self.expect_all(frames);
    }

    /// Asserts that the device sends nothing until a microsecond before `ms`, and then exactly these frames.
    #[track_caller]
    pub fn silent_until(&mut self, ms: u64, frames: &[impl AsRef<str>]) {
        const STEP: Duration = Duration::from_micros(1);
        self.advance_by(Duration::from_millis(ms) - STEP);
        self.expect_nothing();
        self.advance_by(STEP);
        self.expect_all(frames);
    }

    /// Changes the inputs of a valve, and asserts that it sends exactly these frames.
    #[track_caller]
    pub fn sense_sends(&mut self, change: impl FnOnce(&mut Inputs), frames: &[&str]) {
        self.sense(change);
        self.expect_all(frames);
    }

    /// Changes the inputs of a sensor, and asserts that it sends exactly these frames.
    #[track_caller]
    pub fn sense_hat_sends(&mut self, change: impl FnOnce(&mut device::Inputs), frames: &[&str]) {
        self.sense_hat(change);
        self.expect_all(frames);
    }

    /// Asserts that the device has sent exactly these frames.
    #[track_caller]
    pub fn expect_all(&mut self, frames: &[impl AsRef<str>]) {
        let frames: Vec<&str> = frames.iter().map(AsRef::as_ref).collect();
        assert_eq!(self.take(), frames, "at {} us", self.now.as_micros());
    }

    /// Brings the device to ACTIVE by use case 1, with set-point 0 and without its TPDOs. No time passes.
    ///
    /// # Panics
    /// Panics if the device does not reach ACTIVE.
    #[track_caller]
    pub fn activate(&mut self) {
        let node_id = u16::from(self.node_id().expect("a node ID"));
        self.send("000: 01 00");
        for status in ["09", "0B", "0F"] {
            self.send(&format!("{:03X}: 0F 00 00 00", 0x200 + node_id));
            let sent = self.take_next().expect("a TPDO").to_string();
            assert!(sent.starts_with(&format!("{:03X}: {status} 00", 0x180 + node_id)), "{sent}");
        }
        self.expect_nothing();
    }
}
