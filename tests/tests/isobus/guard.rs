//! Time guarding: when it begins, what feeds it, when it trips (SPEC 2, 5).

use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::{AVEF_BLOCKED, BLOCK, DM1_CLEAR, EXTEND, FLOAT, HAND, RETRACT, STOP};

const FAULT: &str = "18FECA83: 04 FF E9 8F 93 01 FF FF";
/// One microsecond short of the guard time.
const ALMOST: Duration = Duration::from_micros(249_999);

const COMMANDS: [&str; 6] = [BLOCK, EXTEND, RETRACT, FLOAT, HAND, STOP];

#[test]
fn every_249_ms_is_often_enough() {
    for command in COMMANDS {
        let mut valve = Rig::claimed();
        for _ in 0..100 {
            valve.send(command);
            valve.advance(249);
        }
        valve.expect_news(&[]);
    }
}

/// After the whole of the 250 ms, counted from the last command to the microsecond.
#[test]
fn the_fault_comes_after_250_ms() {
    let mut valve = Rig::claimed();
    valve.advance_by(Duration::from_micros(12_345));
    valve.send(EXTEND);
    valve.advance_by(ALMOST);
    valve.send(EXTEND);
    valve.no_news_until(250, &[FAULT]);
}

#[test]
fn it_begins_with_the_first_valid_command() {
    for nothing in [None, Some("0CFE3327: FB FF 31 FF FF FF FF FF"), Some("0CFE3427: 00 FF 30 FF FF FF FF FF")] {
        let mut valve = Rig::claimed();
        for _ in 0..100 {
            valve.advance(100);
            if let Some(frame) = nothing {
                valve.send(frame);
            }
        }
        valve.expect_news(&[]);
        valve.send(BLOCK);
        valve.no_news_until(250, &[FAULT]);
    }
}

/// A restart is a power-up for it: it begins with the next command.
#[test]
fn it_begins_anew_after_a_restart() {
    let mut valve = Rig::claimed();
    valve.send(BLOCK);
    valve.advance(200);
    valve.restart();
    valve.advance_news(1000, &[]);

    valve.send(BLOCK);
    valve.take();
    valve.command_address(0x83, 0x27);
    valve.take_claim();
    valve.advance_news(1000, &[]);
}

/// It runs on in a shutdown: one that stops sending is told of again and again, each time counted.
#[test]
fn it_runs_in_every_state() {
    let mut valve = Rig::claimed();
    valve.send(EXTEND);
    for (count, command) in (1..).zip(COMMANDS.into_iter().cycle().take(12)) {
        valve.advance_news(250, &[&format!("18FECA83: 04 FF E9 8F 93 {count:02X} FF FF")]);
        valve.advance_news(300, &[]);
        // shut down since the first, and still
        valve.send(command);
        valve.expect_news(&[DM1_CLEAR]);
        assert_eq!(valve.flow()[2], 0x30);
        valve.take();
    }
}

/// The one fault, told every second while nobody commands; it is not counted again.
#[test]
fn silence_is_one_fault() {
    let mut valve = Rig::claimed();
    valve.send(BLOCK);
    valve.advance_news(250, &[FAULT]);
    for _ in 0..20 {
        valve.no_news_until(1_000, &[FAULT]);
    }
    valve.exchange("18EA8327: 13 FE 00", &[AVEF_BLOCKED]);
}
