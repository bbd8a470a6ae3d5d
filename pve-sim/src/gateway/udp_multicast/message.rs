//! Decodes and encodes datagrams: python-can's `Message` as a MessagePack map. No I/O.

use protocol_core::frame::{Frame, MAX_LEN, identifier, number};
use serde::{Deserialize, Serialize};
use serde_bytes::Bytes;

use hal_sim::log::Timestamp;

/// A message with all keys. Of a received message, only the keys that define a frame are read; missing ones have the
/// defaults of python-can's constructor.
#[derive(Debug, Serialize, Deserialize)]
struct Message<'a> {
    /// The time in seconds since 1970; python-can replaces this time by that of the arrival.
    #[serde(skip_deserializing)]
    timestamp: f64,
    arbitration_id: u32,
    #[serde(default = "yes")]
    is_extended_id: bool,
    #[serde(default)]
    is_remote_frame: bool,
    #[serde(default)]
    is_error_frame: bool,
    #[serde(skip_deserializing)]
    channel: Option<&'a str>,
    dlc: Option<u8>,
    #[serde(borrow)]
    data: Option<&'a Bytes>,
    #[serde(default)]
    is_fd: bool,
    #[serde(skip_deserializing)]
    bitrate_switch: bool,
    #[serde(skip_deserializing)]
    error_state_indicator: bool,
}

const fn yes() -> bool {
    true
}

/// The reason why a datagram is not a frame of this bus.
pub type NoFrame = &'static str;

const NO_MESSAGE: NoFrame = "a datagram that is not a python-can message";
const INVALID: NoFrame = "an invalid frame";
const FD: NoFrame = "a CAN FD frame";
const ERROR: NoFrame = "an error frame";

/// Decodes a datagram.
///
/// # Errors
/// The reason, for everything but a classic CAN frame.
pub fn parse(datagram: &[u8]) -> Result<Frame, NoFrame> {
    // Serde would also accept a list of the members' values.
    if !matches!(datagram.first(), Some(0x80..=0x8F | 0xDE | 0xDF)) {
        return Err(NO_MESSAGE);
    }
    let message: Message<'_> = rmp_serde::from_slice(datagram).map_err(|_| NO_MESSAGE)?;
    if message.is_error_frame {
        return Err(ERROR);
    }
    if message.is_fd {
        return Err(FD);
    }
    frame(&message).ok_or(INVALID)
}

fn frame(message: &Message<'_>) -> Option<Frame> {
    let id = identifier(message.arbitration_id, message.is_extended_id)?;
    let data: &[u8] = message.data.map_or(&[], |data| data);
    if message.is_remote_frame {
        let len = message.dlc.unwrap_or(0);
        return (data.is_empty() && usize::from(len) <= MAX_LEN).then(|| Frame::remote(id, len));
    }
    let frame = Frame::of(id, data)?;
    message.dlc.is_none_or(|len| len == frame.len()).then_some(frame)
}

/// Encodes a frame as a datagram.
#[must_use]
pub fn emit(at: Timestamp, frame: &Frame) -> Vec<u8> {
    let message = Message {
        timestamp: std::time::Duration::from_micros(at.as_micros()).as_secs_f64(),
        arbitration_id: number(frame.id()),
        is_extended_id: frame.is_extended(),
        is_remote_frame: frame.is_remote(),
        is_error_frame: false,
        channel: None,
        dlc: Some(frame.len()),
        data: Some(Bytes::new(frame.data())),
        is_fd: false,
        bitrate_switch: false,
        error_state_indicator: false,
    };
    // MessagePack has all these types, and writing to a vector cannot fail.
    rmp_serde::to_vec_named(&message).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use protocol_core::frame::{extended, standard};

    use super::*;

    /// The output of python-can 4.6.1 with msgpack 1.2.4 for `can.Message(timestamp=1.5, arbitration_id=0x1A0,
    /// is_extended_id=False, data=[9, 0, 255, 1])`.
    const OF_PYTHON: &str = "8ba974696d657374616d70cb3ff8000000000000ae6172626974726174696f6e5f6964cd01a0ae69735f657874656e6465645f6964c2af69735f72656d6f74655f6672616d65c2ae69735f6572726f725f6672616d65c2a76368616e6e656cc0a3646c6304a464617461c4040900ff01a569735f6664c2ae626974726174655f737769746368c2b56572726f725f73746174655f696e64696361746f72c2";

    fn bytes(hex: &str) -> Vec<u8> {
        (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).expect("hex")).collect()
    }

    /// Encodes a MessagePack map of short keys and already encoded values.
    fn map(pairs: &[(&str, &[u8])]) -> Vec<u8> {
        let mut out = vec![0x80 | u8::try_from(pairs.len()).expect("a short map")];
        for (key, value) in pairs {
            out.push(0xA0 | u8::try_from(key.len()).expect("a short key"));
            out.extend(key.bytes().chain(value.iter().copied()));
        }
        out
    }

    const FALSE: &[u8] = &[0xC2];
    const TRUE: &[u8] = &[0xC3];

    #[test]
    fn a_frame_is_the_datagram_of_python_can() {
        let frame = Frame::of(standard(0x1A0).into(), &[9, 0, 255, 1]).expect("a frame");
        assert_eq!(emit(Timestamp::from_micros(1_500_000), &frame), bytes(OF_PYTHON));
        assert_eq!(parse(&bytes(OF_PYTHON)), Ok(frame));
    }

    #[test]
    fn every_frame_comes_back_as_it_was() {
        for frame in [
            Frame::of(standard(0).into(), &[]).expect("a frame"),
            Frame::of(standard(0x7FF).into(), &[0; 8]).expect("a frame"),
            Frame::of(extended(0).into(), &[1]).expect("a frame"),
            Frame::of(extended(0x1FFF_FFFF).into(), &[255; 8]).expect("a frame"),
            Frame::remote(standard(0x123).into(), 8),
            Frame::remote(extended(0x123).into(), 0),
        ] {
            assert_eq!(parse(&emit(Timestamp::from_micros(u64::MAX), &frame)), Ok(frame));
        }
    }

    #[test]
    fn missing_keys_are_those_of_the_constructor_and_others_do_not_matter() {
        let frame = parse(&map(&[("arbitration_id", &[0x11]), ("color", &[0xA3, b'r', b'e', b'd'])]));
        assert_eq!(frame, Ok(Frame::of(extended(0x11).into(), &[]).expect("a frame")));
        let nil = parse(&map(&[("arbitration_id", &[0x11]), ("data", &[0xC0]), ("dlc", &[0xC0])]));
        assert_eq!(nil, frame);
    }

    #[test]
    fn what_is_no_classic_frame_is_told_apart() {
        let standard = ("is_extended_id", FALSE);
        for (pairs, refusal) in [
            (&[][..], NO_MESSAGE),
            (&[("arbitration_id", &[0xA1, b'x'][..])], NO_MESSAGE),
            (&[("arbitration_id", &[0xFF])], NO_MESSAGE),
            (&[("arbitration_id", &[0x11]), ("is_fd", TRUE)], FD),
            (&[("arbitration_id", &[0x11]), ("is_error_frame", TRUE)], ERROR),
            (&[("arbitration_id", &[0xCD, 0x08, 0x00]), standard], INVALID),
            (&[("arbitration_id", &[0xCE, 0x20, 0, 0, 0])], INVALID),
            (&[("arbitration_id", &[0x11]), ("dlc", &[1])], INVALID),
            (&[("arbitration_id", &[0x11]), ("dlc", &[9]), ("is_remote_frame", TRUE)], INVALID),
            (&[("arbitration_id", &[0x11]), ("data", &[0xC4, 1, 7]), ("is_remote_frame", TRUE)], INVALID),
            (&[("arbitration_id", &[0x11]), ("data", &[0xC4, 9, 1, 2, 3, 4, 5, 6, 7, 8, 9])], INVALID),
        ] {
            assert_eq!(parse(&map(pairs)), Err(refusal), "{pairs:02X?}");
        }
        assert_eq!(parse(&[]), Err(NO_MESSAGE));
        assert_eq!(parse(&bytes("9711c2c2c2c0c0c2")), Err(NO_MESSAGE), "a list of members without keys");
        assert_eq!(parse(&[0x91; 4096]), Err(NO_MESSAGE), "lists in lists");
    }

    proptest! {
        #[test]
        fn any_datagram_is_read(datagram: Vec<u8>) {
            let _ = parse(&datagram);
        }

        #[test]
        fn a_datagram_with_one_byte_changed_is_read(at in 0_usize..200, byte: u8) {
            let mut datagram = bytes(OF_PYTHON);
            if let Some(slot) = datagram.get_mut(at) {
                *slot = byte;
            }
            let _ = parse(&datagram);
        }
    }
}
