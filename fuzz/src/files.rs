//! Foreign files: recordings and state files.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use hal_sim::decode::{DecodeOptions, decode};
use hal_sim::devices;
use hal_sim::log::{Entry, ErrorFrame, Record};
use hal_sim::memory::SIZE;
use hal_sim::recording::{Format, Logged, ReadError, Reader, Writer};
use hal_sim::replay::{self, ReplayOptions};
use hal_sim::{BitRate, Duration, Kind, World};
use pve_sim::state_file::{Opened, StateFile};

use crate::room::{self, assert_one_line};

/// The longest recording that is replayed, in microseconds.
const LONGEST: u64 = 10_000_000;

/// The latest time, in microseconds. ASC has no dates after the year 9999.
const LAST: u64 = 250_000_000_000_000_000;

/// Reads a file of any bytes as a recording or as the memory of a device. The first byte selects the format: `c`, `a`
/// and `p` are recordings of candump, ASC and pcapng, `m` is a state file.
pub fn files(bytes: &[u8]) {
    let Some((kind, content)) = bytes.split_first() else { return };
    match kind {
        b'm' => state_file(content),
        b'a' => recording("recording.asc", content),
        b'p' => recording("recording.pcapng", content),
        _ => recording("recording.log", content),
    }
}

/// Reads a recording entry by entry, explains each entry in a line, writes and reads it again, and replays it.
fn recording(name: &str, content: &[u8]) {
    let file = room::file(name, content);
    let (mut records, mut refused, mut refusal, mut last) = (Vec::new(), Vec::new(), None, 0);
    for entry in Reader::open(&file).into_iter().flatten() {
        assert!(refusal.is_none(), "it is read on after {refusal:?}");
        let number = match &entry {
            Ok(Logged { number, .. }) | Err(ReadError::NoEntry { number, .. }) => Some(*number),
            Err(ReadError::Io(_)) => None,
        };
        assert!(number.is_none_or(|number| number > last), "the number goes back to {number:?}");
        last = number.unwrap_or(last);
        match entry {
            Ok(logged) => records.push(logged.record),
            Err(error @ ReadError::NoEntry { .. }) => refused.push(error.to_string()),
            Err(ReadError::Io(error)) => refusal = Some(error.to_string()),
        }
    }
    assert!(records.len() <= content.len() / 4, "more entries than the file has room for");
    refused.iter().chain(&refusal).for_each(|line| assert_one_line(line));
    explain(&file, &records, &refused, refusal.is_some());
    for format in [Format::Candump, Format::Asc, Format::Pcapng] {
        write(&records, format);
    }
    play(&file, &records, &refused);
}

/// Asserts that every entry becomes a line that parses to the entry, and that invalid lines become warnings.
fn explain(file: &Path, records: &[Record], refused: &[String], is_cut: bool) {
    let options = DecodeOptions { file: file.to_owned(), devices: Vec::new() };
    let (mut out, mut warnings) = (Vec::new(), Vec::new());
    let told = decode(&options, &mut out, |line| warnings.push(line.to_owned()));
    if !is_cut && let Ok(all_read) = told {
        assert_eq!(all_read, refused.is_empty());
    } else if let Err(error) = &told {
        assert_one_line(&error.to_string());
    }
    let place = format!("{}:", file.display());
    let warnings: Vec<&str> = warnings.iter().filter_map(|line| line.strip_prefix(&place)).collect();
    assert_eq!(warnings, refused);
    let out = String::from_utf8(out).expect("text");
    assert_eq!(out.lines().count(), records.len(), "{out}");
    for (line, record) in out.lines().zip(records) {
        let read = Reader::new(Cursor::new(line.to_owned()), Format::Candump).expect("a line");
        let read: Vec<_> =
            read.map(|entry| entry.map(|logged| logged.record).map_err(|error| error.to_string())).collect();
        assert_eq!(read, [Ok(*record)], "{line}");
    }
}

/// Asserts that written records read back the same, as far as the format keeps them.
fn write(records: &[Record], format: Format) {
    let start = records.iter().map(|record| record.at).min().unwrap_or_default();
    if records.is_empty() || records.iter().any(|record| record.at.as_micros() > LAST) {
        return;
    }
    let mut writer = Writer::new(Vec::new(), format, "pve0", start).expect("room");
    records.iter().for_each(|record| writer.write(record).expect("room"));
    let written = writer.finish().expect("room");
    let reader = Reader::new(Cursor::new(written), format).expect("a recording");
    let read: Vec<Record> = reader.map(|entry| entry.expect("an entry").record).collect();
    let is_asc = format == Format::Asc;
    let told = |record: &Record| match record.entry {
        Entry::Error(_) if is_asc => Record { entry: Entry::Error(ErrorFrame::UNTOLD), ..*record },
        _ => *record,
    };
    assert_eq!(read, records.iter().map(told).collect::<Vec<_>>(), "{format:?}");
}

/// Asserts that a replay accounts for every entry, and that two replays are the same.
fn play(file: &Path, records: &[Record], refused: &[String]) {
    let times = || records.iter().map(|record| record.at.as_micros());
    let span = times().max().unwrap_or(0) - times().min().unwrap_or(0);
    if span > LONGEST {
        return;
    }
    let specs = ["pvea-canopen@0x20", "hat1000@1,bit-rate=250k", "pvea-isobus@0x80"];
    let is_of = |spec: &str, id: u32| spec.contains("isobus") == (id > 0x7FF);
    let first = records.iter().find_map(|record| match record.entry {
        Entry::Frame(frame) => Some(frame.key()),
        Entry::Error(_) => None,
    });
    let spec = specs.into_iter().find(|spec| is_of(spec, first.unwrap_or(0))).unwrap_or(specs[0]);
    let devices = devices::named(vec![spec.parse().expect("a device")]).expect("a device");
    for from_boot_up in [false, true] {
        let (file, tolerance) = (file.to_owned(), Duration::from_millis(5));
        let options =
            ReplayOptions { file, devices: devices.clone(), links: Vec::new(), tolerance, from_boot_up, seed: 1 };
        match replay::replay(&options) {
            Err(error) => assert_one_line(&error.to_string()),
            Ok(outcome) => {
                let entries = outcome.compared + outcome.played + outcome.error_frames + outcome.skipped;
                assert_eq!(entries, records.len() as u64);
                assert!(from_boot_up || outcome.skipped == 0, "{} skipped", outcome.skipped);
                assert!(outcome.unread.len() >= refused.len(), "{:?} {refused:?}", outcome.unread);
                outcome.unread.iter().for_each(|line| assert_one_line(line));
                assert_eq!(outcome.is_as_logged(), outcome.told.is_empty() && outcome.unread.is_empty());
                assert!(outcome.told.is_sorted_by_key(|difference| difference.at));
                assert!(!outcome.report(&options).is_empty());
                assert_eq!(replay::replay(&options).expect("as before"), outcome);
            }
        }
    }
}

/// Asserts that a state file of another kind is unchanged, and that a damaged one is kept aside. The remaining file
/// reads the same again, and the device starts with it.
fn state_file(content: &[u8]) {
    let (number, content) = content.split_first().map_or((0, content), |(number, rest)| (*number, rest));
    let kind = Kind::ALL[usize::from(number) % Kind::ALL.len()];
    // The bytes are a header and the beginning of a flash, whose rest is erased. The highest bit leaves the flash out.
    let mut content = content.to_vec();
    if number & 0x80 == 0 && content.len() >= HEADER {
        content.resize(HEADER + SIZE, 0xFF);
    }
    let folder = room::path("state");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir(&folder).expect("a folder");
    let file = folder.join("device.nvm");
    fs::write(&file, &content).expect("room");
    let mut memory = match StateFile::open(&folder, "device", kind.number().into()).and_then(Opened::memory) {
        Ok(memory) => memory,
        Err(error) => {
            assert_one_line(&error.to_string());
            assert_eq!(fs::read(&file).expect("the file"), content, "a file that was refused has changed");
            assert!(!folder.join("device.nvm.bad").exists());
            return;
        }
    };
    let warnings = memory.take_warnings();
    warnings.iter().for_each(|warning| assert_one_line(warning));
    let aside = fs::read(folder.join("device.nvm.bad")).ok();
    assert_eq!(aside, (!warnings.is_empty()).then_some(content), "what was damaged is kept, and nothing else");
    let image = memory.peek_image();
    drop(memory);
    let again = StateFile::open(&folder, "device", kind.number().into()).and_then(Opened::memory);
    let mut again = again.expect("what was written is read");
    assert_eq!(again.take_warnings(), [] as [String; 0]);
    if warnings.is_empty() {
        assert_eq!(again.peek_image(), image, "two starts differ");
    }
    let mut world = World::new(BitRate::Kbit250, 1);
    let device = world.add_with("device", kind, again);
    world.power(device, true);
    world.run_for(Duration::from_millis(200));
    assert!(world.is_powered(device));
}

/// The number of bytes before the flash in a state file.
const HEADER: usize = 16;
