//! The tolerance of positions, for a moving spool.

use super::*;

/// The log of a real valve has a different time origin, and its logger is late.
#[test]
fn loggers_are_late() {
    let mut records = moving().records;
    for (number, record) in records.iter_mut().enumerate() {
        let late = number as u64 * 7919 % 1500;
        record.at = Timestamp::from_micros(record.at.as_micros() - 1_600_000_000_000_000 + late);
    }
    as_logged(VALVE, &log(&records, Format::Candump));
}

/// A spool with measured times is replayed with these times.
#[test]
fn a_measured_spool_moves_as_it_was_measured() {
    let measured = format!("{VALVE},stroke-ms=500,return-ms=400");
    let mut session = Session::new(&measured);
    session.send(10, &["000: 01 20", "220: 03 00 00 00", "220: 0B 00 00 00"]);
    session.send(20, &["220: 0F 00 00 20"; 20]);
    as_logged(&measured, &session.log());
    assert!(!replayed(VALVE, &session.log()).is_as_logged());
}

/// The actual value exists in four scales; SDO reads each of them.
#[test]
fn loggers_are_late_on_every_scale() {
    for object in ["01 63 01", "01 33 00", "02 33 00", "04 33 00"] {
        let mut session = Session::new(VALVE);
        session.send(10, &["000: 01 20", "220: 03 00 00 00", "220: 0B 00 00 00"]);
        for set_point in ["220: 0F 00 00 20", "220: 0F 00 00 C0"] {
            session.send(3, &[set_point, &format!("620: 40 {object} 00 00 00 00")].repeat(40));
        }
        for (number, record) in session.records.iter_mut().enumerate() {
            record.at = Timestamp::from_micros(record.at.as_micros() + number as u64 * 7919 % 1500);
        }
        as_logged(VALVE, &session.log());
    }
}

/// Moves the frames for which `is` returns true by a time, and returns the new log.
fn moved(records: &[Record], by: i64, is: impl Fn(usize) -> bool) -> NamedTempFile {
    let mut records = records.to_vec();
    for (place, record) in records.iter_mut().enumerate().filter(|(place, _)| is(*place)) {
        assert!(place > 0, "not the power-up");
        record.at = Timestamp::from_micros(record.at.as_micros().saturating_add_signed(by));
    }
    records.sort_by_key(|record| record.at);
    log(&records, Format::Candump)
}

/// The log has the command at which the spool reverses a little earlier or later than it was on the bus.
#[test]
fn loggers_are_late_where_the_spool_reverses() {
    let canopen = |turn: &[&str]| {
        let mut session = Session::new(VALVE);
        session.send(10, &["000: 01 20", "220: 03 00 00 00", "220: 0B 00 00 00"]);
        session.send(60, &["220: 0F 00 00 40"; 2]);
        let place = session.records.len();
        // The TPDO moves with its RPDO. The next command comes while the spool still moves.
        session.send(4, turn).send(4, &[turn[0], "620: 40 01 63 01 00 00 00 00"].repeat(9));
        (VALVE, session, place..place + 2)
    };
    let device = "--device pvea-isobus@0x83";
    let isobus = |way: [&str; 2]| {
        let mut session = Session::new(device);
        session.send(300, &["18EEFF27: 02 00 20 00 00 82 00 A0"]);
        session.send(30, &[way[0]; 4]);
        let place = session.records.len();
        session.send(3, &[way[1], "18EA8327: 13 FE 00"]);
        session.send(3, &["18EA8327: 13 FE 00"; 40]);
        (device, session, place..place + 1)
    };
    let (extend, retract) = ("0CFE3327: FA FF 31 FF FF FF FF FF", "0CFE3327: FA FF 32 FF FF FF FF FF");
    let sessions = [
        canopen(&["220: 0F 00 00 C0"]),
        canopen(&["220: 0B 00 00 40"]),
        isobus([extend, retract]),
        isobus([retract, extend]),
    ];
    for (device, session, turn) in &sessions {
        for by in [-2000, -1000, -300, 300, 1000, 2000] {
            as_logged(device, &moved(&session.records, by, |place| turn.contains(&place)));
        }
    }
}

/// Float is reached at 95 % of the stroke. The flows of AVEF show the position to its end.
#[test]
fn loggers_are_late_while_the_spool_floats() {
    let device = "--device pvea-isobus@0x83";
    let mut session = Session::new(device);
    session.send(300, &["18EEFF27: 02 00 20 00 00 82 00 A0"]);
    let place = session.records.len();
    session.send(99, &["0CFE3327: 00 FF 33 FF FF FF FF FF"; 2]).send(2, &["18EA8327: 13 FE 00"; 50]);
    let is_floating = |record: &&Record| {
        let Entry::Frame(flow) = record.entry else { return false };
        matches!(flow.data(), [220..225, 0x7D, 0x33, ..])
    };
    assert!(session.records.iter().filter(is_floating).count() > 4);
    for by in [-4000, -1500, 1500, 4000] {
        as_logged(device, &moved(&session.records, by, |other| other == place));
    }
}

fn has_id(record: &Record, id: &str) -> bool {
    matches!(record.entry, Entry::Frame(frame) if frame.to_string().split(':').next() == Some(id))
}

/// Sends a command, which ends `micros` after the next frame with the identifier `cyclic`, sent every 100 ms. Returns
/// its index in the log.
fn send_beside(session: &mut Session, cyclic: &str, micros: i64, command: &str) -> usize {
    let last = session.records.iter().rfind(|record| has_id(record, cyclic)).unwrap().at.as_micros();
    let takes = timeline::length(&frame(command), 250_000).as_micros();
    let start = (last - START.as_micros() + 100_000 - takes).saturating_add_signed(micros);
    session.wait(start - session.world.now().as_micros());
    session.send(20, &[command]);
    session.records.iter().rposition(|record| record.entry == Entry::Frame(frame(command))).unwrap()
}

/// A heartbeat shows the NMT state and an AVEF the state of the valve. The log has the command a little earlier or later
/// than it was on the bus, on the other side of the cyclic frame.
#[test]
fn loggers_are_late_where_a_state_changes() {
    let mut canopen = Session::new(VALVE);
    canopen.send(3, &["620: 2B 17 10 00 64 00 00 00"]);
    let mut isobus = Session::new("--device pvea-isobus@0x83");
    isobus.send(300, &["18EEFF27: 02 00 20 00 00 82 00 A0"]);
    let avc = ["FA FF 31", "FA FF 32", "00 FF 3E", "00 FF 33"].map(|avc| format!("0CFE3327: {avc} FF FF FF FF FF"));
    let sessions = [
        (VALVE, canopen, "720", ["000: 01 20", "000: 80 20", "000: 02 20", "000: 01 00"].map(str::to_owned)),
        ("--device pvea-isobus@0x83", isobus, "0CFE1383", avc),
    ];
    for (device, mut session, cyclic, commands) in sessions {
        let beside = [-1500, 1500, -1500, 1500].into_iter().zip(&commands);
        let places: Vec<usize> =
            beside.map(|(micros, command)| send_beside(&mut session, cyclic, micros, command)).collect();
        session.wait(250_000);
        for (place, by) in places.into_iter().zip([2400, -2400, 2400, -2400]) {
            let at = |place: usize| session.records[place].at.as_micros();
            let neighbour = if by > 0 { place + 1 } else { place - 1 };
            assert!(has_id(&session.records[neighbour], cyclic) && at(place).abs_diff(at(neighbour)) < 2000);
            as_logged(device, &moved(&session.records, by, |other| other == place));
        }
    }
}

/// Beside a change of the state, a heartbeat may show the state before or after it. Every other state is reported, and
/// every change of the other heartbeats.
#[test]
fn a_state_beyond_the_tolerance_is_told() {
    let mut session = Session::new(VALVE);
    session.send(3, &["620: 2B 17 10 00 64 00 00 00"]);
    send_beside(&mut session, "720", -1500, "000: 01 20");
    session.wait(250_000);
    let heartbeats = (0..session.records.len()).filter(|place| has_id(&session.records[*place], "720"));
    let codes = [0x00, 0x04, 0x05, 0x7F, 0x85];
    let passing = heartbeats.map(|place| {
        codes.map(|code| {
            let mut records = session.records.clone();
            let Entry::Frame(heartbeat) = records[place].entry else { unreachable!() };
            records[place].entry = Entry::Frame(heartbeat.refilled([code, 0, 0, 0, 0, 0, 0, 0]));
            replayed(VALVE, &log(&records, Format::Candump)).is_as_logged()
        })
    });
    let passing: Vec<[bool; 5]> = passing.collect();
    assert_eq!(passing[0], [true, false, false, false, false], "the boot-up");
    assert_eq!(passing[1], [false, false, false, true, false], "before the command");
    assert_eq!(passing[2], [false, false, true, true, false], "beside the command");
    assert_eq!(passing[3..], [[false, false, true, false, false]; 2], "after the command");
}

/// A frame that is early or late by nearly the tolerance holds a position near that of the simulated frame: time and
/// position may not differ by the tolerance each.
#[test]
fn time_and_position_share_the_tolerance() {
    let session = moving();
    let is_pdo = |place: &usize| {
        let Entry::Frame(frame) = session.records[*place].entry else { return false };
        frame.to_string().starts_with("1A0:")
    };
    let place = (0..session.records.len()).filter(is_pdo).nth(20).unwrap();
    for (by, off, differences) in [
        (-4900, 0, 0),
        (-4900, -300, 0),
        (-4900, -700, 1),
        (-4900, 300, 1),
        (4900, 300, 0),
        (4900, 700, 1),
        (4900, -300, 1),
    ] {
        let mut records = session.records.clone();
        let Entry::Frame(pdo) = records[place].entry else { unreachable!() };
        let position = i16::from_le_bytes([pdo.data()[2], pdo.data()[3]]);
        let [low, high] = (position + off).to_le_bytes();
        let changed = pdo.refilled([pdo.data()[0], pdo.data()[1], low, high, 0, 0, 0, 0]);
        records[place].entry = Entry::Frame(changed);
        let outcome = replayed(VALVE, &moved(&records, by, |other| other == place));
        assert_eq!(outcome.differences, differences, "{by} us, {off}");
    }
}

/// A position that the spool cannot have reached is reported, even while the spool moves.
#[test]
fn a_position_beyond_the_tolerance_is_told() {
    let mut records = moving().records;
    let is_pdo = |record: &Record| matches!(record.entry, Entry::Frame(frame) if frame.to_string().starts_with("1A0:"));
    let place = records.iter().enumerate().filter(|(_, record)| is_pdo(record)).nth(20).unwrap().0;
    let Entry::Frame(pdo) = records[place].entry else { unreachable!() };
    let position = i16::from_le_bytes([pdo.data()[2], pdo.data()[3]]);
    let off_by = |off: i16| {
        let [low, high] = (position + off).to_le_bytes();
        pdo.refilled([pdo.data()[0], pdo.data()[1], low, high, 0, 0, 0, 0])
    };
    records[place].entry = Entry::Frame(off_by(50));
    as_logged(VALVE, &log(&records, Format::Candump));
    records[place].entry = Entry::Frame(off_by(3000));
    let outcome = replayed(VALVE, &log(&records, Format::Candump));
    assert_eq!((outcome.differences, outcome.told[0].what), (1, What::Different));
}

/// Only the position of a moving spool may differ, no other data.
#[test]
fn only_the_position_of_a_moving_spool_may_differ() {
    let is = |record: &Record, start: &str| matches!(record.entry, Entry::Frame(frame) if frame.to_string().starts_with(start));
    let changed = |session: &Session, place: usize, byte: usize| {
        let mut records = session.records.clone();
        let Entry::Frame(frame) = records[place].entry else { unreachable!() };
        let mut data = *frame.bytes();
        data[byte] ^= 4;
        records[place].entry = Entry::Frame(frame.refilled(data));
        log(&records, Format::Candump)
    };
    let mut session = Session::new(VALVE);
    session.send(10, &["000: 01 20", "220: 03 00 00 00", "220: 0B 00 00 00"]);
    session.send(2, &["220: 0F 00 00 20"; 40]);
    let pdos: Vec<usize> = (0..session.records.len()).filter(|at| is(&session.records[*at], "1A0: 0F")).collect();
    for place in pdos {
        let outcome = replayed(VALVE, &changed(&session, place, 0));
        assert_eq!(outcome.differences, 1, "line {}: the status word", place + 1);
    }
    let device = "--device pvea-isobus@0x83";
    let mut session = Session::new(device);
    session.send(300, &["18EEFF27: 02 00 20 00 00 82 00 A0", "0CFE3327: 7D FF 30 FF FF FF FF FF"]);
    session.send(90, &["0CFE3327: FA FF 31 FF FF FF FF FF"; 3]);
    session.send(2, &["18EA8327: CA FE 00", "0CFE3327: FA FF 31 FF FF FF FF FF"].repeat(20));
    let messages: Vec<usize> = (0..session.records.len()).filter(|at| is(&session.records[*at], "18FECA83:")).collect();
    assert!(messages.len() > 15);
    for place in messages {
        for byte in [1, 2, 4] {
            let outcome = replayed(device, &changed(&session, place, byte));
            assert_eq!(outcome.differences, 1, "line {}: byte {byte} of DM1", place + 1);
        }
    }
}

/// Every bit of an AVEF is compared while the spool moves. Flow from both ports at the same time is reported.
#[test]
fn every_bit_of_a_moving_flow_is_compared() {
    let device = "--device pvea-isobus@0x83";
    let mut session = Session::new(device);
    session.send(300, &["18EEFF27: 02 00 20 00 00 82 00 A0"]);
    session.send(23, &["0CFE3327: FA FF 31 FF FF FF FF FF"; 10]);
    let is_flow = |place: &usize| {
        matches!(session.records[*place].entry, Entry::Frame(flow)
        if flow.to_string().starts_with("0CFE1383:") && (140..200).contains(&flow.data()[0]))
    };
    let place = (0..session.records.len()).find(is_flow).expect("it moves");
    let Entry::Frame(flow) = session.records[place].entry else { unreachable!() };
    let told = |change: &dyn Fn(&mut [u8; 8])| {
        let mut records = session.records.clone();
        let mut data = *flow.bytes();
        change(&mut data);
        records[place].entry = Entry::Frame(flow.refilled(data));
        let outcome = replayed(device, &log(&records, Format::Candump));
        assert!(outcome.differences <= 1);
        outcome.differences == 1
    };
    assert!(!told(&|data| data[0] += 1), "it comes by within the tolerance");
    for bit in 8..64 {
        assert!(told(&|data| data[bit / 8] ^= 1 << (bit % 8)), "bit {bit} of {flow}");
    }
    assert!(told(&|data| data[1] = data[0]), "extend and retract at once");
}
