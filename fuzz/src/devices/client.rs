//! A client of a CANopen device. It reads and writes objects, and waits for each answer.

use hal_sim::Frame;
use protocol_core::frame::standard;

use super::rig::Rig;

/// The index and sub-index of an object.
pub(super) type Object = (u16, u8);

/// The bytes of an object, or the abort code of the answer.
pub(super) type Answer = Result<Vec<u8>, u32>;

/// The maximum number of segments of a string of a device.
const SEGMENTS_MAX: usize = 10;

/// Sends the request of an SDO transfer. Returns the data of the answer. Answers to earlier clients precede it.
fn transfer(rig: &mut Rig, unit: usize, request: [u8; 8]) -> Option<[u8; 8]> {
    let id = u16::from(rig.id(unit).filter(|id| *id < 0x80)?);
    let answer_id = standard(0x580 + id).into();
    let frame = Frame::full(standard(0x600 + id).into(), request);
    // Segments have no multiplexer, unlike other transfers.
    let is_segment = request[0] >> 5 == 3;
    let answers = |frame: &Frame| {
        let data = frame.bytes();
        frame.id() == answer_id && if is_segment { matches!(data[0] >> 5, 0 | 4) } else { data[1..4] == request[1..4] }
    };
    rig.ask(unit, frame, answers).map(|answer| *answer.bytes())
}

fn request(command: u8, (index, sub): Object, value: [u8; 4]) -> [u8; 8] {
    let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value);
    [command, low, high, sub, a, b, c, d]
}

/// Reads an object, expedited or in segments; `None` without an answer.
pub(super) fn read(rig: &mut Rig, unit: usize, object: Object) -> Option<Answer> {
    let [command, _, _, _, value @ ..] = transfer(rig, unit, request(0x40, object, [0; 4]))?;
    match command {
        0x43 | 0x47 | 0x4B | 0x4F => return Some(Ok(value[..4 - usize::from(command >> 2 & 3)].to_vec())),
        0x41 => {}
        0x80 => return Some(Err(u32::from_le_bytes(value))),
        _ => panic!("upload of {object:04X?} is answered with {command:02X}"),
    }
    let mut bytes = Vec::new();
    for segment in 0..SEGMENTS_MAX {
        let toggle = if segment % 2 == 0 { 0x00 } else { 0x10 };
        let [command, data @ ..] = transfer(rig, unit, [0x60 | toggle, 0, 0, 0, 0, 0, 0, 0])?;
        assert_eq!(command & 0xF0, toggle, "segment {segment} of {object:04X?}");
        bytes.extend(&data[..7 - usize::from(command >> 1 & 7)]);
        if command & 1 == 1 {
            assert_eq!(bytes.len(), u32::from_le_bytes(value) as usize, "{object:04X?}");
            return Some(Ok(bytes));
        }
    }
    panic!("the upload of {object:04X?} does not end");
}

/// Writes up to four bytes to an object. Returns the abort code of a refusal, `None` without an answer.
pub(super) fn write(rig: &mut Rig, unit: usize, object: Object, bytes: &[u8]) -> Option<Result<(), u32>> {
    let mut value = [0; 4];
    value[..bytes.len()].copy_from_slice(bytes);
    let command = 0x23 | (4 - bytes.len() as u8) << 2;
    let [command, _, _, _, code @ ..] = transfer(rig, unit, request(command, object, value))?;
    Some(if command == 0x60 { Ok(()) } else { Err(u32::from_le_bytes(code)) })
}

/// Reads a number that every device of the kind has.
#[track_caller]
pub(super) fn number(rig: &mut Rig, unit: usize, object: Object) -> u32 {
    let bytes = read(rig, unit, object).unwrap_or_else(|| panic!("{object:04X?} is not answered"));
    let bytes = bytes.unwrap_or_else(|code| panic!("{object:04X?} is refused with {code:08X}"));
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
}

/// Writes to an object, which must accept the value.
#[track_caller]
pub(super) fn set(rig: &mut Rig, unit: usize, object: Object, bytes: &[u8]) {
    let answer = write(rig, unit, object, bytes);
    assert_eq!(answer, Some(Ok(())), "{object:04X?} := {bytes:02X?}");
}
