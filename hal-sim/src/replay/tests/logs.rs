//! Logs that begin late, have gaps, or are damaged.

use proptest::prelude::*;

use super::*;

/// A log does not contain power-ups: each power-up is derived from the first frame of the device, or the device was
/// powered up before the log. The report names the case, because a wrong time of the first frame is not detected.
#[test]
fn what_gives_the_power_up_is_said() {
    let both = "--device pvea-canopen@0x20 --device hat1000@1,bit-rate=250k";
    let mut session = Session::new(both);
    session.send(30, &["601: 40 04 60 00 00 00 00 00"; 3]);
    let place_of =
        |text: &str| session.records.iter().position(|record| record.entry == Entry::Frame(frame(text))).unwrap();
    let (valve, sensor) = (place_of("720: 00"), place_of("701: 00"));
    let said = |records: &[Record]| {
        let file = log(records, Format::Candump);
        as_logged(both, &file);
        let options = options(both, &file);
        replay(&options).unwrap().report(&options).split_once("; power-up").unwrap().1.to_owned()
    };
    let by_line = format!(
        " not compared: pvea-canopen aligned with line {}, hat1000 aligned with line {}\n",
        valve + 1,
        sensor + 1
    );
    assert_eq!(said(&session.records), by_line);
    session.records.remove(sensor);
    assert_eq!(said(&session.records), " not compared: pvea-canopen aligned with line 1, hat1000 on before the log\n");
}

/// The logger started earlier: frames before the power-up have the identifier of the boot-up message.
#[test]
fn a_log_may_begin_with_an_earlier_life() {
    let session = at_rest();
    let earlier = |ms: u64, text: &str| Record {
        at: Timestamp::from_micros(START.as_micros() - ms * 1000),
        entry: Entry::Frame(frame(text)),
    };
    let mut records = vec![earlier(900, "720: 05"), earlier(850, "220: 0F 00 00 00"), earlier(800, "720: 05")];
    records.extend(&session.records);
    let file = log(&records, Format::Candump);
    assert!(replayed(VALVE, &file).differences > 0);
    let line = format!("{VALVE} --from-boot-up");
    assert!(as_logged(&line, &file) > 20);
    let report = replayed(&line, &file).report(&options(&line, &file));
    let skipped =
        "12 frames of other nodes sent, 3 entries before the first boot-up or address claim skipped; power-up";
    assert!(report.contains(skipped), "{report}");
    let file = log(&records[..3], Format::Candump);
    let error = replay(&options(&format!("{VALVE} --from-boot-up"), &file)).unwrap_err().to_string();
    assert!(error.ends_with(": no boot-up or address claim from pvea-canopen in the log"), "{error}");
}

/// `--from-boot-up` skips no boot-up or claim, not even a wrong one.
#[test]
fn a_wrong_boot_up_is_not_skipped() {
    let mut isobus = Session::new("--device pvea-isobus@0x83");
    isobus.wait(1_000_000);
    for (device, records, right, wrong) in [
        (VALVE, at_rest().records, "720: 00", vec!["720: 00 00", "720: 01", "720:"]),
        (
            "--device pvea-isobus@0x83",
            isobus.records,
            "18EEFF83: 01 00 20 07 08 FF 02 20",
            vec!["18EEFF83: 02 00 20 07 08 FF 02 20", "18EEFF83: 01 00 20 07 08 FF 02"],
        ),
    ] {
        let line = format!("{device} --from-boot-up");
        let first = records.iter().position(|record| record.entry == Entry::Frame(frame(right))).unwrap();
        let later = |record: &Record| Record { at: record.at.at(Instant::from_secs(60)), ..*record };
        for wrong in wrong {
            let mut both = records.clone();
            both[first].entry = Entry::Frame(frame(wrong));
            both.extend(records.iter().map(later));
            let outcome = replayed(&line, &log(&both, Format::Candump));
            let told = outcome.told.first().map(|difference| (difference.what, difference.number));
            assert_eq!(told, Some((What::Different, Some(first as u64 + 1))), "{wrong}");
        }
    }
}

/// Another device with the node ID answered node guarding before the valve was powered up.
#[test]
fn answers_to_node_guarding_are_no_boot_up() {
    let records = at_rest().records;
    let later = |record: &Record| Record { at: record.at.at(Instant::from_secs(10)), ..*record };
    let guarding = ["720: R0", "720: 85", "720: R0", "720: 05", "720: R0", "720: FF"].map(frame);
    let before = guarding.into_iter().zip(1..).map(|(frame, place)| Record {
        at: records[0].at.at(Instant::from_millis(place * 100)),
        entry: Entry::Frame(frame),
    });
    let both: Vec<Record> = before.chain(records.iter().map(later)).collect();
    let outcome = replayed(&format!("{VALVE} --from-boot-up"), &log(&both, Format::Candump));
    assert_eq!((outcome.differences, outcome.skipped), (0, 6), "{:?}", outcome.told);
}

/// The logger started later: the valve had already booted.
#[test]
fn a_log_may_begin_after_the_boot_up() {
    let records = at_rest().records;
    assert!(as_logged(VALVE, &log(&records[2..], Format::Candump)) > 20);
}

/// The logger started later: the first AVEF in the log gives the phase of all later AVEFs.
#[test]
fn a_log_may_begin_after_the_claim() {
    let device = "--device pvea-isobus@0x83";
    let mut session = Session::new(device);
    session.wait(300_000);
    session.send(170, &["18EA8327: EB FE 00", "0CFE1127: 00", "0CFE1127: 00", "18EA8327: EB FE 00", "0CFE1127: 00"]);
    // A log that begins with an answer lacks the request.
    let is_answer = |record: &Record| record.entry == Entry::Frame(frame("18E8FF83: 01 FF FF FF 27 EB FE 00"));
    for first in (1..session.records.len()).filter(|first| !is_answer(&session.records[*first])) {
        as_logged(device, &log(&session.records[first..], Format::Candump));
    }
    // Two valves with different phases.
    let both = "--device pvea-isobus@0x83 --device pveo-isobus@0x84";
    let mut session = Session::new(both);
    session.wait(37_000);
    let node = session.world.find("pveo-isobus").unwrap();
    session.world.power(node, false);
    session.wait(5_000);
    session.world.power(node, true);
    session.wait(2_000_000);
    let late = session.records.len() - 20;
    assert_eq!(as_logged(both, &log(&session.records[late..], Format::Candump)), 20);
}

/// A slow start delays the first frame.
#[test]
fn a_device_may_start_slowly() {
    for device in ["pvea-canopen@0x20", "hat1000@0x20", "pvea-isobus@0x83"] {
        for boot_ms in [1500, 2500, 60_000] {
            let device = format!("--device {device},boot-ms={boot_ms}");
            let mut session = Session::new(&device);
            session.wait(boot_ms * 1000 + 700_000);
            let booted = session.records.len();
            session.send(20, &["620: 40 18 10 01 00 00 00 00", "1BC78883: 03 22 F1 8C 55 55 55 55"]);
            for first in [0, booted] {
                as_logged(&device, &log(&session.records[first..], Format::Candump));
            }
        }
    }
}

/// The times of a log may begin at 0, as those of ASC often do, although a device was powered up earlier.
#[test]
fn a_log_may_begin_at_zero() {
    let mut isobus = Session::new("--device pvea-isobus@0x83");
    isobus.wait(1_000_000);
    for (device, records) in [(VALVE, at_rest().records), ("--device pvea-isobus@0x83", isobus.records)] {
        for (first, micros) in [(0, 0), (0, 500_000), (2, 0), (2, 500_000), (2, 1_500_000)] {
            let records = &records[first..];
            let (start, format) = (Timestamp::from_micros(micros), Format::Candump);
            let at =
                |record: &Record| start.at(Instant::from_micros(record.at.as_micros() - records[0].at.as_micros()));
            let moved: Vec<Record> = records.iter().map(|record| Record { at: at(record), ..*record }).collect();
            as_logged(device, &log(&moved, format));
        }
    }
}

#[test]
fn what_is_no_frame_is_told_and_the_rest_is_played() {
    let session = at_rest();
    let mut file = session.log();
    file.as_file_mut().write_all(&fs::read(session.log().path()).unwrap()).unwrap();
    file.as_file_mut().write_all(b"hello\n").unwrap();
    let outcome = replayed(VALVE, &file);
    assert_eq!((outcome.differences, outcome.unread.len()), (0, 1));
    assert!(!outcome.is_as_logged() && outcome.unread[0].ends_with(": not a candump line: \"hello\""));
    let mut records = session.records.clone();
    records.insert(3, Record { entry: Entry::Error(ErrorClass::BusError.into()), ..records[3] });
    let outcome = replayed(VALVE, &log(&records, Format::Candump));
    assert_eq!((outcome.differences, outcome.error_frames), (0, 1));
    let other = replay(&options("--device pvea-canopen@0x21", &session.log())).unwrap_err();
    assert!(other.to_string().ends_with(": no frame from pvea-canopen in the log"), "{other}");
    let empty = replay(&options(VALVE, &log(&[], Format::Asc))).unwrap_err();
    assert!(empty.to_string().ends_with(": no frame to replay"), "{empty}");
}

/// A cannot-claim has a random delay, also at the end of a log: the recorded valve may have sent it earlier or later than
/// the simulated valve.
#[test]
fn a_log_may_end_near_a_cannot_claim() {
    let device = "--device pvea-isobus@0x83";
    let mut session = Session::new(device);
    session.wait(400_000);
    session.send(300, &["18EEFF83: 00 00 00 00 00 00 00 10"]);
    let cannot = Entry::Frame(frame("18EEFFFE: 01 00 20 07 08 FF 02 20"));
    let place = session.records.iter().position(|record| record.entry == cannot).unwrap();
    let (contention, at) = (session.records[place - 1].at, session.records[place].at);
    let mut records = session.records[..place].to_vec();
    records.push(Record { at: Timestamp::from_micros(contention.as_micros() + 2000), entry: cannot });
    assert!(at.as_micros() - contention.as_micros() > 30_000, "the simulated valve is later");
    as_logged(device, &log(&records, Format::Candump));
    // The log ends before the recorded valve sends the frame, or lacks the frame.
    records[place] = Record { at: at.at(Instant::from_millis(20)), entry: Entry::Frame(frame("0CFE1127: 00")) };
    as_logged(device, &log(&records, Format::Candump));
    records[place].at = at.at(Instant::from_millis(160));
    let outcome = replayed(device, &log(&records, Format::Candump));
    assert_eq!((outcome.differences, outcome.told[0].what), (1, What::Additional));
}

/// A blank device sends nothing without a request: a log without its frames does not match.
#[test]
fn a_device_of_which_nothing_is_compared_is_told() {
    let file = at_rest().log();
    for (line, name) in [
        ("--device hat1000,blank", "hat1000"),
        ("--device pvea-canopen,blank", "pvea-canopen"),
        ("--device pvea-canopen@0x20 --device hat1000,blank", "hat1000"),
    ] {
        let error = replay(&options(line, &file)).map(|outcome| outcome.differences).unwrap_err();
        assert!(error.to_string().ends_with(&format!(": no frame from {name} in the log")), "{line}: {error}");
    }
}

/// A clock adjustment in the log must not make the replay run for years, not even from time 0. It is reported once, and
/// the frames after it are compared.
#[test]
fn a_clock_that_is_adjusted_is_told() {
    const YEARS: u64 = 1_700_000_000_000_000;
    let records = at_rest().records;
    let begun = records[0].at.as_micros();
    let times = |shift: &dyn Fn(usize, u64) -> u64| -> Vec<Record> {
        let at =
            |(place, record): (usize, &Record)| Timestamp::from_micros(shift(place, record.at.as_micros() - begun));
        records.iter().enumerate().map(|pair| Record { at: at(pair), ..*pair.1 }).collect()
    };
    // The answer comes less than 1 ms after its request.
    let answer = Entry::Frame(frame("5A0: 43 18 10 01 19 00 00 01"));
    let place = records.iter().position(|record| record.entry == answer).unwrap();
    for (from, to, what) in [(0, YEARS, "after"), (YEARS, 0, "before"), (YEARS, 2 * YEARS, "after")] {
        let mut moved = times(&|at, micros| micros + if at < place { from } else { to });
        let outcome = replayed(VALVE, &log(&moved, Format::Candump));
        let named = format!(":{}: time more than a day {what} the previous entry", place + 1);
        assert!(matches!(&outcome.unread[..], [only] if only.ends_with(&named)), "{:?}", outcome.unread);
        assert_eq!((outcome.differences, outcome.compared + outcome.played), (0, records.len() as u64));
        // A difference after the adjustment is reported at its time in the log.
        let changed = (place..records.len()).find(|place| is_of_valve(&records[*place])).unwrap();
        let Entry::Frame(frame) = moved[changed].entry else { unreachable!() };
        moved[changed].entry = Entry::Frame(frame.refilled([0x55; 8]));
        let outcome = replayed(VALVE, &log(&moved, Format::Candump));
        assert_eq!((outcome.differences, outcome.told[0].at), (1, moved[changed].at));
    }
    // The replay of a valve that sends without a request comes to its end.
    let claim = Entry::Frame(frame("18EEFF83: 01 00 20 07 08 FF 02 20"));
    let claims = [0, YEARS].map(|micros| Record { at: Timestamp::from_micros(micros), entry: claim });
    let outcome = replayed("--device pvea-isobus@0x83", &log(&claims, Format::Candump));
    assert_eq!((outcome.compared, outcome.unread.len()), (2, 1));
    // Enormous times.
    for first in [i64::MAX as u64 - 1, i64::MAX as u64, u64::MAX] {
        let moved = times(&|at, _| if at == 0 { first } else { 1_000_000_000_000 - 200_000_000_000 * at as u64 % 5 });
        assert!(!replayed(VALVE, &log(&moved, Format::Candump)).unread.is_empty());
    }
    // A single wrong time.
    let moved = times(&|at, micros| if at == place { 7 } else { YEARS + micros });
    let outcome = replayed(VALVE, &log(&moved, Format::Candump));
    assert_eq!((outcome.differences, outcome.unread.len()), (0, 1), "{:?}", outcome.unread);
}

/// The last time of a log is wrong.
#[test]
fn a_time_that_is_wrong_is_told() {
    let mut records = at_rest().records;
    let place = records.len() - 1;
    records[place].at = Timestamp::from_micros(u64::MAX);
    let outcome = replayed(VALVE, &log(&records, Format::Candump));
    assert_eq!((outcome.differences, outcome.unread.len()), (0, 1));
    let named = format!(":{}: time more than a day after the previous entry", records.len());
    assert!(outcome.unread[0].ends_with(&named), "{:?}", outcome.unread);
}

/// Decreasing times come from two merged logs, or are relative to the previous entry: they define no order.
#[test]
fn a_time_that_goes_back_is_told() {
    let records = at_rest().records;
    let twice = [&records[..], &records[..]].concat();
    let outcome = replayed(VALVE, &log(&twice, Format::Candump));
    assert!(!outcome.is_as_logged());
    let named = format!(":{}: time earlier than that of the previous entry", records.len() + 1);
    assert!(outcome.unread[0].ends_with(&named), "{:?}", outcome.unread[0]);
    // The lines of two loggers in one file, whose times differ by less than the tolerance.
    let mut records = records;
    let place = records.iter().position(is_of_valve).unwrap() + 4;
    records[place].at = Timestamp::from_micros(records[place - 1].at.as_micros() - 1000);
    as_logged(VALVE, &log(&records, Format::Candump));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases.div_ceil(4)))]

    /// A log of any frames, with times in any order, is replayed to its end.
    #[test]
    fn any_log_comes_to_its_end(
        frames in prop::collection::vec((0..2_000_000_u64, 0..0x800_u16, any::<[u8; 8]>(), 0..=8_u8, any::<u32>()), 0..60),
        isobus in any::<bool>()
    ) {
        let (device, first) = if isobus {
            ("--device pvea-isobus@0x83 --tolerance-ms 0", "18EEFF83: 01 00 20 07 08 FF 02 20")
        } else {
            ("--device hat1000@1 --device pvea-canopen@0x20,bit-rate=500k", "701: 00")
        };
        let at = |micros| Timestamp::from_micros(START.as_micros() + micros);
        let mut records = vec![Record { at: at(0), entry: Entry::Frame(frame(first)) }];
        records.push(Record { at: at(300), entry: Entry::Frame(frame("720: 00")) });
        records.extend(frames.into_iter().map(|(micros, id, data, len, raw)| {
            let id = if isobus { extended(raw).into() } else { standard(id).into() };
            let frame = if raw % 7 == 0 { Frame::remote(id, len) } else { Frame::with_len(id, data, len) };
            Record { at: at(micros), entry: Entry::Frame(frame) }
        }));
        let outcome = replayed(device, &log(&records, Format::Candump));
        prop_assert_eq!(outcome.compared + outcome.played, records.len() as u64);
    }
}
