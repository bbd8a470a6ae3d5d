//! Recorded sessions in virtual time, replayed unchanged and with changes.

mod changes;
mod logs;
mod mutations;
mod positions;

use std::fs;
use std::io::Write as _;
use std::sync::Arc;

use protocol_core::frame::{extended, standard};
use protocol_core::time::{after, since};
use protocol_core::wire::nmt::State;
use tempfile::NamedTempFile;

use super::*;
use crate::Memory;
use crate::devices::{self, DeviceSpec, NamedLink};
use crate::log::{ErrorClass, Record, Timestamp};
use crate::recording::{Format, Writer};
use crate::world::{ClientPortId, EventKind, NodeId, SUPPLY_JITTER, World};

const START: Timestamp = Timestamp::from_micros(1_700_000_000_000_042);

/// The interval at which a session records the positions.
const SAMPLE: Duration = Duration::from_micros(500);

/// Parses the options of `pve-sim replay` from a command line.
fn options(line: &str, file: &NamedTempFile) -> ReplayOptions {
    let (mut devices, mut links) = (Vec::new(), Vec::new());
    let (mut tolerance_ms, mut from_boot_up, mut seed) = (5, false, 1);
    let mut words = line.split_whitespace();
    while let Some(option) = words.next() {
        let mut value = || words.next().expect("a value");
        match option {
            "--device" => devices.push(value().parse::<DeviceSpec>().expect("a device")),
            "--link" => links.push(value().parse::<NamedLink>().expect("a link")),
            "--tolerance-ms" => tolerance_ms = value().parse().expect("a number"),
            "--from-boot-up" => from_boot_up = true,
            "--seed" => seed = value().parse().expect("a number"),
            _ => panic!("{option}"),
        }
    }
    let mut devices = devices::named(devices).expect("names");
    devices::share_bit_rate(&mut devices, None);
    devices::refuse_bad_links(&devices, &links).expect("links");
    let tolerance = Duration::from_millis(tolerance_ms);
    ReplayOptions { file: file.path().to_owned(), devices, links, tolerance, from_boot_up, seed }
}

/// Devices and a master, recorded from power-up.
struct Session {
    world: World,
    master: ClientPortId,
    records: Vec<Record>,
    /// The sender of each record.
    senders: Vec<Arc<str>>,
    looks: Vec<Look>,
}

/// What a device has shown at an instant.
#[derive(Clone, Copy)]
struct Look {
    /// The time in the log.
    at: Timestamp,
    node: NodeId,
    position: i32,
    floats: bool,
    /// The NMT state, as in a heartbeat, or the state of an AVEF.
    state: u8,
}

impl Session {
    /// Powers on the devices of a command line, as `run` does.
    fn new(line: &str) -> Self {
        let options = options(line, &NamedTempFile::new().unwrap());
        let first = &options.devices[0];
        let rate = first.setup.bit_rate.unwrap_or(first.setup.kind.bit_rates()[0]);
        let mut world = World::new(rate, options.seed);
        world.record_events(true);
        let master = world.add_gateway("master");
        for device in &options.devices {
            device.add_to(&mut world, Memory::in_ram());
        }
        for NamedLink { valve, sensor, link } in &options.links {
            let (valve, sensor) = (world.find(valve).unwrap(), world.find(sensor).unwrap());
            world.link(valve, sensor, *link).unwrap();
        }
        let first = world.devices().next().unwrap();
        world.power(first, true);
        world.power_all(SUPPLY_JITTER);
        let mut session = Self { world, master, records: Vec::new(), senders: Vec::new(), looks: Vec::new() };
        session.wait(20_000);
        session
    }

    fn wait(&mut self, micros: u64) {
        let end = after(self.world.now(), Duration::from_micros(micros));
        while self.world.now() < end {
            self.world.run_until(after(self.world.now(), SAMPLE).min(end));
            for node in self.world.devices() {
                let Some(view) = self.world.view(node) else { continue };
                let command = view.valve.and_then(|valve| valve.command).map(|state| state as u8);
                self.looks.push(Look {
                    at: START.at(self.world.now()),
                    node,
                    position: view.position.into(),
                    floats: self.world.floats(node),
                    state: view.nmt.map(State::code).or(command).unwrap_or_default(),
                });
            }
        }
        for event in self.world.take_events() {
            if let EventKind::Frame { frame, .. } = event.what {
                self.records.push(Record { at: START.at(event.at), entry: Entry::Frame(frame) });
                self.senders.push(event.who);
            }
        }
    }

    /// Sends frames at intervals of `ms` milliseconds, with some jitter.
    fn send(&mut self, ms: u64, frames: &[&str]) -> &mut Self {
        for (number, text) in frames.iter().enumerate() {
            self.world.send(self.master, frame(text));
            self.wait(ms * 1000 + number as u64 % 7 * 13);
        }
        self
    }

    fn log(&self) -> NamedTempFile {
        log(&self.records, Format::Candump)
    }
}

fn frame(text: &str) -> Frame {
    text.parse().unwrap()
}

fn log(records: &[Record], format: Format) -> NamedTempFile {
    let file = NamedTempFile::new().unwrap();
    let mut writer = Writer::new(file.reopen().unwrap(), format, "pve0", START).unwrap();
    records.iter().for_each(|record| writer.write(record).unwrap());
    writer.finish().unwrap();
    file
}

fn replayed(line: &str, file: &NamedTempFile) -> Outcome {
    replay(&options(line, file)).unwrap()
}

/// Asserts that a log replays without a difference. Returns the number of compared frames.
fn as_logged(line: &str, file: &NamedTempFile) -> u64 {
    let options = options(line, file);
    let outcome = replay(&options).unwrap();
    assert!(outcome.is_as_logged(), "{}", outcome.report(&options));
    outcome.compared
}

const VALVE: &str = "--device pvea-canopen@0x20";

/// Returns a session with a valve at rest: SDO, NMT, heartbeats every 100 ms, and an EMCY for a missing master.
fn at_rest() -> Session {
    let mut session = Session::new(VALVE);
    session.send(3, &["620: 40 18 10 01 00 00 00 00", "620: 2B 17 10 00 64 00 00 00", "000: 01 20"]);
    session.send(40, &["220: 03 00 00 00", "220: 0B 00 00 00", "220: 0F 00 00 00", "220: 0F 00 00 00"]);
    session.send(600, &["620: 40 00 20 00 00 00 00 00", "620: 40 03 10 01 00 00 00 00", "000: 81 20"]);
    session.send(20, &["080:"; 2]);
    session
}

/// Returns a session with a valve whose spool moves most of the time.
fn moving() -> Session {
    let mut session = Session::new(VALVE);
    session.send(10, &["000: 01 20", "220: 03 00 00 00", "220: 0B 00 00 00"]);
    session.send(6, &["220: 0F 00 00 20"; 40]);
    session.send(6, &["220: 0F 00 00 C0", "620: 40 01 63 01 00 00 00 00"].repeat(40));
    session
}

#[test]
fn a_session_replays_in_every_format() {
    let session = moving();
    for format in [Format::Candump, Format::Asc, Format::Pcapng] {
        assert!(as_logged(VALVE, &log(&session.records, format)) > 120);
    }
    assert!(as_logged("--device pvea-canopen@0x20 --tolerance-ms 0", &at_rest().log()) > 20);
}

/// Returns whether a frame was sent by node 0x20.
fn is_of_valve(record: &Record) -> bool {
    let Entry::Frame(frame) = record.entry else { return false };
    ["0A0:", "1A0:", "5A0:", "720:"].iter().any(|id| frame.to_string().starts_with(id))
}

/// The simulated device may send frames after the end of the log.
#[test]
fn a_log_may_be_cut_off() {
    let records = at_rest().records;
    for end in 1..records.len() {
        as_logged(VALVE, &log(&records[..end], Format::Candump));
    }
}

#[test]
fn a_report_names_frame_time_and_meaning() {
    let mut records = at_rest().records;
    let answer = |record: &Record| record.entry == Entry::Frame(frame("5A0: 43 18 10 01 19 00 00 01"));
    let place = records.iter().position(answer).unwrap();
    records[place].entry = Entry::Frame(frame("5A0: 43 18 10 01 1A 00 00 01"));
    let file = log(&records, Format::Candump);
    let options = options(VALVE, &file);
    let outcome = replay(&options).unwrap();
    let report = outcome.report(&options);
    let lines: Vec<&str> = report.lines().collect();
    let at = records[place].at;
    assert_eq!(lines[0], format!("({at}) line {}: different data", place + 1));
    assert_eq!(
        lines[1],
        "  log       5A0: 43 18 10 01 1A 00 00 01         pvea-canopen: SDO read response 0x1018:1 (Vendor ID) = 0x0100001A"
    );
    assert!(lines[2].starts_with("  simulated 5A0: 43 18 10 01 19 00 00 01  "), "{report}");
    assert!(
        lines[3].ends_with(
            "compared within 5 ms: 1 difference; 12 frames of other nodes sent; \
             power-up not compared: pvea-canopen aligned with line 1"
        ),
        "{report}"
    );
}

/// All valves answer a write of the node ID under the same identifier, whose source bits are those of address 0x81. The
/// request names the valve.
#[test]
fn the_answer_to_a_node_id_write_belongs_to_the_requested_valve() {
    for (devices, first, second) in [
        (
            ["pvea-isobus@0x81,serial=7", "pveo-isobus@0x83,serial=8"],
            "1BC78881: 04 2E 10 01 85",
            "1BC78883: 04 2E 10 01 86",
        ),
        (["pvea-canopen@0x20", "pveo-canopen@0x21"], "1BC78820: 04 2E 10 01 25", "1BC78821: 04 2E 10 01 26"),
    ] {
        let mut session = Session::new(&format!("--device {} --device {}", devices[0], devices[1]));
        session.wait(400_000);
        for requests in [&[second][..], &[first], &[second, first]] {
            session.send(60, requests);
        }
        let answers = session
            .records
            .iter()
            .filter(|record| matches!(record.entry, Entry::Frame(answer) if answer == frame("1BC408F1: 03 6E 10 01")));
        assert_eq!(answers.count(), 4);
        let file = session.log();
        for device in devices {
            as_logged(&format!("--device {device}"), &file);
        }
        as_logged(&format!("--device {} --device {}", devices[0], devices[1]), &file);
    }
}

/// LSS assigns another node ID to the valve. Soon or later, another device boots under the first node ID.
#[test]
fn a_node_id_may_be_taken_over() {
    for wait_ms in [100, 700, 2000] {
        let mut session = Session::new(VALVE);
        session.send(20, &["620: 40 18 10 04 00 00 00 00", "7E5: 04 01 00 00 00 00 00 00"]);
        session.send(20, &["7E5: 11 21 00 00 00 00 00 00", "7E5: 17 00 00 00 00 00 00 00"]);
        session.send(wait_ms, &["7E5: 04 00 00 00 00 00 00 00", "000: 01 00", "621: 40 18 10 04 00 00 00 00"]);
        let mut records = session.records;
        let place = records.iter().position(|record| record.entry == Entry::Frame(frame("000: 01 00"))).unwrap();
        let at = records[place].at.at(Instant::from_millis(1));
        let other = ["720: 00", "0A0: 00 00 00 00 00 00 00 00", "5A0: 43 18 10 04 07 00 00 00"];
        let other = other.map(|text| Record { at, entry: Entry::Frame(frame(text)) });
        records.splice(place + 1..place + 1, other);
        records.sort_by_key(|record| record.at);
        assert_eq!(as_logged(VALVE, &log(&records, Format::Candump)), 8);
    }
}

/// The simulated devices have one TPDO: another TPDO in the log is a difference. The same PDOs of other nodes are sent.
#[test]
fn further_tpdos_are_told() {
    for (extra, differences) in [("2A0: DE AD BE EF", 1), ("3A0: 00", 1), ("4A0:", 1), ("2A1: 00", 0), ("320: 00", 0)] {
        let mut records = at_rest().records;
        let at = Timestamp::from_micros(records[20].at.as_micros() + 300);
        records.insert(21, Record { at, entry: Entry::Frame(frame(extra)) });
        let outcome = replayed(VALVE, &log(&records, Format::Candump));
        assert_eq!(outcome.differences, differences, "{extra}");
        assert!(outcome.told.iter().all(|told| (told.what, told.number) == (What::Missing, Some(22))), "{extra}");
    }
}

#[test]
fn a_valve_on_isobus_and_its_master() {
    let device = "--device pvea-isobus@0x83";
    let mut session = Session::new(device);
    session.send(300, &["18EEFF27: 02 00 20 00 00 82 00 A0"]);
    session.send(90, &["0CFE3327: 7D FF 31 FF FF FF FF FF"; 8]);
    session.send(90, &["0CFE3327: FA FF 32 FF FF FF FF FF"; 8]);
    session.send(400, &["18EAFF27: 00 EE 00", "18EA8327: CB FE 00", "18EA8327: EB FE 00"]);
    assert!(as_logged(device, &session.log()) > 20);
}

/// Another node claims the valve's address: first without success, then successfully.
#[test]
fn a_contender_is_no_stand_in() {
    let device = "--device pvea-isobus@0x83";
    let mut session = Session::new(device);
    session.send(300, &["18EEFF83: 02 00 20 00 00 82 00 A0"]);
    session.send(700, &["18EEFF83: 02 00 20 00 00 82 00 10", "18EAFF27: 00 EE 00"]);
    let sent = |text: &str| session.records.iter().filter(|record| record.entry == Entry::Frame(frame(text))).count();
    assert!(sent("18EEFF83: 01 00 20 07 08 FF 02 20") >= 2, "it defends its address");
    assert!(sent("18EEFFFE: 01 00 20 07 08 FF 02 20") >= 1, "it loses its address");
    assert!(as_logged(device, &session.log()) >= 5);
}

/// A valve of the same product contends for the address, before the claim of the simulated device and later; the
/// simulated device has the logged NAME.
#[test]
fn a_twin_is_no_stand_in() {
    let device = "--device pvea-isobus@0x83,serial=7";
    for twin in ["18EEFF83: 09 00 20 07 08 FF 02 20", "18EEFF83: 01 00 20 07 08 FF 02 20"] {
        let mut session = Session::new(device);
        session.send(400, &["0CFE3327: 7D FF 31 FF FF FF FF FF", twin, "18EAFF27: 00 EE 00"]);
        assert!(as_logged(device, &session.log()) > 3, "{twin}");
        // The other valve was on the bus first, and lost.
        let mut records = session.records.clone();
        let earlier = Timestamp::from_micros(records[0].at.as_micros() - 900);
        records.insert(0, Record { at: earlier, entry: Entry::Frame(frame("18EEFF83: 0A 00 20 07 08 FF 02 20")) });
        assert!(as_logged(device, &log(&records, Format::Candump)) > 3, "{twin}");
    }
}

/// In a log of a valve with a different serial number, the claims of this valve are compared. The claims of another
/// valve of the same product are sent.
#[test]
fn the_first_claim_tells_the_name() {
    let mut session = Session::new("--device pvea-isobus@0x83,serial=7");
    session.send(400, &["18EEFF83: 09 00 20 07 08 FF 02 20", "18EAFF27: 00 EE 00"]);
    let file = session.log();
    let other = options("--device pvea-isobus@0x83", &file);
    let outcome = replay(&other).unwrap();
    let claims = session.records.iter().filter(
        |record| matches!(record.entry, Entry::Frame(claim) if claim == frame("18EEFF83: 07 00 20 07 08 FF 02 20")),
    );
    let claims = claims.count() as u64;
    assert!(claims > 2 && outcome.differences == claims, "{claims} {}", outcome.report(&other));
    assert!(outcome.told.iter().all(|difference| difference.what == What::Different));
}

/// A sensor moved by a valve, with PDOs on SYNC. Each device is also replayed alone; the client then sends the logged
/// frames of the other device.
#[test]
fn several_devices() {
    let both = "--device pvea-canopen@0x20 --device hat1000@1,bit-rate=250k --link pvea-canopen=hat1000";
    let mut session = Session::new(both);
    session.send(5, &["601: 2F 00 18 02 01 00 00 00", "601: 23 00 18 01 81 01 00 00"]);
    session.send(5, &["000: 01 00", "220: 03 00 00 00", "220: 0B 00 00 00"]);
    session.send(7, &["220: 0F 00 00 20", "080:", "601: 40 04 60 00 00 00 00 00"].repeat(30));
    let angles: BTreeSet<u32> = session
        .records
        .iter()
        .filter_map(|record| match record.entry {
            Entry::Frame(frame) if frame.to_string().starts_with("181:") => Some(u32::from(frame.data()[0])),
            _ => None,
        })
        .collect();
    assert!(angles.len() > 5, "the shaft turns: {angles:?}");
    let file = session.log();
    let all = as_logged(both, &file);
    let valve = as_logged(VALVE, &file);
    assert!(valve > 30 && all > valve + 60, "{all} {valve}");
}

/// With the seed of the recorded run, the random values are the same.
#[test]
fn random_values_depend_on_the_seed() {
    let valve = "--device pvea-canopen@0x20,noise=300,answer-ms=20..80";
    let both = "--device pvea-canopen@0x20,answer-ms=20..80 --device hat1000@1,bit-rate=250k,noise=50,answer-ms=5..90 \
                --link pvea-canopen=hat1000,noise=50";
    for devices in [valve, both] {
        let line = format!("{devices} --seed 3");
        let mut session = Session::new(&line);
        session.send(10, &["000: 01 00", "220: 03 00 00 00", "220: 0B 00 00 00"]);
        session
            .send(60, &["220: 0F 00 00 20", "620: 40 01 63 01 00 00 00 00", "601: 40 04 60 00 00 00 00 00"].repeat(9));
        let file = session.log();
        assert!(as_logged(&line, &file) > 20);
        assert!(replayed(devices, &file).differences > 0, "{devices}");
    }
}

/// LSS assigns a node ID to a blank valve, and its TPDO receives another COB-ID: identifiers unknown before the log.
#[test]
fn identifiers_that_change() {
    let blank = "--device pvea-canopen,blank";
    let mut session = Session::new(blank);
    session.send(20, &["7E5: 04 01 00 00 00 00 00 00", "7E5: 11 31 00 00 00 00 00 00", "7E5: 17 00 00 00 00 00 00 00"]);
    session.send(200, &["7E5: 04 00 00 00 00 00 00 00"]);
    session.send(20, &["631: 23 00 18 01 B1 01 00 80", "631: 23 00 18 01 C2 01 00 00", "000: 01 31"]);
    session.send(20, &["231: 03 00 00 00", "231: 0B 00 00 00"]);
    let sent = |id: &str| {
        let is = |record: &&Record| matches!(record.entry, Entry::Frame(frame) if frame.to_string().starts_with(id));
        session.records.iter().filter(is).count()
    };
    assert!(sent("731:") > 0 && sent("1C2:") > 0);
    let own: usize = ["7E4:", "731:", "0B1:", "5B1:", "1C2:"].into_iter().map(sent).sum();
    let file = session.log();
    assert_eq!(as_logged(blank, &file), own as u64);
    // A single round sends the TPDO frames to the simulated device instead of comparing them.
    let options = options(blank, &file);
    let error = play_rounds(&options, &Timeline::find(&options).unwrap(), 1).unwrap_err().to_string();
    assert!(error.ends_with("after 4 rounds: 1C2"), "{error}");
}
