//! pcapng with the SocketCAN link type (227): one packet per frame, in the layout of Linux's `struct can_frame`.

use std::io::{self, Cursor, Read, Write};

use pcap_parser::traits::{PcapNGPacketBlock as _, PcapReaderIterator as _};
use pcap_parser::{Block, PcapBlockOwned, PcapError, PcapNGReader};
use protocol_core::frame::number;

use super::{Logged, ReadError, invalid};
use crate::log::candump::FD;
use crate::log::{ERROR_FLAG, EXTENDED_FLAG, Entry, REMOTE_FLAG, Reason, Record, Timestamp};

/// The first bytes of a pcapng file, equal in both byte orders.
pub(super) const MAGIC: [u8; 4] = [0x0A, 0x0D, 0x0D, 0x0A];

/// `LINKTYPE_CAN_SOCKETCAN`. A packet contains the identifier in network byte order, the length, the flags, two zero
/// bytes, and the data.
const SOCKETCAN: u16 = 227;
const HEAD: usize = 8;

/// The bit of the flags that marks a CAN FD frame.
const FD_FLAG: u8 = 0x04;

/// The byte-order magic of a section header.
const BYTE_ORDER: u32 = 0x1A2B_3C4D;

const SECTION_HEADER: u32 = 0x0A0D_0D0A;
const INTERFACE_DESCRIPTION: u32 = 1;
const INTERFACE_STATISTICS: u32 = 5;
const ENHANCED_PACKET: u32 = 6;

/// The option codes of a block.
const END_OF_OPTIONS: u16 = 0;
const COMMENT: u16 = 1;

/// The maximum size of a block in bytes, far above the size of any block in a CAN capture.
const BLOCK_MAX: usize = 1 << 16;

/// Writes the file header: a section header, and an interface description with the bus name and microsecond timestamps.
pub(super) fn write_head(out: &mut impl Write, bus: &str) -> io::Result<()> {
    let mut section = Vec::new();
    section.extend(BYTE_ORDER.to_le_bytes());
    section.extend([1_u16, 0].map(u16::to_le_bytes).as_flattened());
    // The length of the section is unknown.
    section.extend(u64::MAX.to_le_bytes());
    write_block(out, SECTION_HEADER, &section)?;
    let mut interface = Vec::new();
    interface.extend([SOCKETCAN, 0].map(u16::to_le_bytes).as_flattened());
    // The capture length is unlimited.
    interface.extend(0_u32.to_le_bytes());
    // The options: the name, a time resolution of 10^-6 s, the end.
    for (code, value) in [(2_u16, bus.as_bytes()), (9, &[6]), (END_OF_OPTIONS, &[])] {
        write_option(&mut interface, code, value);
    }
    write_block(out, INTERFACE_DESCRIPTION, &interface)
}

fn write_option(block: &mut Vec<u8>, code: u16, value: &[u8]) {
    let length = u16::try_from(value.len()).unwrap_or_default();
    block.extend([code, length].map(u16::to_le_bytes).as_flattened());
    block.extend(value.get(..length.into()).unwrap_or_default());
    block.resize(block.len().next_multiple_of(4), 0);
}

/// Writes an entry with its comments.
pub(super) fn write(out: &mut impl Write, Record { at, entry }: &Record, comments: &[String]) -> io::Result<()> {
    let (id, length, data) = match entry {
        Entry::Frame(frame) => {
            let remote = if frame.is_remote() { REMOTE_FLAG } else { 0 };
            let extended = if frame.is_extended() { EXTENDED_FLAG } else { 0 };
            (number(frame.id()) | extended | remote, frame.len(), frame.data())
        }
        Entry::Error(error) => (error.class | ERROR_FLAG, 8, error.data.as_slice()),
    };
    let length_of_packet = (HEAD + data.len()) as u32;
    let (high, low) = ((at.as_micros() >> 32) as u32, at.as_micros() as u32);
    let mut body = Vec::with_capacity(40);
    // The first interface, the time, the captured and the original length.
    for number in [0, high, low, length_of_packet, length_of_packet] {
        body.extend(number.to_le_bytes());
    }
    body.extend(id.to_be_bytes());
    body.extend([length, 0, 0, 0]);
    body.extend(data);
    body.resize(body.len().next_multiple_of(4), 0);
    write_comments(&mut body, comments);
    write_block(out, ENHANCED_PACKET, &body)
}

/// Writes the comments after the last packet, in a block of interface statistics at the end of the file.
pub(super) fn write_end(out: &mut impl Write, at: Timestamp, comments: &[String]) -> io::Result<()> {
    let mut body = Vec::new();
    // The first interface, and the time.
    for number in [0, (at.as_micros() >> 32) as u32, at.as_micros() as u32] {
        body.extend(number.to_le_bytes());
    }
    write_comments(&mut body, comments);
    write_block(out, INTERFACE_STATISTICS, &body)
}

fn write_comments(block: &mut Vec<u8>, comments: &[String]) {
    for comment in comments {
        write_option(block, COMMENT, comment.as_bytes());
    }
    if !comments.is_empty() {
        write_option(block, END_OF_OPTIONS, &[]);
    }
}

fn write_block(out: &mut impl Write, kind: u32, body: &[u8]) -> io::Result<()> {
    let padded = body.len().next_multiple_of(4);
    let length = (padded + 12) as u32;
    let mut block = Vec::with_capacity(padded + 12);
    block.extend([kind, length].map(u32::to_le_bytes).as_flattened());
    block.extend(body);
    block.resize(padded + 8, 0);
    block.extend(length.to_le_bytes());
    out.write_all(&block)
}

/// An interface described in the current section.
#[derive(Debug)]
struct Interface {
    name: String,
    link_type: i32,
    /// The number of timestamp units per second.
    resolution: u128,
    /// The offset of all times, in seconds.
    offset: i64,
    /// True once a message has named a link type that cannot be read.
    is_refused: bool,
}

pub(super) struct Packets {
    reader: PcapNGReader<Box<dyn Read + Send>>,
    interfaces: Vec<Interface>,
    /// The interface of the last packet.
    last: usize,
    /// The number of the last packet, from 1.
    number: u64,
    /// True if the rest of the file is unreadable.
    is_broken: bool,
}

impl Packets {
    /// Starts to read a pcapng file.
    ///
    /// # Errors
    /// [`io::Error`] if the first block is truncated or invalid.
    pub(super) fn new(mut source: Box<dyn Read + Send>) -> io::Result<Self> {
        // `PcapNGReader` requires the complete first block from its first read, which a pipe does not guarantee.
        let mut head = [0; 12];
        source.read_exact(&mut head).map_err(|_| invalid(CUT_OFF))?;
        let [_, _, _, _, a, b, c, d, order @ ..] = head;
        let is_big = order == BYTE_ORDER.to_be_bytes();
        let length = if is_big { u32::from_be_bytes([a, b, c, d]) } else { u32::from_le_bytes([a, b, c, d]) } as usize;
        if !(28..=BLOCK_MAX).contains(&length) {
            return Err(invalid(BROKEN));
        }
        let mut rest = vec![0; length - head.len()];
        source.read_exact(&mut rest).map_err(|_| invalid(CUT_OFF))?;
        let block = [&head[..], &rest].concat();
        let whole: Box<dyn Read + Send> = Box::new(Cursor::new(block).chain(source));
        let reader = PcapNGReader::new(BLOCK_MAX * 2, whole).map_err(|_| invalid(BROKEN))?;
        Ok(Self { reader, interfaces: Vec::new(), last: 0, number: 0, is_broken: false })
    }

    /// Returns the name of the last packet's interface.
    pub(super) fn bus(&self) -> &str {
        self.interfaces.get(self.last).map_or("can0", |interface| &interface.name)
    }

    /// Returns whether the buffer is empty, so that the next read may block.
    pub(super) fn may_wait(&self) -> bool {
        self.reader.data().is_empty()
    }

    /// Decodes the next packet block, skipping other blocks; returns `None` at the end of the file.
    pub(super) fn next(&mut self) -> Result<Option<Logged>, ReadError> {
        let found = loop {
            if self.is_broken {
                return Ok(None);
            }
            let (length, found) = match self.reader.next() {
                Ok((length, block)) => (length, take(&mut self.interfaces, &mut self.last, &block)),
                Err(PcapError::Eof) => return Ok(None),
                Err(PcapError::Incomplete(_)) => {
                    let unread = |_| io::Error::other("the rest of the file cannot be read");
                    self.reader.refill().map_err(unread)?;
                    continue;
                }
                Err(error) => {
                    self.is_broken = true;
                    self.number += 1;
                    break Err(if matches!(error, PcapError::UnexpectedEof) { CUT_OFF } else { BROKEN });
                }
            };
            self.reader.consume(length);
            let Some(found) = found else { continue };
            self.number += 1;
            let interface = self.interfaces.get_mut(self.last).filter(|_| found == Err(LINK_TYPE));
            // One message for all packets of an interface.
            if !interface.is_some_and(|interface| std::mem::replace(&mut interface.is_refused, true)) {
                break found;
            }
        };
        let number = self.number;
        match found {
            Ok(record) => Ok(Some(Logged { number, record })),
            Err(reason) => Err(ReadError::NoEntry { number, reason, text: String::new() }),
        }
    }
}

const LINK_TYPE: Reason = "the link type is not SocketCAN (227); the packets of this interface are skipped";
const CUT_OFF: Reason = "the file is truncated here";
const BROKEN: Reason = "invalid pcapng block; the rest of the file is unreadable";

/// Decodes a packet block. Returns `None` for any other block; a section header or interface description updates
/// `interfaces`.
fn take(
    interfaces: &mut Vec<Interface>,
    last: &mut usize,
    block: &PcapBlockOwned<'_>,
) -> Option<Result<Record, Reason>> {
    match block {
        PcapBlockOwned::NG(Block::SectionHeader(_)) => interfaces.clear(),
        PcapBlockOwned::NG(Block::InterfaceDescription(described)) => interfaces.push(Interface {
            name: name(described.if_name().and_then(Result::ok).unwrap_or_default()),
            link_type: described.linktype.0,
            resolution: resolution(described.if_tsresol),
            offset: described.if_tsoffset,
            is_refused: false,
        }),
        PcapBlockOwned::NG(Block::EnhancedPacket(packet)) => {
            *last = usize::try_from(packet.if_id).unwrap_or(usize::MAX);
            let interface = interfaces.get(*last);
            let Some(interface) = interface else { return Some(Err("the packet refers to an unknown interface")) };
            if interface.link_type != i32::from(SOCKETCAN) {
                return Some(Err(LINK_TYPE));
            }
            let at = interface.time(u64::from(packet.ts_high) << 32 | u64::from(packet.ts_low));
            let entry = entry(packet.packet_data());
            return Some(entry.and_then(|entry| Ok(Record { at: at.ok_or("invalid timestamp")?, entry })));
        }
        PcapBlockOwned::NG(Block::SimplePacket(_)) => return Some(Err("the packet has no timestamp")),
        _ => {}
    }
    None
}

/// Converts an interface name to a bus name for candump lines, without spaces.
fn name(told: &str) -> String {
    let name = if told.is_empty() { "can0" } else { told };
    name.replace(|char: char| char.is_whitespace() || char.is_control(), "_")
}

/// Returns the number of timestamp units per second. The low seven bits are an exponent of 10, or of 2 if the highest
/// bit is set. The exponent is limited so that the result fits into 64 bits.
fn resolution(told: u8) -> u128 {
    match (told & 0x80, told & 0x7F) {
        (0, power) => 10_u128.pow(u32::from(power.min(19))),
        (_, power) => 1 << power.min(63),
    }
}

impl Interface {
    fn time(&self, raw: u64) -> Option<Timestamp> {
        let micros = u128::from(raw) * 1_000_000 / self.resolution;
        let micros = i128::try_from(micros).ok()? + i128::from(self.offset) * 1_000_000;
        u64::try_from(micros).ok().map(Timestamp::from_micros)
    }
}

fn entry(packet: &[u8]) -> Result<Entry, Reason> {
    let Some((&[a, b, c, d, length, flags, _, _], data)) = packet.split_first_chunk::<HEAD>() else {
        return Err("the packet is too short for a frame");
    };
    if length > 8 || flags & FD_FLAG != 0 {
        return Err(FD);
    }
    let id = u32::from_be_bytes([a, b, c, d]);
    let mut bytes = [0; 8];
    bytes.iter_mut().zip(data).for_each(|(room, byte)| *room = *byte);
    let entry = Entry::of_can_frame(id, length, bytes)?;
    if id & (ERROR_FLAG | REMOTE_FLAG) == 0 && data.len() < usize::from(length) {
        return Err("fewer bytes than the stated length");
    }
    Ok(entry)
}
