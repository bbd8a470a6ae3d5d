//! Recordings are read back as written; arbitrary bytes are reported line by line.

use std::cell::Cell;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use std::rc::Rc;

use proptest::collection::vec;
use proptest::prelude::*;
use protocol_core::frame::{Frame, extended, standard};

use super::*;
use crate::log::{Entry, ErrorClass, ErrorFrame, Record, Timestamp};

/// The wall-clock time of the first entry, in microseconds, with a fraction of a millisecond.
const START: u64 = 1_700_000_000_000_042;

const FORMATS: [Format; 3] = [Format::Candump, Format::Asc, Format::Pcapng];

fn written(format: Format, records: &[Record]) -> Vec<u8> {
    let mut writer = Writer::new(Vec::new(), format, "pve0", Timestamp::from_micros(START)).unwrap();
    records.iter().for_each(|record| writer.write(record).unwrap());
    writer.finish().unwrap()
}

/// A reader that returns one byte at a time, as a slow pipe may.
struct Slow(Cursor<Vec<u8>>);

impl Read for Slow {
    fn read(&mut self, room: &mut [u8]) -> std::io::Result<usize> {
        let one = room.len().min(1);
        self.0.read(&mut room[..one])
    }
}

/// Reads all entries, and the error messages.
fn read(source: impl Read + Send + 'static, ending: Format) -> (Vec<Record>, Vec<String>) {
    let (mut records, mut errors) = (Vec::new(), Vec::new());
    match Reader::new(source, ending) {
        Err(error) => errors.push(error.to_string()),
        Ok(reader) => {
            for entry in reader {
                match entry {
                    Ok(Logged { record, .. }) => records.push(record),
                    Err(error) => errors.push(error.to_string()),
                }
            }
        }
    }
    (records, errors)
}

fn text(text: &str) -> (Vec<Record>, Vec<String>) {
    read(Cursor::new(text.as_bytes().to_vec()), Format::Candump)
}

fn frame(micros: u64, text: &str) -> Record {
    Record { at: Timestamp::from_micros(micros), entry: Entry::Frame(text.parse().unwrap()) }
}

fn frames() -> impl Strategy<Value = Frame> {
    let id = prop_oneof![
        (0..=0x7FF_u16).prop_map(|id| standard(id).into()),
        (0..=0x1FFF_FFFF_u32).prop_map(|id| extended(id).into())
    ];
    (id, any::<[u8; 8]>(), 0..=8_u8, any::<bool>()).prop_map(|(id, data, len, remote)| {
        if remote { Frame::remote(id, len) } else { Frame::with_len(id, data, len) }
    })
}

fn records() -> impl Strategy<Value = Vec<Record>> {
    let classes =
        [ErrorClass::NoAcknowledge, ErrorClass::ErrorPassive, ErrorClass::BusOff, ErrorClass::TransmitOverflow];
    let entry = prop_oneof![
        9 => frames().prop_map(Entry::Frame),
        1 => prop::sample::select(classes.to_vec()).prop_map(|class| Entry::Error(class.into()))
    ];
    vec((0..10_000_000_u64, entry), 0..40).prop_map(|entries| {
        let mut at = START;
        let later = |(pause, entry)| {
            at += pause;
            Record { at: Timestamp::from_micros(at), entry }
        };
        entries.into_iter().map(later).collect()
    })
}

/// Generates the bytes of a text with short lines, including comments.
fn bytes_of_lines() -> impl Strategy<Value = u8> {
    prop_oneof![20 => any::<u8>(), 2 => Just(b'\n'), 1 => Just(b'#'), 1 => Just(b'/'), 1 => Just(b' ')]
}

proptest! {
    /// Times are exact to the microsecond; only ASC does not record the class of an error frame.
    #[test]
    fn what_is_written_is_read(records in records()) {
        for format in FORMATS {
            let (read, errors) = read(Cursor::new(written(format, &records)), Format::Candump);
            let expected = records.iter().map(|record| match record.entry {
                Entry::Error(_) if format == Format::Asc => {
                    Record { entry: Entry::Error(ErrorFrame::UNTOLD), ..*record }
                }
                _ => *record,
            });
            // An empty file has no format.
            let is_empty = format == Format::Candump && records.is_empty();
            prop_assert_eq!(errors.len(), usize::from(is_empty), "{:?}", errors);
            prop_assert_eq!(read, expected.collect::<Vec<_>>());
        }
    }

    /// Each line is an entry or is reported, or the file is refused as a whole. Blank lines and comments are skipped,
    /// and in ASC also other events.
    #[test]
    fn any_bytes_end_with_names(bytes in vec(bytes_of_lines(), 0..400), head in 0..6_usize) {
        let head = [&b""[..], b"date x\n", b"\n\r\r\n", b"(1.0) can0 ", b"# a remark\n", b"\xEF\xBB\xBF"][head];
        let bytes = [head, &bytes].concat();
        let is_packets = bytes.starts_with(&pcapng::MAGIC);
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let lines: Vec<&str> = text.split('\n').map(|line| line.trim_start_matches('\u{FEFF}')).collect();
        let told: Vec<&&str> = lines.iter().filter(|line| !line.trim().is_empty() && !line.starts_with('#')).collect();
        let (records, errors) = read(Cursor::new(bytes), Format::Candump);
        let found = records.len() + errors.len();
        if is_packets {
            prop_assert!(found > 0);
        } else if errors.iter().any(|error| error.contains("accepted: ") || error == foreign::EMPTY) {
            prop_assert_eq!(found, 1);
        } else if told.first().is_some_and(|line| asc::is_head(line)) {
            prop_assert!(found < told.len());
        } else {
            prop_assert_eq!(found, told.len());
        }
    }

    /// Files with a few wrong bytes, and truncated files.
    #[test]
    fn broken_files_are_read_as_far_as_they_go(
        records in records(), at in any::<prop::sample::Index>(), wrong in any::<u8>(), cut in any::<bool>()
    ) {
        for format in FORMATS {
            let mut bytes = written(format, &records);
            if bytes.is_empty() {
                continue;
            }
            let at = at.index(bytes.len());
            if cut { bytes.truncate(at) } else { bytes[at] = wrong }
            let (read, _) = read(Slow(Cursor::new(bytes)), Format::Candump);
            prop_assert!(read.len() <= records.len() + 1);
        }
    }
}

#[test]
fn the_ending_names_the_format() {
    for (name, format) in [
        ("frames.log", Format::Candump),
        ("frames", Format::Candump),
        ("asc", Format::Candump),
        ("frames.asc", Format::Asc),
        ("dir.log/FRAMES.ASC", Format::Asc),
        ("frames.pcapng", Format::Pcapng),
    ] {
        assert_eq!(Format::of(Path::new(name)), format, "{name}");
    }
}

#[test]
fn asc_as_others_write_it() {
    let (records, errors) = text(
        "date Tue Nov 14 10:13:20 pm 2023\r\nbase dec  timestamps relative\r\nno internal events logged\r\n\
         // version 8.5.0\r\n   0.000000 Start of measurement\r\n\
         \x20  0.001000 1  1440            Tx   d 2 67 255  Length = 0 BitCount = 0 ID = 1440\r\n\
         \x20  0.001000 CAN 1 Status:chip status error active\r\n\
         \x20  0.001000 2  416           TxRq d 1 00\r\n\
         \x20  0.000500 2  486539264x      Rx   r 8\r\n\
         \x20  0.000500 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\r\n\
         \x20  0.000001 1  ErrorFrame\tFlags = 0x2\r\n\
         \x20  1.000000 SV: 3 0 1 ::Model::Speed = 0\r\nEnd TriggerBlock\r\n",
    );
    assert_eq!(errors, [""; 0]);
    let begin = 1_700_000_000_000_000;
    let error = Record { at: Timestamp::from_micros(begin + 4001), entry: Entry::Error(ErrorFrame::UNTOLD) };
    assert_eq!(records, [frame(begin + 1000, "5A0: 43 FF"), frame(begin + 3500, "1D000000: R8"), error]);
}

/// A byte order mark, Windows line ends, blank lines and comments.
#[test]
fn texts_as_editors_write_them() {
    let candump = "\u{FEFF}# the valve boots\r\n\r\n(1.0) can0 720#00\r\n# and goes on\r\n(2.0) can0 720#7F\r\n";
    assert_eq!(text(candump), (vec![frame(1_000_000, "720: 00"), frame(2_000_000, "720: 7F")], vec![]));
    let asc = "\u{FEFF}date Thu Jan 1 00:00:01 1970\r\nbase hex  timestamps absolute\r\n 1.0 1 720 Rx d 1 00\r\n";
    assert_eq!(text(asc), (vec![frame(2_000_000, "720: 00")], vec![]));
    // Unwritten space, as after a power loss of the logger.
    let (_, errors) = text(&"\0".repeat(100));
    assert!(errors.len() == 1 && errors[0].starts_with("1: not a candump line: "), "{errors:?}");
}

/// In a candump line, the bus name must be a single word.
#[test]
fn the_bus_of_pcapng_has_a_name_of_one_word() {
    for (told, name) in [("", "can0"), ("a b", "a_b"), ("a\u{1B}\n", "a__"), ("vcan0", "vcan0")] {
        let start = Timestamp::from_micros(1);
        let mut writer = Writer::new(Vec::new(), Format::Pcapng, told, start).unwrap();
        writer.write(&frame(1, "720: 00")).unwrap();
        let mut reader = Reader::new(Cursor::new(writer.finish().unwrap()), Format::Pcapng).unwrap();
        assert!(reader.next().is_some_and(|entry| entry.is_ok()));
        assert_eq!(reader.bus(), name, "{told:?}");
    }
}

/// The pcap format, older than pcapng, is refused as a whole, in one line.
#[test]
fn pcap_is_refused() {
    for head in [0xA1B2_C3D4_u32, 0xA1B2_3C4D].into_iter().flat_map(|magic| [magic.to_le_bytes(), magic.to_be_bytes()])
    {
        let (records, errors) = read(Cursor::new([&head[..], &[2, 0, 4, 0]].concat()), Format::Pcapng);
        assert_eq!((records.len(), errors.len()), (0, 1), "{errors:?}");
        assert!(errors[0].contains("pcapng"), "{errors:?}");
    }
}

/// Files of other tools and arbitrary data are refused in one line each.
#[test]
fn what_is_no_recording_is_refused_as_a_whole() {
    let rubbish = b"\x7FELF\x02\x01\x01\n\n\xFF\xFE\n".repeat(50);
    for (begin, named) in [
        (&b"LOGG\x90\0\0\0\x05"[..], "BLF"),
        (b"MDF     4.10    ", "MDF"),
        (b"UnFinMF 4.10    ", "MDF"),
        (b"SQLite format 3\0", "SQLite"),
        (b";$FILEVERSION=1.1\n;$STARTTIME=43008.920986006946\n;\n", "TRC"),
        (b"\n;   Start time: 11.09.2002 16:03:19.4\n", "TRC"),
        (b"timestamp,arbitration_id,extended,remote,error,dlc,data\n", "CSV"),
        (&rubbish, "not a recording"),
        (b"\x89PNG\r\n\x1A\n", "not a recording"),
        (b"[package]\nname = 'x'\n\n", "not a recording"),
        (b"", "no frame"),
        (b"\n# a remark\n", "no frame"),
    ] {
        for ending in [Format::Candump, Format::Asc] {
            let rest = if named == "no frame" { vec![] } else { b"1,2 0.5 words\n".repeat(100) };
            let (records, errors) = read(Slow(Cursor::new([begin, &rest].concat())), ending);
            assert_eq!((records.len(), errors.len()), (0, 1), "{begin:?}: {errors:?}");
            // A converter does not help against an empty recording.
            let is_empty = named == "no frame";
            assert!(errors[0].contains(named) && errors[0].contains("can_logconvert") != is_empty, "{errors:?}");
        }
    }
    let (_, errors) = read(Cursor::new(b"\x1F\x8B\x08\0".to_vec()), Format::Candump);
    assert_eq!(errors, ["a gzip file; decompress it first"]);
    // Some unreadable lines before the first entry are reported individually.
    let (records, errors) = text("Script started\n$ candump -L can0\n(1.0) can0 080#\nhello\n");
    assert_eq!((records.len(), errors.len()), (1, 3), "{errors:?}");
}

/// The content takes precedence over the extension.
#[test]
fn a_log_of_candump_may_be_called_asc() {
    let log = Cursor::new(b"(1.0) can0 720#00\n(2.0) can0 720#7F\n".to_vec());
    let (records, errors) = read(log, Format::Asc);
    assert_eq!((records.len(), errors), (2, vec![]));
    // If the content is ambiguous, the extension decides.
    let (records, errors) = read(Cursor::new(b"0.5 1 720 Rx d 1 00\n".to_vec()), Format::Asc);
    assert_eq!((records, errors), (vec![frame(500_000, "720: 00")], vec![]));
}

/// A byte in base hex has two digits; at the end of a truncated file, its second digit may be missing.
#[test]
fn a_byte_of_asc_without_its_second_digit_is_reported() {
    let asc = "base hex  timestamps absolute\n 1.0 1 720 Rx d 2 00 7F";
    assert_eq!(text(asc), (vec![frame(1_000_000, "720: 00 7F")], vec![]));
    let (records, errors) = text(asc.trim_end_matches('F'));
    assert_eq!((records, errors), (vec![], vec!["2: invalid data byte: \"1.0 1 720 Rx d 2 00 7\"".to_owned()]));
    let (records, errors) = text("base dec  timestamps absolute\n 1.0 1 1824 Rx d 2 0 7\n");
    assert_eq!((records, errors), (vec![frame(1_000_000, "720: 00 07")], vec![]));
}

/// The times of a trigger block refer to the start of the measurement; a date starts a new measurement.
#[test]
fn asc_with_several_trigger_blocks() {
    let block = "Begin Triggerblock Thu Jan 1 00:01:00 1970";
    let later = "Begin Triggerblock Thu Jan 1 00:01:30 1970";
    let date = "date Thu Jan 1 00:02:00 1970";
    let (records, errors) = text(&format!(
        "date Thu Jan 1 00:00:59 1970\nbase hex  timestamps absolute\n{block}\n 1.0 1 720 Rx d 1 00\nEnd TriggerBlock\n\
         {later}\n 30.0 1 720 Rx d 1 7F\nEnd TriggerBlock\n{date}\n 1.0 1 720 Rx d 1 05\n"
    ));
    assert_eq!(errors, [""; 0]);
    let frames = [frame(61_000_000, "720: 00"), frame(90_000_000, "720: 7F"), frame(121_000_000, "720: 05")];
    assert_eq!(records, frames);
}

/// CAN FD controllers log classic CAN frames in a different line format.
#[test]
fn asc_of_a_controller_for_can_fd() {
    let (records, errors) = text(
        "base hex  timestamps absolute\n\
         1.0 CANFD   1 Rx  5A0  Answer  0 0 2  2 43 FF 102203 133 200000 0 0 0 0 0\n\
         2.0 CANFD   2 Tx  1D000000x    0 0 8  8 01 02 03 04 05 06 07 08 102203 133 0 0 0 0 0 0\n\
         3.0 CANFD   1 Rx  720          0 0 1  0 102203 133 10 0 0 0 0 0\n\
         4.0 CANFD   1 Rx  5A0          0 0 2  2 43 FF 102203 133 1000 0 0 0 0 0\n\
         5.0 CANFD   1 Rx  5A0          1 0 a 16 00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F 1 1 303000 0 0 0 0 0\n",
    );
    let data = "1D000000: 01 02 03 04 05 06 07 08";
    assert_eq!(records, [frame(1_000_000, "5A0: 43 FF"), frame(2_000_000, data), frame(3_000_000, "720: R1")]);
    assert!(errors.len() == 2 && errors.iter().all(|error| error.contains("CAN FD frames")), "{errors:?}");
}

/// The bus name is derived from the channel, as candump names buses.
#[test]
fn asc_has_several_channels() {
    let lines = b"base hex\n0.1 2 720 Rx d 1 00\n0.2 1 720 Rx d 1 00\n0.3 3 ErrorFrame\n".to_vec();
    let mut reader = Reader::new(Cursor::new(lines), Format::Candump).unwrap();
    let mut buses = Vec::new();
    while let Some(entry) = reader.next() {
        entry.unwrap();
        buses.push(reader.bus().to_owned());
    }
    assert_eq!(buses, ["can1", "can0", "can2"]);
}

#[test]
fn what_is_no_line_is_named_and_the_rest_is_read() {
    let (records, errors) = text("(1.000000) can0 080#\n\nhello\n(2.000000) can0 181#0\n(3.000000) can0 181#00\n");
    assert_eq!(records, [frame(1_000_000, "080:"), frame(3_000_000, "181: 00")]);
    assert_eq!(
        errors,
        ["3: not a candump line: \"hello\"", "4: data must be whole bytes in hex: \"(2.000000) can0 181#0\"",]
    );
    let (records, errors) = text("base hex\n0.1 1 1A0 Rx d 1 00\n0.1 1 1A0 Rx d 2 00\n0.1 1 1A0x\n0.2 CANFD 1 Rx\n?\n");
    assert_eq!(records, [frame(100_000, "1A0: 00")]);
    assert_eq!(errors.len(), 4, "{errors:?}");
    assert_eq!(errors[0], "3: fewer bytes than the stated length: \"0.1 1 1A0 Rx d 2 00\"");
}

/// A text of fewer than ten lines, such as a JUnit report, is refused in one line like a longer text.
#[test]
fn a_short_text_of_another_kind_is_refused_as_a_whole() {
    let (records, errors) = text("<testsuites>\n<testsuite>\n</testsuite>\n</testsuites>\n");
    assert_eq!((records.len(), errors.len()), (0, 1), "{errors:?}");
    assert!(errors[0].starts_with("not a recording in a known format; accepted: "), "{errors:?}");
    let (_, errors) = text("(1.000000) can0 181#0\n(2.000000) can0 181#1\n");
    assert_eq!(errors.len(), 2, "damaged lines of a log are named: {errors:?}");
}

#[test]
fn a_line_without_an_end_does_not_fill_the_memory() {
    let endless = std::io::repeat(b'#').take(1 << 26).chain(Cursor::new(b"\n(1.0) can0 080#\n".to_vec()));
    let (records, errors) = read(endless, Format::Candump);
    assert_eq!(records, [frame(1_000_000, "080:")]);
    assert!(errors.len() == 1 && errors[0].starts_with("1: line too long: \"###"), "{errors:?}");
}

/// The stdout of a run in a file: the ready line precedes the trace.
#[test]
fn the_output_of_a_run_is_read() {
    let ready = "pve-sim ready bus=socketcand://127.0.0.1:29536/pve0 http=http://127.0.0.1:8408/\n";
    let trace = "(1.0) pve0 720#00  pvea-canopen: boot-up\n";
    assert_eq!(text(&format!("{ready}{trace}")), (vec![frame(1_000_000, "720: 00")], vec![]));
    let (_, errors) = text(&format!("{trace}pve-sim readying\n"));
    assert_eq!(errors, ["2: not a candump line: \"pve-sim readying\""]);
}

/// Lines in candump's screen format without times have the time of the previous line.
#[test]
fn lines_without_a_time() {
    let (records, _) = text("  can0  080   [0]\n (5.5)  can0  181   [1]  00\n  can0  080   [0]\n");
    assert_eq!(records, [frame(0, "080:"), frame(5_500_000, "181: 00"), frame(5_500_000, "080:")]);
}

/// Big-endian order, nanoseconds, a clock offset, 16-byte padding, packets of another link type, which are reported once
/// and counted, and blocks without a packet.
#[test]
fn pcapng_as_others_write_it() {
    let block = |kind: u32, body: &[u8]| {
        let length = (12 + body.len() as u32).to_be_bytes();
        [&kind.to_be_bytes()[..], &length, body, &length].concat()
    };
    let numbers = |numbers: &[u32]| numbers.iter().flat_map(|number| number.to_be_bytes()).collect::<Vec<u8>>();
    let section = block(0x0A0D_0D0A, &numbers(&[0x1A2B_3C4D, 0x0001_0000, u32::MAX, u32::MAX]));
    let can = block(1, &numbers(&[227 << 16, 0, 0x0009_0001, 0x0900_0000, 0]));
    let ethernet = block(1, &numbers(&[1 << 16, 0]));
    let packet = |interface: u32, nanos: u64, data: &[u8]| {
        let head = numbers(&[interface, (nanos >> 32) as u32, nanos as u32, data.len() as u32, data.len() as u32]);
        block(6, &[&head, data].concat())
    };
    let statistics = block(5, &numbers(&[0, 0, 0]));
    let mut data = [0; 16];
    data[..10].copy_from_slice(&[0, 0, 0x05, 0xA0, 2, 0, 0, 0, 0x43, 0x18]);
    let nanos = 1_700_000_000_000_042_999;
    let foreign = [packet(1, nanos, &data), packet(1, nanos, &data)].concat();
    let unknown = packet(2, nanos, &data);
    let file = [section, can, ethernet, statistics, packet(0, nanos, &data), foreign, unknown].concat();
    let (records, errors) = read(Slow(Cursor::new(file)), Format::Candump);
    let link_type = "2: the link type is not SocketCAN (227); the packets of this interface are skipped";
    assert_eq!(errors, [link_type, "4: the packet refers to an unknown interface"]);
    assert_eq!(records, [frame(START, "5A0: 43 18")]);
    // In units of 2^-20 s.
    let binary = block(1, &numbers(&[227 << 16, 0, 0x0009_0001, 0x9400_0000, 0]));
    let section = block(0x0A0D_0D0A, &numbers(&[0x1A2B_3C4D, 0x0001_0000, u32::MAX, u32::MAX]));
    let (records, _) = read(Cursor::new([section, binary, packet(0, 5 << 19, &data)].concat()), Format::Candump);
    assert_eq!(records, [frame(2_500_000, "5A0: 43 18")]);
}

/// A writer that counts its writes.
#[derive(Clone, Default)]
struct Pieces(Rc<Cell<usize>>);

impl Write for Pieces {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.update(|count| count + 1);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// The end of a process, or a full disk, then cuts no entry.
#[test]
fn an_entry_is_written_in_one_piece() {
    let begin = Timestamp::from_micros(START);
    let error = Record { at: begin, entry: Entry::Error(ErrorClass::BusOff.into()) };
    for format in FORMATS {
        let pieces = Pieces::default();
        let mut writer = Writer::new(pieces.clone(), format, "pve0", begin).unwrap();
        for record in [frame(START, "720: 00"), frame(START, "18EEFF83: 01 00 20 07 08 FF 02 20"), error] {
            let before = pieces.0.get();
            writer.write(&record).unwrap();
            assert_eq!(pieces.0.get() - before, 1, "{format:?}: {record:?}");
            writer.comment(begin, "fault lose-220: 220 lost").unwrap();
            // The comments of pcapng are in the next packet, or at the end.
            let comments = usize::from(format == Format::Asc);
            assert_eq!(pieces.0.get() - before, 1 + comments, "{format:?}: a comment");
        }
        let before = pieces.0.get();
        writer.finish().unwrap();
        assert!(pieces.0.get() - before <= 1, "{format:?}: the end");
    }
}

/// Comments are written if the format supports them, and do not change any entry.
#[test]
fn comments_are_written_and_skipped() {
    let records = [frame(START, "720: 00"), frame(START + 1_500, "220: 0F 00 00 20")];
    let plain = FORMATS.map(|format| written(format, &records));
    let commented = FORMATS.map(|format| {
        let mut writer = Writer::new(Vec::new(), format, "pve0", Timestamp::from_micros(START)).unwrap();
        writer.write(&records[0]).unwrap();
        writer.comment(Timestamp::from_micros(START + 1_500), "fault lose-220: 220 lost").unwrap();
        writer.write(&records[1]).unwrap();
        writer.finish().unwrap()
    });
    for (place, bytes) in commented.iter().enumerate() {
        assert_eq!(read(Cursor::new(bytes.clone()), FORMATS[place]), (records.to_vec(), Vec::new()));
    }
    assert_eq!(commented[0], plain[0], "tools for candump's logs refuse comments");
    let asc = String::from_utf8(commented[1].clone()).unwrap();
    assert!(asc.lines().any(|line| line == "// 0.001542 fault lose-220: 220 lost"), "{asc}");
    // The option opt_comment with its length, in the second packet.
    let option: Vec<u8> = [&[1, 0, 24, 0], "fault lose-220: 220 lost".as_bytes()].concat();
    let comments = |bytes: &[u8]| bytes.windows(option.len()).filter(|bytes| *bytes == option).count();
    assert_eq!(comments(&commented[2]), 1);
    assert!(commented[2].ends_with(&[0, 0, 0, 0, 76, 0, 0, 0]), "{:?}", &commented[2][commented[2].len() - 16..]);

    // A comment after the last frame.
    let last = FORMATS.map(|format| {
        let mut writer = Writer::new(Vec::new(), format, "pve0", Timestamp::from_micros(START)).unwrap();
        writer.write(&records[0]).unwrap();
        writer.comment(Timestamp::from_micros(START + 1_500), "fault lose-220: 220 lost").unwrap();
        writer.finish().unwrap()
    });
    assert_eq!(comments(&last[2]), 1);
    for (place, bytes) in last.iter().enumerate() {
        assert_eq!(read(Cursor::new(bytes.clone()), FORMATS[place]), (records[..1].to_vec(), Vec::new()));
    }
}
