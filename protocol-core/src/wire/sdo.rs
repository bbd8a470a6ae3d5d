//! SDO requests and answers of eight bytes, expedited and segmented (CiA 301 7.2.4.3), and the abort codes.

use super::u32_at;

/// The object of a transfer: index and sub-index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Multiplexer {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
}

impl Multiplexer {
    /// Creates the multiplexer `index:sub`.
    #[inline]
    #[must_use]
    pub const fn new(index: u16, sub: u8) -> Self {
        Self { index, sub }
    }

    #[inline]
    const fn parse(bytes: &[u8; 8]) -> Self {
        let [_, low, high, sub, ..] = *bytes;
        Self { index: u16::from_le_bytes([low, high]), sub }
    }

    /// Encodes `command`, the multiplexer, and four bytes of data.
    #[inline]
    const fn frame(self, command: u8, data: u32) -> [u8; 8] {
        let [low, high] = self.index.to_le_bytes();
        let [a, b, c, d] = data.to_le_bytes();
        [command, low, high, self.sub, a, b, c, d]
    }
}

/// A segment of a transfer, with up to seven bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// The toggle bit: false in the first segment, then alternating.
    pub toggle: bool,
    /// Whether this is the last segment.
    pub last: bool,
    /// The number of used bytes of `data`, 0–7.
    pub len: u8,
    /// The bytes. A server fills the bytes beyond `len` with zeros.
    pub data: [u8; 7],
}

impl Segment {
    /// The maximum number of bytes in a segment.
    pub const MAX: usize = 7;

    /// Returns the used bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.data.get(..usize::from(self.len)).unwrap_or(&[])
    }

    const fn parse(bytes: &[u8; 8]) -> Self {
        let [command, data @ ..] = *bytes;
        let unused = command >> 1 & 0b111;
        Self { toggle: command & TOGGLE != 0, last: command & 1 != 0, len: 7_u8.saturating_sub(unused), data }
    }

    const fn emit(self, specifier: u8) -> [u8; 8] {
        let unused = 7_u8.saturating_sub(self.len);
        let command = specifier | (self.toggle as u8) << 4 | unused << 1 | self.last as u8;
        let [a, b, c, d, e, f, g] = self.data;
        [command, a, b, c, d, e, f, g]
    }
}

/// A request from an SDO client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Read an object.
    InitiateUpload(Multiplexer),
    /// Request the next segment of an upload.
    UploadSegment {
        /// The toggle bit.
        toggle: bool,
    },
    /// Write an object of up to four bytes.
    DownloadExpedited {
        /// The object.
        object: Multiplexer,
        /// The number of used bytes of `data`, 1–4; `None` if the request indicates no size.
        size: Option<u8>,
        /// The four bytes, little-endian.
        data: u32,
    },
    /// Begin a segmented write of an object.
    InitiateDownload {
        /// The object.
        object: Multiplexer,
        /// The number of bytes to follow; `None` if the request indicates no size.
        size: Option<u32>,
    },
    /// The next segment of a download.
    DownloadSegment(Segment),
    /// The client aborts the transfer of an object with this code.
    Abort(Multiplexer, u32),
    /// A block transfer, a network indication or a reserved command. The multiplexer is decoded as in other commands.
    Unknown(Multiplexer),
}

const TOGGLE: u8 = 1 << 4;

/// Returns the number of used bytes in an expedited transfer with a size indication.
const fn expedited_size(command: u8) -> u8 {
    4_u8.saturating_sub(command >> 2 & 0b11)
}

impl Request {
    /// Decodes a request to the server.
    #[inline]
    #[must_use]
    pub fn parse(bytes: &[u8; 8]) -> Self {
        let command = bytes[0];
        let object = Multiplexer::parse(bytes);
        match command >> 5 {
            0 => Self::DownloadSegment(Segment::parse(bytes)),
            1 => {
                let size_given = command & 1 != 0;
                if command & 0b10 != 0 {
                    let size = if size_given { Some(expedited_size(command)) } else { None };
                    Self::DownloadExpedited { object, size, data: u32_at(bytes, 4) }
                } else {
                    let size = if size_given { Some(u32_at(bytes, 4)) } else { None };
                    Self::InitiateDownload { object, size }
                }
            }
            2 => Self::InitiateUpload(object),
            3 => Self::UploadSegment { toggle: command & TOGGLE != 0 },
            4 => Self::Abort(object, u32_at(bytes, 4)),
            _ => Self::Unknown(object),
        }
    }
}

/// An answer from an SDO server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The value of an object of up to four bytes.
    UploadExpedited {
        /// The object.
        object: Multiplexer,
        /// The number of used bytes of `data`, 1–4.
        size: u8,
        /// The bytes, little-endian.
        data: u32,
    },
    /// The value follows in segments.
    UploadInitiated {
        /// The object.
        object: Multiplexer,
        /// The number of bytes to follow.
        size: u32,
    },
    /// A segment of an upload.
    UploadSegment(Segment),
    /// An expedited download was written, or the server is ready for the segments.
    DownloadDone(Multiplexer),
    /// A download segment was accepted.
    DownloadSegmentDone {
        /// The toggle bit of the accepted segment.
        toggle: bool,
    },
    /// The server aborts the transfer of an object.
    Abort(Multiplexer, AbortCode),
}

impl Answer {
    /// Encodes the answer as eight data bytes.
    #[inline]
    #[must_use]
    pub const fn emit(self) -> [u8; 8] {
        match self {
            Self::UploadExpedited { object, size, data } => {
                let unused = 4_u8.saturating_sub(size) & 0b11;
                object.frame(0x43 | unused << 2, data)
            }
            Self::UploadInitiated { object, size } => object.frame(0x41, size),
            Self::UploadSegment(segment) => segment.emit(0x00),
            Self::DownloadDone(object) => object.frame(0x60, 0),
            Self::DownloadSegmentDone { toggle } => [0x20 | (toggle as u8) << 4, 0, 0, 0, 0, 0, 0, 0],
            Self::Abort(object, code) => object.frame(0x80, code.0),
        }
    }

    /// Decodes an answer from a server; `None` for a command that is not part of expedited or segmented transfers.
    #[must_use]
    pub fn parse(bytes: &[u8; 8]) -> Option<Self> {
        let command = bytes[0];
        let object = Multiplexer::parse(bytes);
        Some(match command >> 5 {
            0 => Self::UploadSegment(Segment::parse(bytes)),
            1 => Self::DownloadSegmentDone { toggle: command & TOGGLE != 0 },
            2 if command & 0b10 != 0 => {
                let size = if command & 1 != 0 { expedited_size(command) } else { 4 };
                Self::UploadExpedited { object, size, data: u32_at(bytes, 4) }
            }
            2 => Self::UploadInitiated { object, size: u32_at(bytes, 4) },
            3 => Self::DownloadDone(object),
            4 => Self::Abort(object, AbortCode(u32_at(bytes, 4))),
            _ => return None,
        })
    }
}

/// The code that gives the reason for an abort (CiA 301 7.2.4.3.17).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct AbortCode(pub u32);

impl AbortCode {
    /// Toggle bit not alternated.
    pub const TOGGLE: Self = Self(0x0503_0000);
    /// SDO protocol timed out.
    pub const TIMEOUT: Self = Self(0x0504_0000);
    /// Client or server command specifier not valid or unknown.
    pub const UNKNOWN_COMMAND: Self = Self(0x0504_0001);
    /// Out of memory: the transfer exceeds the server's buffer.
    pub const OUT_OF_MEMORY: Self = Self(0x0504_0005);
    /// Attempt to read a write-only object.
    pub const WRITE_ONLY: Self = Self(0x0601_0001);
    /// Attempt to write a read-only object.
    pub const READ_ONLY: Self = Self(0x0601_0002);
    /// The object does not exist.
    pub const NO_OBJECT: Self = Self(0x0602_0000);
    /// The object cannot be mapped into the PDO.
    pub const NOT_MAPPABLE: Self = Self(0x0604_0041);
    /// The mapped objects would exceed the PDO.
    pub const PDO_TOO_LONG: Self = Self(0x0604_0042);
    /// Access failed because of a hardware error. In these devices: the non-volatile memory failed.
    pub const HARDWARE: Self = Self(0x0606_0000);
    /// The length does not match.
    pub const LENGTH: Self = Self(0x0607_0010);
    /// The length is too high.
    pub const TOO_LONG: Self = Self(0x0607_0012);
    /// The length is too low.
    pub const TOO_SHORT: Self = Self(0x0607_0013);
    /// The sub-index does not exist.
    pub const NO_SUB: Self = Self(0x0609_0011);
    /// The value is invalid.
    pub const INVALID_VALUE: Self = Self(0x0609_0030);
    /// The value is too high.
    pub const TOO_HIGH: Self = Self(0x0609_0031);
    /// The value is too low.
    pub const TOO_LOW: Self = Self(0x0609_0032);
    /// Data cannot be transferred or stored. Objects 0x1010 and 0x1011 refuse a wrong signature with this code.
    pub const CANNOT_STORE: Self = Self(0x0800_0020);
    /// Data cannot be transferred or stored in the present device state.
    pub const DEVICE_STATE: Self = Self(0x0800_0022);
    /// No data are available.
    pub const NO_DATA: Self = Self(0x0800_0024);

    /// Returns the meaning of the code as text.
    #[must_use]
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::TOGGLE => "toggle bit not alternated",
            Self::TIMEOUT => "SDO protocol timed out",
            Self::UNKNOWN_COMMAND => "unknown command specifier",
            Self::OUT_OF_MEMORY => "out of memory",
            Self::WRITE_ONLY => "write-only object",
            Self::READ_ONLY => "read-only object",
            Self::NO_OBJECT => "object does not exist",
            Self::NOT_MAPPABLE => "object cannot be mapped",
            Self::PDO_TOO_LONG => "mapping exceeds the PDO",
            Self::HARDWARE => "hardware error",
            Self::LENGTH => "length does not match",
            Self::TOO_LONG => "length too high",
            Self::TOO_SHORT => "length too low",
            Self::NO_SUB => "sub-index does not exist",
            Self::INVALID_VALUE => "invalid value",
            Self::TOO_HIGH => "value too high",
            Self::TOO_LOW => "value too low",
            Self::CANNOT_STORE => "cannot be stored",
            Self::DEVICE_STATE => "not in this device state",
            Self::NO_DATA => "no data available",
            _ => "unknown abort code",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDENTITY_1: Multiplexer = Multiplexer::new(0x1018, 1);

    #[test]
    fn uploads_as_the_manual_prints_them() {
        assert_eq!(Request::parse(&[0x40, 0x18, 0x10, 0x01, 0, 0, 0, 0]), Request::InitiateUpload(IDENTITY_1));
        let answer = Answer::UploadExpedited { object: IDENTITY_1, size: 4, data: 0x0100_0019 };
        assert_eq!(answer.emit(), [0x43, 0x18, 0x10, 0x01, 0x19, 0x00, 0x00, 0x01]);
        let short = Answer::UploadExpedited { object: Multiplexer::new(0x6041, 0), size: 2, data: 0x000F };
        assert_eq!(short.emit(), [0x4B, 0x41, 0x60, 0x00, 0x0F, 0, 0, 0]);
        let byte = Answer::UploadExpedited { object: Multiplexer::new(0x1001, 0), size: 1, data: 0x05 };
        assert_eq!(byte.emit(), [0x4F, 0x01, 0x10, 0x00, 0x05, 0, 0, 0]);
    }

    #[test]
    fn downloads_as_the_manual_prints_them() {
        // Use case 6: expedited, without a size.
        let load = Request::parse(&[0x22, 0x11, 0x10, 0x01, 0x6C, 0x6F, 0x61, 0x64]);
        let object = Multiplexer::new(0x1011, 1);
        assert_eq!(load, Request::DownloadExpedited { object, size: None, data: 0x6461_6F6C });
        assert_eq!(Answer::DownloadDone(object).emit(), [0x60, 0x11, 0x10, 0x01, 0, 0, 0, 0]);
        // The heartbeat example: two bytes.
        let heartbeat = Request::parse(&[0x2B, 0x17, 0x10, 0x00, 0x64, 0, 0, 0]);
        let object = Multiplexer::new(0x1017, 0);
        assert_eq!(heartbeat, Request::DownloadExpedited { object, size: Some(2), data: 0x64 });
    }

    #[test]
    fn segments_both_ways() {
        let object = Multiplexer::new(0x100A, 0);
        assert_eq!(Answer::UploadInitiated { object, size: 45 }.emit(), [0x41, 0x0A, 0x10, 0x00, 45, 0, 0, 0]);
        assert_eq!(Request::parse(&[0x70, 0, 0, 0, 0, 0, 0, 0]), Request::UploadSegment { toggle: true });
        let segment = Segment { toggle: true, last: true, len: 3, data: *b"abc\0\0\0\0" };
        assert_eq!(Answer::UploadSegment(segment).emit(), [0x19, b'a', b'b', b'c', 0, 0, 0, 0]);
        assert_eq!(Request::parse(&[0x19, b'a', b'b', b'c', 0, 0, 0, 0]), Request::DownloadSegment(segment));
        assert_eq!(segment.bytes(), b"abc");
        assert_eq!(
            Request::parse(&[0x21, 0x53, 0x60, 0x00, 10, 0, 0, 0]),
            Request::InitiateDownload { object: Multiplexer::new(0x6053, 0), size: Some(10) }
        );
        assert_eq!(Answer::DownloadSegmentDone { toggle: true }.emit(), [0x30, 0, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn every_answer_parses_back() {
        let object = Multiplexer::new(0x6053, 0);
        for answer in [
            Answer::UploadExpedited { object, size: 3, data: 0x0003_0201 },
            Answer::UploadInitiated { object, size: 10 },
            Answer::UploadSegment(Segment { toggle: false, last: false, len: 7, data: *b"abcdefg" }),
            Answer::DownloadDone(object),
            Answer::DownloadSegmentDone { toggle: false },
            Answer::Abort(object, AbortCode::NO_OBJECT),
        ] {
            assert_eq!(Answer::parse(&answer.emit()), Some(answer));
        }
        assert_eq!(Answer::parse(&[0xC0, 0, 0, 0, 0, 0, 0, 0]), None);
    }

    #[test]
    fn every_first_byte_is_some_request() {
        for command in 0..=255 {
            let request = Request::parse(&[command, 0x18, 0x10, 0x01, 1, 2, 3, 4]);
            match (command >> 5, request) {
                (4, Request::Abort(IDENTITY_1, 0x0403_0201))
                | (2, Request::InitiateUpload(IDENTITY_1))
                | (5..=7, Request::Unknown(IDENTITY_1))
                | (0, Request::DownloadSegment(_))
                | (1, Request::DownloadExpedited { .. } | Request::InitiateDownload { .. })
                | (3, Request::UploadSegment { .. }) => {}
                (_, request) => panic!("{command:02X}: {request:?}"),
            }
        }
    }
}
