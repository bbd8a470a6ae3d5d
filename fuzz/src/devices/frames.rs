//! Frames similar to those that the devices know, and any others.

use hal_sim::{Frame, Kind};
use protocol_core::frame::{Id, extended, standard};

use super::bytes::Bytes;
use super::client::Object;

const COMMANDS: [u8; 16] =
    [0x23, 0x2B, 0x2F, 0x40, 0x22, 0x27, 0x21, 0x20, 0x60, 0x70, 0x00, 0x10, 0x0B, 0x1D, 0x80, 0xA0];

const VALVE: [Object; 44] = [
    (0x1000, 0),
    (0x1001, 0),
    (0x1003, 0),
    (0x1003, 1),
    (0x1005, 0),
    (0x100A, 0),
    (0x1010, 1),
    (0x1011, 1),
    (0x1011, 5),
    (0x1014, 0),
    (0x1017, 0),
    (0x1018, 1),
    (0x1028, 1),
    (0x1400, 1),
    (0x1400, 2),
    (0x1600, 0),
    (0x1600, 1),
    (0x1600, 2),
    (0x1600, 3),
    (0x1600, 8),
    (0x1800, 1),
    (0x1800, 2),
    (0x1A00, 0),
    (0x1A00, 1),
    (0x1A00, 2),
    (0x1A00, 3),
    (0x1A00, 8),
    (0x2001, 0),
    (0x201D, 0),
    (0x2040, 0),
    (0x3300, 0),
    (0x3301, 0),
    (0x3303, 0),
    (0x3304, 0),
    (0x6040, 0),
    (0x6041, 0),
    (0x6042, 0),
    (0x6052, 0),
    (0x6053, 0),
    (0x605F, 0),
    (0x6300, 0),
    (0x6300, 1),
    (0x6301, 1),
    (0x1018, 4),
];

const SENSOR: [Object; 40] = [
    (0x1000, 0),
    (0x1001, 0),
    (0x1002, 0),
    (0x1003, 0),
    (0x1003, 1),
    (0x1005, 0),
    (0x1008, 0),
    (0x100A, 0),
    (0x1010, 1),
    (0x1010, 2),
    (0x1010, 3),
    (0x1010, 4),
    (0x1011, 1),
    (0x1011, 2),
    (0x1011, 3),
    (0x1011, 4),
    (0x1014, 0),
    (0x1017, 0),
    (0x1018, 4),
    (0x1029, 1),
    (0x1029, 2),
    (0x1800, 1),
    (0x1800, 2),
    (0x1800, 3),
    (0x1800, 5),
    (0x1A00, 0),
    (0x1A00, 1),
    (0x1A00, 2),
    (0x1A00, 3),
    (0x1A00, 8),
    (0x1F80, 0),
    (0x2001, 1),
    (0x2001, 2),
    (0x2002, 1),
    (0x2002, 2),
    (0x6003, 0),
    (0x6004, 0),
    (0x6503, 0),
    (0x6509, 0),
    (0x650A, 2),
];

const VALUES: [u32; 40] = [
    0,
    1,
    2,
    3,
    4,
    5,
    8,
    10,
    0x0F,
    0x0B,
    100,
    240,
    0xFE,
    0xFF,
    0x4000,
    0xC000,
    0x7FFF,
    0x8000,
    16_383,
    0x6576_6173,
    0x6461_6F6C,
    0x7364_6B70,
    0x80,
    0x81,
    0xA0,
    0xA1,
    0x8000_0081,
    0x8000_0181,
    0x181,
    0x8000_01A0,
    0x1A0,
    0x220,
    0x2000_0181,
    0x6040_0010,
    0x6300_0110,
    0x6041_0010,
    0x6301_0110,
    0x6004_0020,
    0x0007_0020,
    0x0001_0001,
];

/// The parts of the LSS addresses of valves and sensors.
const IDENTITY: [u32; 9] = [0x0100_0019, 0x5336_0000, 0x0001_0020, 0x5B2E_0100, 0xDA, 925_010, 925_011, 0x0001_0007, 1];

fn canopen(id: u16, data: [u8; 8], len: u8) -> Frame {
    Frame::with_len(standard(id & 0x7FF).into(), data, len)
}

fn j1939(id: u32, data: [u8; 8], len: u8) -> Frame {
    Frame::with_len(extended(id & 0x1FFF_FFFF).into(), data, len)
}

/// Returns a command of an SDO client for an object of the device.
pub(super) fn sdo(bytes: &mut Bytes<'_>, kind: Kind, id: u8) -> Frame {
    let command = bytes.one_of(&COMMANDS);
    let objects: &[Object] = if matches!(kind, Kind::Pve(_)) { &VALVE } else { &SENSOR };
    let (index, sub) = bytes.one_of(objects);
    let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), bytes.known_or_any(&VALUES).to_le_bytes());
    canopen(0x600 + u16::from(id), [command, low, high, sub, a, b, c, d], 8)
}

pub(super) fn nmt(bytes: &mut Bytes<'_>, id: u8) -> Frame {
    let command = bytes.u8();
    let node = if command & 0x80 == 0 { id } else { 0 };
    canopen(0, [[0x01, 0x02, 0x80, 0x81, 0x82, 0x03][usize::from(command & 0x7F) % 6], node, 0, 0, 0, 0, 0, 0], 2)
}

pub(super) fn lss(bytes: &mut Bytes<'_>, kind: Kind) -> Frame {
    let own = if matches!(kind, Kind::Pve(_)) { &IDENTITY[..4] } else { &IDENTITY[4..] };
    let command = bytes.one_of(&[
        0x04, 0x11, 0x13, 0x15, 0x17, 0x40, 0x41, 0x42, 0x43, 0x46, 0x47, 0x48, 0x49, 0x4A, 0x4B, 0x4C, 0x51, 0x5A,
        0x5E,
    ]);
    let [a, b, c, d] = match command {
        0x04..=0x17 => [bytes.u8(), bytes.u8(), 0, 0],
        _ => bytes.known_or_any(own).to_le_bytes(),
    };
    let [e, f, g] = if command == 0x51 { bytes.array() } else { [0; 3] };
    canopen(0x7E5, [command, a, b, c, d, e, f, g], 8)
}

/// Returns an RPDO with control word and set-point, as in the default mapping.
pub(super) fn rpdo(bytes: &mut Bytes<'_>, id: u8) -> Frame {
    let word = bytes.one_of(&[0x0F, 0x03, 0x0B, 0x00, 0x01, 0x07, 0xFF]);
    let [low, high, ..] = bytes.known_or_any(&VALUES).to_le_bytes();
    canopen(0x200 + u16::from(id), [word, 0, low, high, 0, 0, 0, 0], 4)
}

/// Returns a SYNC or the EMCY of another node.
pub(super) fn sync_or_emcy(bytes: &mut Bytes<'_>) -> Frame {
    match bytes.u8() {
        0x80.. => canopen(0x80, [0; 8], 0),
        node => canopen(0x80 + u16::from(node), [0, 0x10, 1, 1, 0, 0, 0, 0], 8),
    }
}

pub(super) fn uds(bytes: &mut Bytes<'_>, id: u8) -> Frame {
    let [source, service, value] = bytes.array();
    let (request, len) = match service % 8 {
        0 | 1 => ([4, 0x2E, 0x10, 0x01, value, 0, 0, 0], 5),
        2 => ([3, 0x22, 0x10, 0x01, 0, 0, 0, 0], 4),
        3 => ([3, 0x22, 0xF1, value, 0, 0, 0, 0], 4),
        4 => ([5, 0x2E, 0xF1, value, 0, 0, 0, 0], 6),
        _ => (bytes.array(), value % 9),
    };
    j1939(0x1BC0_0000 | u32::from(source) << 11 | u32::from(id), request, len)
}

/// Returns an auxiliary valve command.
pub(super) fn command(bytes: &mut Bytes<'_>, id: u8) -> Frame {
    let state = bytes.one_of(&[0x30, 0x31, 0x32, 0x33, 0x3A, 0x3E, 0xF0, 0xF1, 0x00, 0x35, 0x71]);
    let flow = bytes.u8();
    j1939(0x0CFE_3027 | u32::from(id & 0xF) << 8, [flow, 0xFF, state, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF], 8)
}

/// Returns a request for a parameter group, to the valve or to all.
pub(super) fn request(bytes: &mut Bytes<'_>, id: u8) -> Frame {
    let what = bytes.u8();
    let avef = 0xFE10 | u32::from(id & 0xF);
    let groups = [0xEE00, 0xFECA, 0xFECB, 0xFECC, avef, 0xFF00];
    let group = groups.get(usize::from(what & 0x7F)).copied().unwrap_or_else(|| bytes.u32());
    let [a, b, c, _] = group.to_le_bytes();
    let destination = if what & 0x80 == 0 { id } else { 0xFF };
    let source = bytes.u8();
    j1939(0x18EA_0000 | u32::from(destination) << 8 | u32::from(source), [a, b, c, 0, 0, 0, 0, 0], 3)
}

/// Returns an address claim of the address of the valve or another, with its NAME or another.
pub(super) fn claim(bytes: &mut Bytes<'_>, id: u8) -> Frame {
    let [serial, source] = bytes.array();
    let source = if source < 0x40 { id } else { source };
    j1939(0x18EE_FF00 | u32::from(source), [serial, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20], 8)
}

/// Returns any frame of the transport protocol.
pub(super) fn transport(bytes: &mut Bytes<'_>, id: u8) -> Frame {
    let what = bytes.u8();
    let function = if what & 1 == 0 { 0x1CEC_0000 } else { 0x1CEB_0000 };
    let destination = if what & 2 == 0 { 0xFF } else { u32::from(id) };
    j1939(function | destination << 8 | u32::from(what >> 2), bytes.array(), 8)
}

pub(super) fn any(bytes: &mut Bytes<'_>) -> Frame {
    let raw = bytes.u32();
    let len = bytes.u8() % 9;
    let id: Id = if raw >> 31 == 1 {
        extended(raw & 0x1FFF_FFFF).into()
    } else {
        standard(u16::try_from(raw & 0x7FF).expect("11 bits")).into()
    };
    if raw >> 30 & 1 == 1 { Frame::remote(id, len) } else { Frame::with_len(id, bytes.array(), len) }
}
