use proptest::prelude::*;
use protocol_core::frame::{extended, standard};

use super::*;

/// Returns the commands in a text.
fn commands(text: &[u8]) -> Vec<Result<Command, Refused>> {
    let mut parser = Parser::default();
    text.iter().filter_map(|byte| parser.push(*byte)).collect()
}

fn command(line: &str) -> Result<Command, Refused> {
    match commands(format!("{line}\r").as_bytes())[..] {
        [command] => command,
        ref other => panic!("{line}: {other:?}"),
    }
}

fn of(id: Id, data: &[u8]) -> Frame {
    Frame::of(id, data).expect("a frame")
}

/// Examples of the manual and of its clients; frames in both directions.
#[test]
fn frames_are_the_lines_of_the_manual() {
    for (line, frame) in [
        ("t10021133", of(standard(0x100).into(), &[0x11, 0x33])),
        ("t7FF0", of(standard(0x7FF).into(), &[])),
        ("T0000010021133", of(extended(0x100).into(), &[0x11, 0x33])),
        ("T1FFFFFFF8FFEEDDCCBBAA9988", of(extended(0x1FFF_FFFF).into(), &[255, 238, 221, 204, 187, 170, 153, 136])),
        ("r1002", Frame::remote(standard(0x100).into(), 2)),
        ("R000001008", Frame::remote(extended(0x100).into(), 8)),
    ] {
        assert_eq!(command(line), Ok(Command::Send(frame)), "{line}");
        let mut out = String::new();
        emit_frame(&mut out, &frame, None);
        assert_eq!(out, format!("{line}\r"));
    }
    // lower-case hex of some clients
    assert_eq!(command("t1a0109"), command("t1A0109"));
    assert_eq!(command("t1a01ff"), Ok(Command::Send(of(standard(0x1A0).into(), &[0xFF]))));
}

#[test]
fn a_time_stamp_counts_milliseconds_of_a_minute() {
    for (micros, stamp) in [(0, "0000"), (59_999_999, "EA5F"), (60_000_000, "0000"), (1_795_223_549_715_344, "7413")] {
        let mut out = String::new();
        emit_frame(&mut out, &of(standard(0x1A0).into(), &[9]), Some(Timestamp::from_micros(micros)));
        assert_eq!(out, format!("t1A0109{stamp}\r"));
    }
}

#[test]
fn bit_rates_by_index_and_by_register() {
    for (line, rate) in [
        ("S0", 10_000),
        ("S3", 100_000),
        ("S5", 250_000),
        ("S7", 800_000),
        ("S8", 1_000_000),
        // the registers recommended by CiA for an SJA1000 at 16 MHz
        ("s311C", 10_000),
        ("s031C", 125_000),
        ("s011C", 250_000),
        ("s001C", 500_000),
        ("s0016", 800_000),
        ("s0014", 1_000_000),
        ("sFFFF", 5_000),
    ] {
        assert_eq!(command(line), Ok(Command::SetRate(rate)), "{line}");
    }
}

#[test]
fn what_is_no_command_is_refused() {
    for line in [
        "S",
        "S9",
        "SA",
        "S55",
        "s",
        "s01",
        "s011C0",
        "sxyzw",
        "O1",
        "o",
        "C ",
        " C",
        "F0",
        "Z",
        "Z2",
        "X0",
        "M00000000",
        "mFFFFFFFF",
        "t",
        "t12",
        "t123",
        "t1239",
        "t123A",
        "t1231",
        "t12310",
        "t800100",
        " t1230",
        "t1230 ",
        "t12300",
        "t1232012",
        "r123",
        "r1239",
        "r12310",
        "T1231",
        "T200000000",
        "TFFFFFFFF0",
        "R00000123",
        "d1230",
        "D000001230",
        "W0",
        "P",
        "A",
        "U0",
        "Q1",
        "ü",
        "t1\0",
        "\0",
        "V1",
    ] {
        assert_eq!(command(line), Err(Refused), "{line:?}");
    }
}

#[test]
fn a_line_feed_is_no_part_of_a_line_and_an_empty_line_is_nothing() {
    assert_eq!(commands(b"\r\r\nC\r\n"), [Ok(Command::Nothing), Ok(Command::Nothing), Ok(Command::Close)]);
}

/// A line of any length gets one answer, and the next line counts.
#[test]
fn a_line_without_end_takes_no_room() {
    let mut parser = Parser::default();
    for _ in 0..100_000 {
        assert_eq!(parser.push(b't'), None);
        assert!(parser.line.len() <= LINE_MAX + 1);
    }
    assert_eq!(parser.push(b'\r'), Some(Err(Refused)));
    assert_eq!(parser.push(b'O'), None);
    assert_eq!(parser.push(b'\r'), Some(Ok(Command::Open)));
    assert_eq!(command("T1FFFFFFF8FFEEDDCCBBAA99881234"), Err(Refused), "a frame and more");
}

proptest! {
    #[test]
    fn any_bytes_are_lines_of_some_kind(bytes: Vec<u8>) {
        let ends = bytes.iter().filter(|byte| **byte == b'\r').count();
        prop_assert_eq!(commands(&bytes).len(), ends);
    }

    #[test]
    fn near_frames_do_not_panic(line in "[tTrRsS][0-9a-fA-F]{0,30}") {
        let _ = command(&line);
    }
}
