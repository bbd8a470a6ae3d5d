//! A message in the registers of a mailbox or a FIFO (RM0090 32.7.5).

use protocol_core::frame::{Frame, Id, extended, standard};

use super::registers::ir;

/// A frame with its length code on the wire. The codes 9 to 15 mean 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message {
    /// The frame, of at most 8 bytes.
    pub frame: Frame,
    /// The length code, 0 to 15.
    pub dlc: u8,
}

impl From<Frame> for Message {
    fn from(frame: Frame) -> Self {
        Self { frame, dlc: frame.len() }
    }
}

impl Message {
    /// Decodes the four registers of a mailbox.
    pub(super) fn of_registers([identifier, length, low, high]: [u32; 4]) -> Self {
        let id: Id = if identifier & ir::IDE == 0 {
            standard((identifier >> ir::STID) as u16).into()
        } else {
            extended(identifier >> ir::EXID).into()
        };
        let dlc = (length & 0xF) as u8;
        let mut data = [0; 8];
        data[..4].copy_from_slice(&low.to_le_bytes());
        data[4..].copy_from_slice(&high.to_le_bytes());
        let frame = if identifier & ir::RTR == 0 { Frame::with_len(id, data, dlc) } else { Frame::remote(id, dlc) };
        Self { frame, dlc }
    }

    /// Returns the identifier register without the transmit request, for filters.
    pub(super) fn identifier(&self) -> u32 {
        let id = match self.frame.id() {
            Id::Standard(id) => u32::from(id.as_raw()) << ir::STID,
            Id::Extended(id) => id.as_raw() << ir::EXID | ir::IDE,
        };
        id | if self.frame.is_remote() { ir::RTR } else { 0 }
    }

    /// Returns the two data registers.
    pub(super) fn data(&self) -> [u32; 2] {
        let word = |from: usize| u32::from_le_bytes(std::array::from_fn(|byte| self.frame.bytes()[from + byte]));
        [word(0), word(4)]
    }
}
