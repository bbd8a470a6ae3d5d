//! The frames that a device may send at any time, whatever the disturbances.

use hal_sim::{Frame, Kind};
use protocol_core::device::Protocol;
use protocol_core::frame::Id;

/// Checks a frame of a device of this kind.
pub(super) fn check(kind: Kind, frame: &Frame) {
    assert!(!frame.is_remote(), "{frame}");
    match kind.protocol() {
        Protocol::Canopen => check_canopen(kind, frame),
        Protocol::Isobus => check_isobus(frame),
    }
}

/// Checks a CANopen frame (SPEC 4.1, 4.2). PDOs and EMCYs can have any identifier that CiA 301 does not restrict.
fn check_canopen(kind: Kind, frame: &Frame) {
    let data = frame.data();
    match frame.id() {
        Id::Standard(id) => match id.as_raw() {
            0x701..=0x77F => assert!(matches!(data, [0x00 | 0x04 | 0x05 | 0x7F]), "an NMT state: {frame}"),
            0x581..=0x5FF => assert!(data.len() == 8 && matches!(data[0] >> 5, 0..=4), "an SDO answer: {frame}"),
            0x7E4 => assert_eq!(data.len(), 8, "an LSS answer: {frame}"),
            0x000..=0x07F | 0x101..=0x180 | 0x601..=0x67F | 0x6E0..=0x6FF | 0x780..=0x7FF => {
                panic!("not a device's: {frame}")
            }
            _ => {}
        },
        Id::Extended(id) if matches!(kind, Kind::Pve(_)) => {
            assert!(id.as_raw() >> 22 == 0x6F && (2..=8).contains(&data.len()), "a UDS answer: {frame}");
        }
        Id::Extended(_) => {}
    }
}

/// Checks an ISOBUS frame (SPEC 5, 7): a message of the right length, from a permitted address of a valve.
fn check_isobus(frame: &Frame) {
    let Id::Extended(id) = frame.id() else { panic!("11 bits: {frame}") };
    let (id, data) = (id.as_raw(), frame.data());
    if id >> 22 == 0x6F {
        assert!((2..=8).contains(&data.len()) && usize::from(data[0]) + 1 == data.len(), "a UDS answer: {frame}");
        return;
    }
    assert_eq!(data.len(), 8, "{frame}");
    let source = id & 0xFF;
    match id >> 8 {
        0x18_EEFF => assert!(matches!(source, 0x80..=0x8F | 0xFE), "a claim: {frame}"),
        message => {
            assert!(matches!(source, 0x80..=0x8F), "no address: {frame}");
            match message {
                0x0C_FE10..=0x0C_FE1F => assert_eq!(message & 0xF, source & 0xF, "AVEF of another: {frame}"),
                0x18_FECA | 0x18_FECB | 0x18_E8FF | 0x1C_EB00..=0x1C_ECFF => {}
                _ => panic!("not a valve's: {frame}"),
            }
        }
    }
}
