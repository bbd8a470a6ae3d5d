//! The SDO client of the rig.

use protocol_core::frame::Frame;

use super::Rig;
use crate::sdo::{LOAD, SAVE};

impl Rig {
    /// Reads the status word.
    #[track_caller]
    pub fn status(&mut self) -> u32 {
        self.read(0x6041, 0)
    }

    /// Reads a number by SDO, expedited.
    ///
    /// # Panics
    /// Panics without such an answer.
    #[track_caller]
    pub fn read(&mut self, index: u16, sub: u8) -> u32 {
        let answer = self.sdo(0x40, index, sub, 0);
        let bytes = answer.bytes();
        assert!(matches!(bytes[0], 0x43 | 0x47 | 0x4B | 0x4F), "no number: {answer}");
        let [a, b, c, d] = [bytes[4], bytes[5], bytes[6], bytes[7]];
        u32::from_le_bytes([a, b, c, d])
    }

    /// Writes a number of `size` bytes by SDO, expedited.
    ///
    /// # Errors
    /// Returns the abort code.
    ///
    /// # Panics
    /// Panics without an answer.
    #[track_caller]
    pub fn write(&mut self, index: u16, sub: u8, size: u8, value: u32) -> Result<(), u32> {
        let answer = self.sdo(0x23 | (4 - size) << 2, index, sub, value);
        match answer.bytes() {
            [0x60, ..] => Ok(()),
            [0x80, _, _, _, code @ ..] => Err(u32::from_le_bytes(*code)),
            _ => panic!("no answer to a download: {answer}"),
        }
    }

    /// Stores the part of the parameters that this sub-index of 0x1010 selects.
    ///
    /// # Panics
    /// Panics if the device refuses.
    #[track_caller]
    pub fn save(&mut self, sub: u8) {
        assert_eq!(self.write(0x1010, sub, 4, SAVE), Ok(()), "save {sub}");
    }

    /// Restores the part of the parameters that this sub-index of 0x1011 selects.
    ///
    /// # Panics
    /// Panics if the device refuses.
    #[track_caller]
    pub fn load(&mut self, sub: u8) {
        assert_eq!(self.write(0x1011, sub, 4, LOAD), Ok(()), "load {sub}");
    }

    /// Writes objects: index, sub-index, bytes, value.
    ///
    /// # Panics
    /// Panics if the device refuses one.
    #[track_caller]
    pub fn write_all(&mut self, objects: &[(u16, u8, u8, u32)]) {
        for (index, sub, size, value) in objects {
            assert_eq!(self.write(*index, *sub, *size, *value), Ok(()), "{index:04X}:{sub} := {value:X}");
        }
    }

    /// Reads an object, and returns the abort code of the answer.
    ///
    /// # Panics
    /// Panics if the read succeeds.
    #[track_caller]
    pub fn read_abort(&mut self, index: u16, sub: u8) -> u32 {
        let answer = self.sdo(0x40, index, sub, 0);
        let bytes = answer.bytes();
        assert_eq!(bytes[0], 0x80, "no abort: {answer}");
        u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]])
    }

    /// Reads the bytes of an object in segments.
    ///
    /// # Errors
    /// Returns the abort code.
    ///
    /// # Panics
    /// Panics for an answer that does not belong to an upload.
    #[track_caller]
    pub fn read_segmented(&mut self, index: u16, sub: u8) -> Result<Vec<u8>, u32> {
        let answer = self.sdo(0x40, index, sub, 0);
        match answer.bytes() {
            [0x80, _, _, _, code @ ..] => return Err(u32::from_le_bytes(*code)),
            [0x41, ..] => {}
            _ => panic!("no segmented upload: {answer}"),
        }
        let mut data = Vec::new();
        for toggle in [0x00, 0x10].into_iter().cycle() {
            let answer = self.sdo(0x60 | toggle, 0, 0, 0);
            let [command, segment @ ..] = answer.bytes();
            assert_eq!(command & 0xF0, toggle, "no segment with this toggle bit: {answer}");
            data.extend(&segment[..7 - usize::from(command >> 1 & 7)]);
            if command & 1 != 0 {
                break;
            }
        }
        Ok(data)
    }

    /// Writes an object in segments, with an announced size.
    ///
    /// # Errors
    /// Returns the abort code.
    ///
    /// # Panics
    /// Panics for an answer that does not belong to a download.
    #[track_caller]
    pub fn write_segmented(&mut self, index: u16, sub: u8, data: &[u8]) -> Result<(), u32> {
        let accepted = |answer: Frame| match answer.bytes() {
            [0x60 | 0x20 | 0x30, ..] => Ok(()),
            [0x80, _, _, _, code @ ..] => Err(u32::from_le_bytes(*code)),
            _ => panic!("no answer to a download: {answer}"),
        };
        accepted(self.sdo(0x21, index, sub, u32::try_from(data.len()).expect("a short object")))?;
        let count = data.len().div_ceil(7).max(1);
        for number in 0..count {
            let rest = &data[number * 7..];
            let mut segment = [0; 8];
            let len = rest.len().min(7);
            segment[1..=len].copy_from_slice(&rest[..len]);
            let last = number + 1 == count;
            segment[0] = u8::try_from((number & 1) << 4 | (7 - len) << 1 | usize::from(last)).expect("a byte");
            accepted(self.sdo_bytes(segment))?;
        }
        Ok(())
    }

    /// Maps these objects into the PDO with this communication parameter, by the procedure of the manual.
    ///
    /// # Panics
    /// Panics if a step is refused.
    #[track_caller]
    pub fn map(&mut self, communication: u16, entries: &[u32]) {
        const OFF: u32 = 0x8000_0000;
        let mapping = communication + 0x200;
        let cob_id = self.read(communication, 1) & !OFF;
        let count = u32::try_from(entries.len()).expect("a few entries");
        let subs = (1..).zip(entries);
        let steps = [(communication, 1, 4, cob_id | OFF), (mapping, 0, 1, 0), (mapping, 0, 1, count)];
        let steps = steps.into_iter().chain(subs.map(|(sub, entry)| (mapping, sub, 4, *entry)));
        for (index, sub, size, value) in steps.chain([(communication, 1, 4, cob_id)]) {
            assert_eq!(self.write(index, sub, size, value), Ok(()), "{index:04X}:{sub} := {value:X}");
        }
    }

    /// Sends an SDO request with these bytes, and asserts its answer and that the device sends nothing more.
    #[track_caller]
    pub fn exchange_sdo(&mut self, request: &str, answer: Option<&str>) {
        let node_id = self.node_id().expect("a node ID");
        let answer = answer.map(|bytes| crate::sdo::answer(node_id, bytes));
        let answers: Vec<&str> = answer.as_deref().into_iter().collect();
        self.exchange(&crate::sdo::request(node_id, request), &answers);
    }

    /// Sends an SDO request. Returns the answer.
    ///
    /// # Panics
    /// Panics without an answer.
    #[track_caller]
    pub fn sdo(&mut self, command: u8, index: u16, sub: u8, data: u32) -> Frame {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = data.to_le_bytes();
        self.sdo_bytes([command, low, high, sub, a, b, c, d])
    }

    #[track_caller]
    fn sdo_bytes(&mut self, request: [u8; 8]) -> Frame {
        let node_id = self.node_id().expect("a node ID");
        let id = protocol_core::frame::standard(0x600 | u16::from(node_id));
        self.send_frame(Frame::full(id.into(), request));
        let answer = self.take_next().expect("an SDO answer");
        assert_eq!(answer.id(), protocol_core::frame::standard(0x580 | u16::from(node_id)).into(), "{answer}");
        answer
    }
}
