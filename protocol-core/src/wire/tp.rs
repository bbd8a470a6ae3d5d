//! Transport protocol: the broadcast announce message (BAM) and its data packets, the request to send (RTS) and its
//! refusal (SAE J1939-21 5.10).

use super::j1939_id::{Address, J1939Id, Pgn, Priority};
use crate::frame::Frame;

/// The number of payload bytes in a packet.
pub const PACKET_LEN: usize = 7;

/// The minimum size of a message; smaller messages fit a single frame.
pub const MIN_SIZE: u16 = 9;

/// The maximum size of a message: 255 packets.
pub const MAX_SIZE: u16 = u8::MAX as u16 * PACKET_LEN as u16;

/// The control byte of a BAM.
const BAM: u8 = 0x20;

/// The control byte of a request to send (RTS), which asks for a connection.
const REQUEST_TO_SEND: u8 = 0x10;

/// The control byte of a connection abort.
const ABORT: u8 = 0xFF;

/// The value of unused and reserved bytes.
const FILL: u8 = 0xFF;

/// A broadcast announce message (BAM). It precedes the packets of a message to all controllers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Announcement {
    /// The size of the message in bytes.
    pub size: u16,
    /// The number of packets.
    pub packets: u8,
    /// The group of the message.
    pub pgn: Pgn,
}

impl Announcement {
    /// Creates the announcement of a message of `size` bytes; `None` outside [`MIN_SIZE`]–[`MAX_SIZE`].
    #[must_use]
    pub fn new(pgn: Pgn, size: u16) -> Option<Self> {
        let packets = u8::try_from(size.div_ceil(PACKET_LEN as u16)).ok()?;
        (size >= MIN_SIZE).then_some(Self { size, packets, pgn })
    }

    /// Returns whether the size is permitted and the number of packets matches it.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        Self::new(self.pgn, self.size) == Some(*self)
    }

    /// Decodes the eight data bytes of a TP.CM; `None` unless they are a BAM. Size and number of packets are not
    /// checked.
    #[must_use]
    pub const fn parse(bytes: &[u8; 8]) -> Option<Self> {
        match *bytes {
            [BAM, size_low, size_high, packets, _, low, middle, high] => Some(Self {
                size: u16::from_le_bytes([size_low, size_high]),
                packets,
                pgn: Pgn::from_bytes([low, middle, high]),
            }),
            _ => None,
        }
    }

    /// Encodes the announcement as eight data bytes.
    #[must_use]
    pub const fn emit(self) -> [u8; 8] {
        let [size_low, size_high] = self.size.to_le_bytes();
        let [low, middle, high] = self.pgn.to_bytes();
        [BAM, size_low, size_high, self.packets, FILL, low, middle, high]
    }

    /// Encodes the frame `1CECFFyy: 20 size packets FF pgn`.
    #[must_use]
    pub fn frame(self, source: Address) -> Frame {
        Frame::full(J1939Id::global(Priority::TRANSPORT, Pgn::TP_CONNECTION, source).id(), self.emit())
    }
}

/// Returns the group in a request to send (RTS); `None` for any other control byte.
#[must_use]
pub const fn request_to_send(bytes: &[u8; 8]) -> Option<Pgn> {
    match *bytes {
        [REQUEST_TO_SEND, _, _, _, _, low, middle, high] => Some(Pgn::from_bytes([low, middle, high])),
        _ => None,
    }
}

/// A connection abort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Abort {
    /// The reason, a number from the table in SAE J1939-21.
    pub reason: u8,
    /// The group of the connection.
    pub pgn: Pgn,
}

impl Abort {
    /// Encodes the abort as eight data bytes.
    #[must_use]
    pub const fn emit(self) -> [u8; 8] {
        let [low, middle, high] = self.pgn.to_bytes();
        [ABORT, self.reason, FILL, FILL, FILL, low, middle, high]
    }

    /// Encodes the frame `1CECddyy: FF reason FF FF FF pgn` to the controller at `destination`.
    #[must_use]
    pub fn frame(self, destination: Address, source: Address) -> Frame {
        let id = J1939Id::new(Priority::TRANSPORT, Pgn::TP_CONNECTION, destination, source);
        Frame::full(id.id(), self.emit())
    }
}

/// A data packet (TP.DT).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet {
    /// The sequence number; the first packet has 1.
    pub sequence: u8,
    /// The payload bytes.
    pub data: [u8; PACKET_LEN],
}

impl Packet {
    /// Creates a packet from the first seven bytes of `payload`; missing bytes are filled with 0xFF.
    #[must_use]
    pub fn new(sequence: u8, payload: &[u8]) -> Self {
        let mut data = [FILL; PACKET_LEN];
        data.iter_mut().zip(payload).for_each(|(byte, value)| *byte = *value);
        Self { sequence, data }
    }

    /// Decodes the eight data bytes of a TP.DT.
    #[must_use]
    pub const fn parse(bytes: &[u8; 8]) -> Self {
        let &[sequence, a, b, c, d, e, f, g] = bytes;
        Self { sequence, data: [a, b, c, d, e, f, g] }
    }

    /// Encodes the packet as eight data bytes.
    #[must_use]
    pub const fn emit(self) -> [u8; 8] {
        let [a, b, c, d, e, f, g] = self.data;
        [self.sequence, a, b, c, d, e, f, g]
    }

    /// Encodes the frame `1CEBFFyy`: the sequence number and seven bytes.
    #[must_use]
    pub fn frame(self, source: Address) -> Frame {
        Frame::full(J1939Id::global(Priority::TRANSPORT, Pgn::TP_DATA, source).id(), self.emit())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    const TOOL: Address = Address::new(0x27);

    #[test]
    fn the_commanded_address_of_the_manual() {
        let announcement = Announcement::new(Pgn::COMMANDED_ADDRESS, 9).unwrap();
        assert_eq!(announcement.frame(TOOL).to_string(), "1CECFF27: 20 09 00 02 FF D8 FE 00");
        let payload = [0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20, 0x81];
        let packets: [Packet; 2] = [Packet::new(1, &payload), Packet::new(2, &payload[7..])];
        assert_eq!(packets[0].frame(TOOL).to_string(), "1CEBFF27: 01 01 00 20 07 08 FF 02");
        assert_eq!(packets[1].frame(TOOL).to_string(), "1CEBFF27: 02 20 81 FF FF FF FF FF");
        assert_eq!(Announcement::parse(&announcement.emit()), Some(announcement));
        for packet in packets {
            assert_eq!(Packet::parse(&packet.emit()), packet);
        }
    }

    #[test]
    fn sizes_and_packets() {
        for (size, packets) in [(9, Some(2)), (14, Some(2)), (15, Some(3)), (1785, Some(255)), (8, None), (1786, None)]
        {
            assert_eq!(Announcement::new(Pgn::DM2, size).map(|bam| bam.packets), packets, "{size}");
        }
        assert_eq!(Announcement::new(Pgn::DM2, 0), None);
        assert_eq!(Announcement::new(Pgn::DM2, u16::MAX), None);
    }

    #[test]
    fn an_announcement_that_contradicts_itself_is_seen() {
        let sound = Announcement { size: 18, packets: 3, pgn: Pgn::DM2 };
        assert!(sound.is_sound());
        for (size, packets) in [(18, 2), (18, 4), (8, 2), (0, 0), (1786, 0), (0xFFFF, 255)] {
            let bytes = Announcement { size, packets, ..sound }.emit();
            let parsed = Announcement::parse(&bytes).unwrap();
            assert_eq!((parsed.size, parsed.packets), (size, packets));
            assert!(!parsed.is_sound(), "{size} {packets}");
        }
    }

    #[test]
    fn a_request_for_a_connection_and_its_abort() {
        let pgn = Pgn::new(0x00_FED8);
        assert_eq!(request_to_send(&[0x10, 9, 0, 2, 0xFF, 0xD8, 0xFE, 0]), Some(pgn));
        for control in (0..=0xFF).filter(|control| *control != REQUEST_TO_SEND) {
            assert_eq!(request_to_send(&[control, 9, 0, 2, 0xFF, 0xD8, 0xFE, 0]), None);
        }
        let abort = Abort { reason: 2, pgn }.frame(TOOL, Address::new(0x83));
        assert_eq!(abort.to_string(), "1CEC2783: FF 02 FF FF FF D8 FE 00");
    }

    #[test]
    fn other_control_bytes_are_no_announcement() {
        for control in (0..=0xFF).filter(|control| *control != BAM) {
            assert_eq!(Announcement::parse(&[control, 9, 0, 2, 0xFF, 0xD8, 0xFE, 0]), None);
        }
    }
}
