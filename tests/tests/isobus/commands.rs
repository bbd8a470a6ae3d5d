//! Auxiliary valve command and estimated flow: what is taken, what is ignored, what the spool does and what is told of
//! it (SPEC 1, 2, 5).

use protocol_core::actuator::{Position, SetPoint};
use protocol_core::device::pve::{Kind, PveIsobus, Setup};
use protocol_core::device::{Device as _, Inputs, StartCause, Viewable as _};
use protocol_core::memory::Image;
use protocol_core::time::{Duration, Instant};
use protocol_core::wire::valve::State;
use tests::isobus::{AVEF_BLOCKED, BLOCK, EXTEND, FLOAT, HAND, RETRACT, STOP, TIME_GUARDING};
use tests::{Rig, frame};

/// States by their bits, and what the estimated flow shows 600 ms after full flow was commanded.
const STATES: [(u8, [u8; 3]); 6] = [
    (0, [0x7D, 0x7D, 0x30]),
    (1, [0xE1, 0x7D, 0x31]),
    (2, [0x7D, 0xE1, 0x32]),
    (3, [0xE1, 0x7D, 0x33]),
    (10, [0x7D, 0x7D, 0x3A]),
    (14, [0x7D, 0x7D, 0x3E]),
];

/// Sends this command at once and every 100 ms, for 600 ms: longer than from one end to the other. The estimated flow
/// then.
fn after_commands(valve: &mut Rig, command: &str) -> [u8; 3] {
    valve.send(command);
    valve.advance_cyclic(600, command);
    valve.take();
    valve.flow()
}

#[test]
fn every_state() {
    for (state, flow) in STATES {
        let mut valve = Rig::claimed();
        assert_eq!(after_commands(&mut valve, &format!("0CFE3327: FA FF {:02X} FF FF FF FF FF", 0x30 | state)), flow);
        // the same state from another one, and back
        for other in [EXTEND, RETRACT, FLOAT, HAND, STOP, BLOCK] {
            after_commands(&mut valve, other);
            assert_eq!(
                after_commands(&mut valve, &format!("0CFE3327: FA FF {:02X} FF FF FF FF FF", 0x30 | state)),
                flow
            );
        }
    }
}

/// Fail-safe modes, reserved bits and bytes that do not count, another priority, any source.
#[test]
fn what_does_not_count_in_a_command() {
    for command in [
        "0CFE3327: FA FF 01 FF FF FF FF FF",
        "0CFE3327: FA FF 11 FF FF FF FF FF",
        "0CFE3327: FA FF 21 FF FF FF FF FF",
        "0CFE3327: FA FF F1 FF FF FF FF FF",
        "0CFE3327: FA FF C1 FF FF FF FF FF",
        "0CFE3327: FA 00 31 00 00 00 00 00",
        "0CFE3327: FA 12 31 34 56 78 9A BC",
        "00FE3327: FA FF 31 FF FF FF FF FF",
        "1CFE3327: FA FF 31 FF FF FF FF FF",
        "0CFE3300: FA FF 31 FF FF FF FF FF",
        "0CFE3383: FA FF 31 FF FF FF FF FF",
        "0CFE33FD: FA FF 31 FF FF FF FF FF",
        "0CFE33FE: FA FF 31 FF FF FF FF FF",
    ] {
        assert_eq!(after_commands(&mut Rig::claimed(), command), [0xE1, 0x7D, 0x31], "{command}");
    }
    // the flow, where none is asked for
    for flow in [0, 1, 250, 251, 255] {
        for (state, expected) in STATES.into_iter().filter(|(state, _)| !matches!(state, 1 | 2)) {
            let command = format!("0CFE3327: {flow:02X} FF {:02X} FF FF FF FF FF", 0x30 | state);
            assert_eq!(after_commands(&mut Rig::claimed(), &command), expected, "{command}");
        }
    }
}

/// Everything that makes a command none, in its fields.
fn bad_commands() -> Vec<String> {
    let mut bad = Vec::new();
    for state in [1, 2] {
        for flow in 251..=255_u8 {
            bad.push(format!("0CFE3327: {flow:02X} FF {:02X} FF FF FF FF FF", 0x30 | state));
        }
    }
    for state in [4, 5, 6, 7, 8, 9, 11, 12, 13, 15_u8] {
        bad.push(format!("0CFE3327: 00 FF {:02X} FF FF FF FF FF", 0x30 | state));
        bad.push(format!("0CFE3327: 00 FF {:02X} FF FF FF FF FF", 0xF0 | state));
    }
    for fail_safe in [0x40, 0x80_u8] {
        for (state, _) in STATES {
            bad.push(format!("0CFE3327: 00 FF {:02X} FF FF FF FF FF", fail_safe | 0x30 | state));
        }
    }
    bad
}

/// Frames that are no command for the valve at 0x83: another valve's, another length, another group.
const NOT_FOR_IT: [&str; 14] = [
    "0CFE3027: FA FF 32 FF FF FF FF FF",
    "0CFE3227: FA FF 32 FF FF FF FF FF",
    "0CFE3427: FA FF 32 FF FF FF FF FF",
    "0CFE3F27: FA FF 32 FF FF FF FF FF",
    "0CFE3327: FA FF 32 FF FF FF FF",
    "0CFE3327: FA FF 32",
    "0CFE3327: FA",
    "0CFE3327:",
    "0CFE3327: R8",
    "0CFE1327: FA FF 32 FF FF FF FF FF",
    "0CFE4327: FA FF 32 FF FF FF FF FF",
    "0DFE3327: FA FF 32 FF FF FF FF FF",
    "0EFE3327: FA FF 32 FF FF FF FF FF",
    "0CFD3327: FA FF 32 FF FF FF FF FF",
];

/// Neither the spool nor the state nor the time guard takes notice.
#[test]
fn what_is_ignored_as_a_whole() {
    let not_for_it = NOT_FOR_IT.iter().map(ToString::to_string);
    for frame in bad_commands().into_iter().chain(not_for_it) {
        let mut valve = Rig::claimed();
        assert_eq!(after_commands(&mut valve, EXTEND), [0xE1, 0x7D, 0x31]);
        for _ in 0..4 {
            valve.advance(50);
            valve.send(&frame);
        }
        assert_eq!(valve.flow(), [0xE1, 0x7D, 0x31], "{frame}");
        // the last valid command was 200 ms ago
        valve.advance_by(Duration::from_micros(49_999));
        valve.expect_news(&[]);
        valve.advance_by(Duration::from_micros(1));
        assert_eq!(valve.take_news(), [TIME_GUARDING], "{frame}");
        // and the fault is not ended by it
        valve.advance(300);
        valve.send(&frame);
        assert_eq!(valve.take_news(), [""; 0], "{frame}");
    }
}

#[test]
fn every_address_has_its_own_command() {
    for address in 0x80..=0x8F_u8 {
        let mut valve = Rig::claimed_as(Setup { node_id: Some(address), ..Setup::new(Kind::PveaIsobus) });
        for number in 0..16 {
            valve.send(&format!("0CFE3{number:X}27: FA FF 31 FF FF FF FF FF"));
            assert_eq!(valve.flow()[2], if number == address & 0xF { 0x31 } else { 0x30 });
            valve.send(&format!("0CFE3{:X}27: 00 FF 30 FF FF FF FF FF", address & 0xF));
        }
    }
}

/// 0.4 % a bit in, 1 % a bit out, both ways; the unused direction says 0 %.
#[test]
fn every_flow() {
    for flow in 0..=250_u32 {
        let percent = u8::try_from((flow * 4 + 5) / 10).unwrap();
        let mut valve = Rig::claimed();
        let command = |state: u8| format!("0CFE3327: {flow:02X} FF {state:02X} FF FF FF FF FF");
        assert_eq!(after_commands(&mut valve, &command(0x31)), [0x7D + percent, 0x7D, 0x31]);
        assert_eq!(after_commands(&mut valve, &command(0x32)), [0x7D, 0x7D + percent, 0x32]);
    }
}

/// The solenoids take 250 ms for a full stroke, the springs, which act in block, are steered by the solenoids as well.
#[test]
fn the_way_of_the_spool_as_it_is_told() {
    let mut valve = Rig::claimed();
    valve.send(EXTEND);
    for expected in ["A5 7D 31", "CD 7D 31", "E1 7D 31", "E1 7D 31"] {
        valve.advance(100);
        valve.expect(&format!("0CFE1383: {expected} FF FF FF FF FF"));
        valve.send(EXTEND);
    }
    valve.send(RETRACT);
    for expected in ["B9 7D 32", "91 7D 32", "7D 91 32", "7D B9 32", "7D E1 32", "7D E1 32"] {
        valve.advance(100);
        valve.expect(&format!("0CFE1383: {expected} FF FF FF FF FF"));
        valve.send(RETRACT);
    }
    valve.expect_nothing();
}

/// To the microsecond, whatever else goes on.
#[test]
fn estimated_flow_exactly_every_100_ms() {
    let mut valve = Rig::claimed();
    for round in 0..200_u64 {
        valve.advance_by(Duration::from_micros(13_000 + round * 17));
        valve.send(if round % 3 == 0 { EXTEND } else { BLOCK });
        if round % 5 == 0 {
            // asked for, it comes beside the cycle
            valve.send("18EA8327: 13 FE 00");
            assert_eq!(valve.take_under("0CFE1383").len(), 1);
            valve.send("18EAFF28: 13 FE 00");
            assert_eq!(valve.take_under("0CFE1383").len(), 1);
        }
        valve.sense(|inputs| inputs.internal_fault = round % 7 == 0);
        valve.take();
        valve.advance_by(Duration::from_micros(99_999 - 13_000 - round * 17));
        assert!(valve.take_under("0CFE1383").is_empty());
        valve.advance_by(Duration::from_micros(1));
        assert_eq!(valve.take_under("0CFE1383").len(), 1);
    }
}

/// A platform that is late does not shift the cycle.
#[test]
fn estimated_flow_by_a_late_platform() {
    let mut valve = Rig::claimed();
    for late in [1, 7, 99] {
        valve.leap(Duration::from_millis(100 + late));
        valve.expect(AVEF_BLOCKED);
        valve.silent_for(99 - late);
        valve.advance(1);
        valve.expect(AVEF_BLOCKED);
    }
}

/// Nothing is made up for: the state of now, once, then the cycle.
#[test]
fn estimated_flow_after_a_pause_of_the_platform() {
    let mut valve = Rig::claimed();
    valve.leap(Duration::from_millis(1234));
    valve.expect_all(&[AVEF_BLOCKED]);
    let mut times = Vec::new();
    for ms in 0..400 {
        valve.advance(1);
        if !valve.take().is_empty() {
            times.push(ms);
        }
    }
    assert_eq!(times.len(), 4, "{times:?}");
    assert!(times.windows(2).all(|pair| pair[1] - pair[0] == 100), "{times:?}");
}

/// On a busy bus only the latest waits.
#[test]
fn a_held_bus_gets_the_latest_flow_alone() {
    let mut valve = Rig::claimed();
    valve.hold_bus(true);
    valve.send(EXTEND);
    valve.advance_cyclic(350, EXTEND);
    valve.hold_bus(false);
    valve.expect_all(&["0CFE1383: E1 7D 31 FF FF FF FF FF"]);
    valve.advance(50);
    valve.expect("0CFE1383: E1 7D 31 FF FF FF FF FF");
}

#[test]
fn blocked_before_the_first_command() {
    let mut valve = Rig::claimed();
    for _ in 0..50 {
        valve.advance(100);
        valve.expect(AVEF_BLOCKED);
    }
    valve.expect_nothing();
}

/// The flows are the spool's, whoever moves it; the state is the command's.
#[test]
fn flows_follow_the_spool() {
    for (command, state) in [(HAND, 0x3A), (BLOCK, 0x30), (STOP, 0x3E)] {
        let mut valve = Rig::claimed();
        valve.send(command);
        for (position, flows) in [
            (16384, [0xE1, 0x7D]),
            (-16384, [0x7D, 0xE1]),
            (8192, [0xAF, 0x7D]),
            (-8192, [0x7D, 0xAF]),
            // 0.5 % is rounded away from zero
            (82, [0x7E, 0x7D]),
            (81, [0x7D, 0x7D]),
            (-82, [0x7D, 0x7E]),
            (-81, [0x7D, 0x7D]),
            (0, [0x7D, 0x7D]),
        ] {
            valve.sense(|inputs| inputs.spool.lever = Position::new(position));
            assert_eq!(valve.flow(), [flows[0], flows[1], state], "{position}");
        }
    }
}

/// Neutral is blocked for the spool, whatever the state says.
#[test]
fn no_flow_is_neutral() {
    for state in [0x31, 0x32] {
        let mut valve = Rig::claimed();
        after_commands(&mut valve, EXTEND);
        let neutral = format!("0CFE3327: 00 FF {state:02X} FF FF FF FF FF");
        assert_eq!(after_commands(&mut valve, &neutral), [0x7D, 0x7D, state]);
        valve.advance_cyclic_news(2000, &neutral, &[]);
    }
}

/// People and tools are shown the set-point of the state that AVEF tells.
#[test]
fn the_view_shows_the_set_point_of_the_state() {
    let now = Instant::from_secs(1);
    let setup = Setup { node_id: Some(0x83), ..Setup::new(Kind::PveaIsobus) };
    let mut valve = PveIsobus::power_on(setup, &Image::empty(), StartCause::PowerOn, now);
    let shown = |valve: &PveIsobus| {
        let view = valve.view(now).valve.unwrap();
        (view.command.unwrap(), view.set_point)
    };
    for (command, state, set_point) in [
        (EXTEND, State::Extend, SetPoint::Position(Position::MAX)),
        (HAND, State::HandOperation, SetPoint::NEUTRAL),
        (FLOAT, State::Float, SetPoint::Float),
        (RETRACT, State::Retract, SetPoint::Position(Position::MIN)),
    ] {
        valve.handle(&frame(command), now);
        assert_eq!(shown(&valve), (state, set_point));
    }
    valve.sense(&Inputs { internal_fault: true, ..Inputs::default() }, now);
    assert_eq!(shown(&valve), (State::Blocked, SetPoint::NEUTRAL), "shut down");
}
