//! A CAN controller without a bus. The caller takes the frames from the mailboxes.

use std::sync::Arc;

use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;

use super::port::Port;

impl Port {
    /// Creates a device controller without a bus. The mailboxes start empty; no frames are received.
    #[must_use]
    pub fn alone(name: &str, rate: BitRate) -> Self {
        Self::of_device(Arc::from(name), rate)
    }

    /// Sends the most urgent pending frame immediately, as a controller on an idle bus would.
    pub fn send_head(&mut self) -> Option<Frame> {
        let frame = *self.transmit.head()?;
        self.transmit.sending();
        self.transmit.sent(true);
        Some(frame)
    }

    /// Returns the frame that the controller will send next.
    #[must_use]
    pub fn head(&self) -> Option<&Frame> {
        self.transmit.head()
    }

    /// Drops all pending frames, as bus-off does.
    pub fn clear(&mut self) {
        self.transmit.clear();
    }
}
