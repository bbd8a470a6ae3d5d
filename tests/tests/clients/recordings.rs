//! Logs as other tools read them, and logs of sessions with unmodified clients as `pve-sim` replays them.

use std::fs::File;
use std::path::Path;
use std::process::Command;

use hal_sim::log::{Entry, ErrorClass, ErrorFrame, Record, Timestamp};
use hal_sim::recording::{Format, Writer};
use protocol_core::frame::{Frame, Id};

use super::programs::output;
use super::simulator::{PVE_SIM, Start, python, root};

/// Microseconds since 1970: no whole millisecond.
const START: u64 = 1_700_000_000_123_456;

/// The class of a destroyed frame.
const BUS_ERROR: u32 = 0x80;

/// Both kinds of identifiers at their ends, remote frames, no data and all data; and error frames.
fn records() -> Vec<Record> {
    let frames = ["080:", "000: 01 20", "7FF: 00 11 22 33 44 55 66 77", "5A0: R0", "5A0: R8", "00000000: FF"];
    let extended = ["1FFFFFFF: R1", "18EEFF83: 01 00 20 07 08 FF 02 20", "00000080:"];
    let frames = frames.into_iter().chain(extended).map(|text| Entry::Frame(text.parse().expect(text)));
    let errors = [ErrorClass::BusError, ErrorClass::ErrorPassive, ErrorClass::BusOff, ErrorClass::Restarted];
    let entries = frames.chain(errors.map(|class| Entry::Error(class.into())));
    let at = |number: u64| Timestamp::from_micros(START + number * 1_000_001);
    (0..).zip(entries).map(|(number, entry)| Record { at: at(number), entry }).collect()
}

/// Writes them in the format of a name.
fn write(path: &Path) {
    let file = File::create(path).expect("a file");
    let mut writer = Writer::new(file, Format::of(path), "pve0", Timestamp::from_micros(START)).expect("room");
    records().iter().for_each(|record| writer.write(record).expect("room"));
    writer.finish().expect("room");
}

fn id(frame: &Frame) -> (u32, bool) {
    match frame.id() {
        Id::Standard(id) => (id.as_raw().into(), false),
        Id::Extended(id) => (id.as_raw(), true),
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn python_can_reads_a_log() {
    let dir = tempfile::tempdir().expect("a folder");
    let expected = |is_asc: bool| -> Vec<String> {
        let records = records();
        let lines = records.iter().map(|Record { at, entry }| match entry {
            // Of a log of candump, it takes other classes for identifiers.
            Entry::Error(ErrorFrame { class, data }) if !is_asc && *class != BUS_ERROR => {
                format!("{at} {class:08X} data 8 {}", hex(data))
            }
            Entry::Error(_) => format!("{at} error"),
            Entry::Frame(frame) => {
                let (id, extended) = id(frame);
                let kind = if frame.is_remote() { "remote" } else { "data" };
                let digits = if extended { 8 } else { 3 };
                let line = format!("{at} {id:0digits$X} {kind} {} {}", frame.len(), hex(frame.data()));
                line.trim_end().to_owned()
            }
        });
        lines.collect()
    };
    for name in ["frames.log", "frames.asc"] {
        let path = dir.path().join(name);
        write(&path);
        // The dates of ASC have no time zone, and are in UTC.
        let script = root().join("tests/clients/log.py");
        let run = output(Command::new(python()).arg(script).arg(&path).env("TZ", "UTC"));
        assert!(run.status.success(), "{name}: {}", String::from_utf8_lossy(&run.stderr));
        let read = String::from_utf8(run.stdout).expect("text");
        assert_eq!(read.lines().collect::<Vec<_>>(), expected(name == "frames.asc"), "{name}");
    }
}

#[test]
fn tshark_reads_a_capture() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("frames.pcapng");
    write(&path);
    let fields =
        ["frame.time_epoch", "can.id", "can.flags.xtd", "can.flags.rtr", "can.flags.err", "can.len", "data.data"];
    let rest = ["can.err.buserror", "_ws.malformed", "frame.interface_name"];
    let mut tshark = Command::new("tshark");
    // It would take some of the frames for messages of AUTOSAR.
    tshark.arg("-r").arg(&path).args(["--disable-protocol", "autosar-nm"]).args([
        "-T",
        "fields",
        "-E",
        "separator=,",
        "-E",
        "occurrence=f",
    ]);
    tshark.args(fields.iter().chain(&rest).flat_map(|field| ["-e", field]));
    let run = output(&mut tshark);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let read = String::from_utf8(run.stdout).expect("text");
    let expected = records().into_iter().map(|Record { at, entry }| match entry {
        // The class, in the place of the identifier.
        Entry::Error(error) => format!("{at}000,,,,1,8,,{},,pve0", u8::from(error.class == BUS_ERROR)),
        Entry::Frame(frame) => {
            let (id, extended) = id(&frame);
            let (extended, remote) = (u8::from(extended), u8::from(frame.is_remote()));
            format!("{at}000,{id},{extended},{remote},0,{},{},,,pve0", frame.len(), hex(frame.data()))
        }
    });
    assert_eq!(read.lines().collect::<Vec<_>>(), expected.collect::<Vec<_>>());
}

/// Serves a script with a simulator that writes a log of this name, and replays that against the same devices. What
/// clients send comes whenever it comes.
pub(crate) fn serve_and_replay(start: Start, log: &str, script: &str, arguments: &[&str], devices: &[&str]) {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join(log);
    let path = path.to_str().expect("text");
    let simulator = start(&[&["--log", path][..], devices].concat());
    simulator.serve(script, arguments);
    simulator.terminate();
    let run = output(Command::new(&*PVE_SIM).args(["replay", path]).args(devices));
    let report = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{script}: {report}{}", String::from_utf8_lossy(&run.stderr));
    let compared = report.split(' ').next().and_then(|count| count.parse::<u32>().ok());
    // The fewest are those of a valve that loses its address: four claims, and an AVEF.
    assert!(compared.is_some_and(|count| count >= 5), "{report}");
}
