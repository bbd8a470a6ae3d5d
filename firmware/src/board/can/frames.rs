//! The conversion between frames of the core and of `bxcan`.

use embassy_stm32::pac::CAN1;
use protocol_core::frame::{Frame, Id, extended, standard};

/// Converts a frame between the core and `bxcan`. Returns `None` only for a frame of more than eight bytes, which does
/// not occur here.
pub(super) fn convert<From: embedded_can::Frame, To: embedded_can::Frame>(frame: &From) -> Option<To> {
    if frame.is_remote_frame() { To::new_remote(frame.id(), frame.dlc()) } else { To::new(frame.id(), frame.data()) }
}

/// The data length code and the data at the output of a receive FIFO.
///
/// CAN permits length codes of 9–15, which mean 8 bytes. `bxcan` keeps such a code, and panics on access to the length
/// or data of the frame. Therefore the output is read before `bxcan` releases the frame.
pub(super) struct Payload {
    len: u8,
    data: [u8; 8],
}

impl Payload {
    /// Reads the output of a FIFO.
    pub(super) fn peek(fifo: usize) -> Self {
        let output = CAN1.rx(fifo);
        let len = output.rdtr().read().dlc();
        let [a, b, c, d] = output.rdlr().read().0.to_le_bytes();
        let [e, f, g, h] = output.rdhr().read().0.to_le_bytes();
        Self { len, data: [a, b, c, d, e, f, g, h] }
    }

    /// Combines this payload with the frame that `bxcan` has taken.
    pub(super) fn of(self, frame: &bxcan::Frame) -> Frame {
        let id = embedded_can::Frame::id(frame);
        if frame.is_remote_frame() { Frame::remote(id, self.len) } else { Frame::with_len(id, self.data, self.len) }
    }
}

/// Returns the identifier in a transmit mailbox.
pub(super) fn identifier(mailbox: usize) -> Id {
    let register = CAN1.tx(mailbox).tir().read().0;
    let is_extended = register & 1 << 2 != 0;
    if is_extended { extended(register >> 3).into() } else { standard((register >> 21) as u16).into() }
}
