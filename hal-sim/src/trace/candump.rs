//! The log format of `candump -L`: `(1700000000.000000) vcan0 18A#0102`.

use std::fmt::Write;

use protocol_core::frame::{Frame, Id};

use super::{ErrorClass, Timestamp, write_hex};

/// Linux's mark of an error frame in an identifier.
const ERROR_FLAG: u32 = 0x2000_0000;

/// A frame, without the end of the line. A 29-bit identifier has eight digits, a remote frame `R` and its length,
/// unless that is 0, in place of the data.
pub fn write_frame(out: &mut String, at: Timestamp, bus: &str, frame: &Frame) {
    // Writing to a string can't fail.
    let _ = match frame.id() {
        Id::Standard(id) => write!(out, "({at}) {bus} {:03X}#", id.as_raw()),
        Id::Extended(id) => write!(out, "({at}) {bus} {:08X}#", id.as_raw()),
    };
    if frame.is_remote() {
        out.push('R');
        if !frame.is_empty() {
            let _ = write!(out, "{}", frame.len());
        }
    }
    write_hex(out, frame.data());
}

/// An error frame, without the end of the line: the class with its mark, and the eight bytes of detail.
pub fn write_error(out: &mut String, at: Timestamp, bus: &str, class: ErrorClass) {
    let data = u64::from_be_bytes(class.data());
    let _ = write!(out, "({at}) {bus} {:08X}#{data:016X}", ERROR_FLAG | class.code());
}

#[cfg(test)]
mod tests {
    use protocol_core::frame::{extended, standard};
    use protocol_core::time::Instant;

    use super::*;

    fn line(frame: &Frame) -> String {
        let mut out = String::new();
        let start = Timestamp::from_micros(1_700_000_000_000_000);
        write_frame(&mut out, start.at(Instant::from_micros(42)), "pve0", frame);
        out
    }

    #[test]
    fn frames_as_candump_logs_them() {
        let sdo = Frame::of(standard(0x5A0).into(), &[0x43, 0x18, 0x10, 0x01, 0x19, 0x00, 0x00, 0x01]).unwrap();
        assert_eq!(line(&sdo), "(1700000000.000042) pve0 5A0#4318100119000001");
        assert_eq!(line(&Frame::of(standard(0x80).into(), &[]).unwrap()), "(1700000000.000042) pve0 080#");
        assert_eq!(line(&Frame::of(extended(0x80).into(), &[1]).unwrap()), "(1700000000.000042) pve0 00000080#01");
    }

    #[test]
    fn remote_frames_have_no_data() {
        assert_eq!(line(&Frame::remote(standard(0x720).into(), 0)), "(1700000000.000042) pve0 720#R");
        assert_eq!(line(&Frame::remote(standard(0x720).into(), 1)), "(1700000000.000042) pve0 720#R1");
        assert_eq!(line(&Frame::remote(extended(0x720).into(), 8)), "(1700000000.000042) pve0 00000720#R8");
    }

    #[test]
    fn error_frames_carry_linux_s_mark() {
        let line = |class| {
            let mut out = String::new();
            write_error(&mut out, Timestamp::from_micros(5), "pve0", class);
            out
        };
        assert_eq!(line(ErrorClass::BusOff), "(0.000005) pve0 20000040#0000000000000000");
        assert_eq!(line(ErrorClass::BusError), "(0.000005) pve0 20000080#0000000000000000");
        assert_eq!(line(ErrorClass::ErrorPassive), "(0.000005) pve0 20000004#0030000000000000");
        assert_eq!(line(ErrorClass::ErrorActive), "(0.000005) pve0 20000004#0040000000000000");
        assert_eq!(line(ErrorClass::Restarted), "(0.000005) pve0 20000100#0000000000000000");
    }
}
