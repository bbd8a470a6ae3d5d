//! Shutdown by a fault, and the way out of it: all causes gone, then two neutral commands in a row, each with the spool
//! in neutral (SPEC 2, 5).

use protocol_core::actuator::Position;
use protocol_core::controller::BusErrorMode;
use tests::isobus::{BLOCK, DM1_CLEAR, EXTEND, FLOAT, HAND, RETRACT, STOP};
use tests::{Inputs, Rig};

/// Neutral without block: no flow.
const EXTEND_NOTHING: &str = "0CFE3327: 00 FF 31 FF FF FF FF FF";
const RETRACT_NOTHING: &str = "0CFE3327: 00 FF 32 FF FF FF FF FF";

const NEUTRAL: [&str; 3] = [BLOCK, EXTEND_NOTHING, RETRACT_NOTHING];
const NOT_NEUTRAL: [&str; 5] = [EXTEND, RETRACT, FLOAT, HAND, STOP];

/// The estimated flow of a valve that is shut down, or has not been commanded since, in neutral.
const BLOCKED: [u8; 3] = [0x7D, 0x7D, 0x30];

/// A valve that an internal error has shut down while it extended; the error is gone, the spool is in neutral.
fn shut_down() -> Rig {
    let mut valve = Rig::extending(400);
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.advance_cyclic_news(200, EXTEND, &["18FECA83: 10 FF FA 8F 8B 01 FF FF"]);
    valve.sense_news(|inputs| inputs.internal_fault = false, &[DM1_CLEAR]);
    assert_eq!(valve.flow(), BLOCKED);
    valve
}

/// Whether the valve does as told: extends.
fn acts(valve: &mut Rig) -> bool {
    valve.send(EXTEND);
    valve.flow()[2] == 0x31
}

/// What comes after a shutdown, and whether the valve acts then: `N` any neutral command, `X` any other, `i` any that is
/// ignored, `b` block of another master, `!` an internal error that comes and goes, a number so many milliseconds.
const WAYS: [(&str, bool); 16] = [
    ("N 100 N", true),
    // no time need pass between them
    ("N N", true),
    ("N b", true),
    ("N", false),
    ("X 100 X 100 X", false),
    ("N X N", false),
    ("N X N N", true),
    ("X N N", true),
    // commands that are ignored neither come between nor count
    ("N i N", true),
    ("N i", false),
    ("i i", false),
    // the shutdown by a fault needs two of its own, even when it is gone at once
    ("N ! N", false),
    ("N ! N N", true),
    ("N N !", false),
    // more than 250 ms apart, the second ends time guarding, and is the first again
    ("N 300 N", false),
    ("N 300 N N", true),
];

const IGNORED: [&str; 6] = [
    "0CFE3327: FB FF 31 FF FF FF FF FF",
    "0CFE3327: 00 FF 34 FF FF FF FF FF",
    "0CFE3327: 00 FF 70 FF FF FF FF FF",
    "0CFE3427: FA FF 31 FF FF FF FF FF",
    "0CFE3427: 00 FF 30 FF FF FF FF FF",
    "0CFE3327: FA FF 31 FF FF FF FF",
];

#[test]
fn the_ways_out_of_a_shutdown() {
    for (way, expected) in WAYS {
        for (number, other) in (0..).zip(NOT_NEUTRAL.into_iter().cycle().take(IGNORED.len())) {
            let (neutral, ignored) = (NEUTRAL[number % NEUTRAL.len()], IGNORED[number]);
            let mut valve = shut_down();
            for step in way.split(' ') {
                match step {
                    "N" => valve.send(neutral),
                    "X" => valve.send(other),
                    "i" => valve.send(ignored),
                    "b" => valve.send("0CFE3328: 00 FF 30 FF FF FF FF FF"),
                    "!" => valve.internal_fault_comes_and_goes(),
                    ms => valve.advance(ms.parse().unwrap()),
                }
            }
            assert_eq!(acts(&mut valve), expected, "{way}: {neutral}, {other}, {ignored}");
        }
    }
}

#[test]
fn two_neutral_commands() {
    for first in NEUTRAL {
        for second in NEUTRAL {
            let mut valve = shut_down();
            valve.send(first);
            valve.advance(100);
            valve.send(second);
            assert_eq!(valve.flow(), BLOCKED, "the second ends it, and does not act itself");
            valve.advance(100);
            assert!(acts(&mut valve), "{first} {second}");
        }
    }
}

/// Within 5 % of the full stroke, both ways, at both commands.
#[test]
fn the_spool_must_be_in_neutral() {
    let at = |valve: &mut Rig, position: i16| valve.sense(|inputs| inputs.spool.lever = Position::new(position));
    for (first, second, ends) in [
        (0, 0, true),
        (819, -819, true),
        (-819, 819, true),
        (821, 0, false),
        (0, 821, false),
        (-821, 0, false),
        (0, -821, false),
        (2000, 2000, false),
        (16384, 0, false),
        (0, -16384, false),
    ] {
        let mut valve = shut_down();
        at(&mut valve, first);
        valve.send(BLOCK);
        at(&mut valve, second);
        valve.send(BLOCK);
        at(&mut valve, 0);
        assert_eq!(acts(&mut valve), ends, "{first} {second}");
    }
}

/// Neutral commands that come while the springs still work do not count.
#[test]
fn the_way_back_of_the_spool() {
    let mut valve = Rig::extending(400);
    valve.internal_fault_comes_and_goes();
    for _ in 0..14 {
        valve.send(BLOCK);
        valve.advance(10);
    }
    // 140 of 150 ms: 6.7 % away
    valve.send(BLOCK);
    assert!(!acts(&mut valve));
    valve.advance(10);
    valve.send_all(&[BLOCK, BLOCK]);
    assert!(acts(&mut valve));
}

/// Commands while a cause lasts do not count; every fault, with what is changed to bring it about and how long it
/// takes.
#[test]
fn all_causes_must_be_gone() {
    type Change = fn(&mut Inputs);
    let causes: [(Change, u64); 5] = [
        (|inputs| inputs.internal_fault = true, 0),
        (|inputs| inputs.bus = BusErrorMode::BusOff, 0),
        (|inputs| inputs.temperature_c = 121, 250),
        (|inputs| inputs.supply_mv = 36_001, 2000),
        (|inputs| inputs.supply_mv = 8_999, 2000),
    ];
    for (change, delay) in causes {
        let mut valve = Rig::claimed();
        valve.send(EXTEND);
        valve.sense(change);
        valve.advance_cyclic(delay, EXTEND);
        valve.advance_cyclic(1000, BLOCK);
        assert!(!valve.outputs().solenoids);
        valve.sense(|inputs| *inputs = Inputs::default());
        assert!(!acts(&mut valve));
        valve.send(BLOCK);
        assert!(!acts(&mut valve), "one");
        valve.send_all(&[BLOCK, BLOCK]);
        assert!(acts(&mut valve), "two");
    }
}

/// The command that ends fault 8 counts as the first when it is neutral, and only then.
#[test]
fn the_end_of_time_guarding_counts() {
    for (command, counts) in NEUTRAL
        .into_iter()
        .map(|command| (command, true))
        .chain(NOT_NEUTRAL.into_iter().map(|command| (command, false)))
    {
        let mut valve = Rig::claimed();
        valve.send(EXTEND);
        valve.advance(500);
        valve.take();
        valve.send(command);
        valve.expect_news(&[DM1_CLEAR]);
        valve.send(BLOCK);
        assert_eq!(acts(&mut valve), counts, "{command}");
    }
    // with the spool in neutral, that is
    let mut valve = Rig::extending(400);
    valve.advance(260);
    valve.send(BLOCK);
    valve.advance(200);
    valve.send(BLOCK);
    assert!(!acts(&mut valve));
    valve.send_all(&[BLOCK, BLOCK]);
    assert!(acts(&mut valve));
}

/// Of two faults both must be gone, whichever goes first; one recovery ends both, and both are previously active.
#[test]
fn two_faults() {
    for internal_first in [true, false] {
        let mut valve = Rig::claimed();
        valve.send(EXTEND);
        valve.sense(|inputs| inputs.internal_fault = true);
        valve.sense(|inputs| inputs.temperature_c = 130);
        valve.advance_cyclic(300, EXTEND);
        valve.sense(|inputs| if internal_first { inputs.internal_fault = false } else { inputs.temperature_c = 25 });
        valve.recover();
        assert!(!acts(&mut valve));
        valve.sense(|inputs| *inputs = Inputs::default());
        valve.take();
        valve.exchange("18EA8327: CB FE 00", &["18FECB83: 00 FF 00 00 00 00 FF FF"]);
        valve.recover();
        assert!(acts(&mut valve));
        valve.take();
        valve.send("18EA8327: CB FE 00");
        valve.advance_cyclic(200, BLOCK);
        valve.expect_news(&[
            "1CECFF83: 20 0A 00 02 FF CB FE 00",
            "1CEBFF83: 01 10 FF FA 8F 8B 01 F1",
            "1CEBFF83: 02 8F 90 01 FF FF FF FF",
        ]);
    }
}

/// Monitor 1 runs in blocked too, before the first command as well, and in a shutdown; not in hand operation and
/// emergency stop.
#[test]
fn where_the_spool_is_looked_at() {
    let fault = "18FECA83: 10 FF EC 8F 87 01 FF FF";
    for command in [None, Some(BLOCK), Some(HAND), Some(STOP)] {
        for shuts_down in [false, true] {
            let mut valve = if shuts_down { shut_down() } else { Rig::claimed() };
            let cyclic = |valve: &mut Rig, ms| match command.or(shuts_down.then_some(EXTEND)) {
                Some(command) => valve.advance_cyclic(ms, command),
                None => valve.advance(ms),
            };
            if let Some(command) = command {
                valve.send(command);
            }
            valve.take();
            valve.sense(|inputs| inputs.spool.lever = Position::new(2458));
            cyclic(&mut valve, 499);
            valve.expect_news(&[]);
            cyclic(&mut valve, 1);
            match command {
                Some(HAND | STOP) => {
                    cyclic(&mut valve, 5000);
                    valve.expect_news(&[]);
                }
                _ => {
                    valve.expect_news(&[fault]);
                    valve.sense(|inputs| inputs.spool.lever = None);
                    cyclic(&mut valve, 100);
                    valve.expect_news(&[DM1_CLEAR]);
                }
            }
        }
    }
}

/// A fault is counted and shuts down in hand operation and emergency stop as anywhere; the spool stays the lever's.
#[test]
fn everything_works_the_same_in_hand_operation_and_emergency_stop() {
    for command in [HAND, STOP] {
        let mut valve = Rig::claimed();
        valve.send(command);
        valve.sense(|inputs| inputs.spool.lever = Position::new(10_000));
        valve.sense(|inputs| inputs.supply_mv = 8_000);
        valve.advance_cyclic_news(2000, command, &["18FECA83: 04 FF 73 02 04 01 FF FF"]);
        assert_eq!(valve.flow()[2], 0x30, "shut down");
        valve.sense_news(|inputs| inputs.supply_mv = 24_000, &[DM1_CLEAR]);
        valve.advance_cyclic_news(2000, command, &[]);
        valve.sense(|inputs| inputs.spool.lever = None);
        valve.advance_cyclic(200, command);
        valve.recover();
        valve.send(command);
        assert_eq!(valve.flow()[2], if command == HAND { 0x3A } else { 0x3E });
        valve.take();
        valve.exchange("18EA8327: CB FE 00", &["18FECB83: 04 FF 73 02 04 01 FF FF"]);
        // time guarding as well
        valve.advance_news(250, &["18FECA83: 04 FF E9 8F 93 01 FF FF"]);
    }
}
