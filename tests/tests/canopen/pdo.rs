//! RPDO 1 and TPDO 1: when they are taken and sent, and what the values of one frame do (SPEC 4.1, 4.2).

use protocol_core::time::Duration;
use tests::Rig;

const RPDO: u16 = 0x1400;
const TPDO: u16 = 0x1800;

const CONTROL: u32 = 0x6040_0010;
const MODE: u32 = 0x6042_0008;
const SET_POINT: u32 = 0x6300_0110;
const SET_POINT_8: u32 = 0x3300_0008;
const SET_POINT_16: u32 = 0x3303_0010;

/// A frame on the RPDO's COB-ID with the values of these mapping entries, one after the other.
fn rpdo(values: &[(u32, u16)]) -> String {
    values.iter().fold("220:".to_owned(), |frame, (entry, value)| {
        let [low, high] = value.to_le_bytes();
        frame + &if entry & 0xFF == 8 { format!(" {low:02X}") } else { format!(" {low:02X} {high:02X}") }
    })
}

/// In HOLD, NMT operational, with this RPDO mapping.
fn held(entries: &[u32]) -> Rig {
    let mut rig = Rig::booted();
    rig.map(RPDO, entries);
    rig.write_all(&[(0x6040, 0, 2, 0x0001), (0x6040, 0, 2, 0x0003)]);
    rig.send("000: 01 00");
    rig.expect_nothing();
    rig
}

#[test]
fn every_rpdo_is_answered_by_a_tpdo_that_shows_what_it_did() {
    let mut rig = Rig::booted();
    rig.exchange("000: 01 00", &[]);
    rig.exchange("220: 0F 00 00 00", &["1A0: 09 00 00 00"]);
    rig.exchange("220: 0F 00 00 00", &["1A0: 0B 00 00 00"]);
    rig.exchange("220: 0F 00 00 00", &["1A0: 0F 00 00 00"]);
    rig.exchange("220: 0F 00 00 40", &["1A0: 0F 00 00 00"]);
    rig.advance(125);
    rig.exchange("220: 0F 00 00 40", &["1A0: 0F 00 00 20"]);
    rig.advance(125);
    rig.exchange("220: 0F 00 00 40", &["1A0: 0F 00 00 40"]);
    // Nothing without an RPDO.
    rig.advance(200);
    rig.exchange("080:", &[]);
    rig.exchange("220: 00 00 00 40", &["1A0: 0B 00 00 40"]);
    rig.exchange("220: 00 00 00 40", &["1A0: 09 00 00 40"]);
    rig.exchange("220: 00 00 00 40", &["1A0: 08 00 00 40"]);
}

#[test]
fn pdos_are_for_operational_alone() {
    let mut rig = Rig::booted();
    rig.exchange("220: 0F 00 00 00", &[]);
    assert_eq!((rig.read(0x6041, 0), rig.read(0x6040, 0)), (0x08, 0));
    rig.exchange("000: 01 00", &[]);
    rig.exchange("220: 0F 00 00 00", &["1A0: 09 00 00 00"]);
    rig.silent_to(&["000: 80 00", "220: 0F 00 00 00"]);
    assert_eq!(rig.read(0x6041, 0), 0x09);
    rig.silent_to(&["000: 02 00", "220: 0F 00 00 00", "000: 01 00"]);
    // Stop has led to FAULT_HOLD.
    rig.exchange("220: 0F 00 00 00", &["1A0: 03 00 00 00"]);
}

/// INIT, DISABLED, HOLD, ACTIVE and FAULT_HOLD all send.
#[test]
fn a_tpdo_is_sent_in_every_device_state() {
    let mut rig = Rig::booted();
    rig.exchange("000: 01 00", &[]);
    rig.exchange("220: 00 00 00 00", &["1A0: 08 00 00 00"]);
    for (word, status) in [("01", "09"), ("03", "0B"), ("07", "0F")] {
        for _ in 0..2 {
            rig.exchange(&format!("220: {word} 00 00 00"), &[&format!("1A0: {status} 00 00 00")]);
        }
    }
    rig.sense(|inputs| inputs.internal_fault = true);
    rig.take();
    rig.exchange("220: 0F 00 00 00", &["1A0: 03 00 00 00"]);
}

/// Mode, control word, set-point: their order in the mapping does not matter.
#[test]
fn the_values_of_one_rpdo_act_in_their_own_order() {
    for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        let entries = order.map(|place| [MODE, CONTROL, SET_POINT][place]);
        let frame = |mode, word, set_point| {
            rpdo(&order.map(|place| [(MODE, mode), (CONTROL, word), (SET_POINT, set_point)][place]))
        };
        // From hand operation to full operational, to ACTIVE, and then the set-point of this RPDO acts.
        let mut rig = held(&entries);
        assert_eq!(rig.write(0x6042, 0, 1, 2), Ok(()));
        rig.exchange(&frame(1, 0x0F, 0x4000), &["1A0: 0F 00 00 00"]);
        rig.advance(125);
        assert_eq!(rig.read(0x6301, 1), 0x2000, "{entries:X?}");
        // To hand operation: the set-point acts no more.
        rig.exchange(&frame(2, 0x0F, 0x4000), &["1A0: 0F 00 00 20"]);
        rig.silent_for(500);
        assert_eq!((rig.read(0x6301, 1), rig.read(0x6300, 1), rig.read(0x6042, 0)), (0, 0x4000, 2), "{entries:X?}");
    }
}

#[test]
fn one_rpdo_is_one_transition() {
    let mut rig = Rig::booted();
    rig.map(RPDO, &[CONTROL, CONTROL, CONTROL]);
    rig.exchange("000: 01 00", &[]);
    let twice = rpdo(&[(CONTROL, 0x0F), (CONTROL, 0x0F), (CONTROL, 0x0F)]);
    for status in ["09", "0B", "0F"] {
        rig.exchange(&twice, &[&format!("1A0: {status} 00 00 00")]);
    }
}

#[test]
fn the_last_of_several_set_points_wins() {
    let mut rig = held(&[SET_POINT_8, SET_POINT, CONTROL, SET_POINT_16]);
    let frame =
        |eight, raw, sixteen| rpdo(&[(SET_POINT_8, eight), (SET_POINT, raw), (CONTROL, 0x0F), (SET_POINT_16, sixteen)]);
    for (eight, raw, sixteen, held) in [
        (0x7F, 0x2000, 1000, 0x4000),
        (0x7F, 0x2000, 0, 0),
        // The last valid one: 1001 is out of range …
        (0x7F, 0x2000, 1001, 0x2000),
        // … and so are 16385 and −1001,
        (0x7F, 16385, 0xFC17, 0x4000),
        // and −128: none is left, the set-point stays.
        (0x80, 16385, 0xFC17, 0x4000),
        (0x80, 32767, 1001, 32767),
    ] {
        rig.send(&frame(eight, raw, sixteen));
        assert_eq!(rig.take().len(), 1);
        assert_eq!(rig.read(0x6300, 1), held, "{eight:X} {raw:X} {sixteen:X}");
    }
}

#[test]
fn what_is_invalid_is_dropped_and_the_rest_acts() {
    let mut rig = held(&[MODE, SET_POINT, CONTROL]);
    let frame = |mode, set_point, word| rpdo(&[(MODE, mode), (SET_POINT, set_point), (CONTROL, word)]);
    // Neither mode nor set-point, and the control word leads to ACTIVE.
    for (mode, set_point) in [(0, 16385), (3, 0x8000), (0xFF, 0xBFFF), (1, 32766)] {
        rig.exchange(&frame(mode, set_point, 0x0F), &["1A0: 0F 00 00 00"]);
        assert_eq!((rig.read(0x6042, 0), rig.read(0x6300, 1)), (1, 0));
    }
    // An invalid mode, a valid set-point.
    rig.exchange(&frame(0, 0x4000, 0x0F), &["1A0: 0F 00 00 00"]);
    rig.advance(125);
    assert_eq!(rig.read(0x6301, 1), 0x2000);
    // An invalid set-point, a valid mode.
    rig.exchange(&frame(2, 16385, 0x0F), &["1A0: 0F 00 00 20"]);
    assert_eq!((rig.read(0x6042, 0), rig.read(0x6300, 1)), (2, 0x4000));
}

#[test]
fn an_invalid_set_point_does_not_feed_the_time_guard() {
    for (set_point, fed) in [("00 00", true), ("FF 7F", true), ("01 40", false), ("FF BF", false), ("FE 7F", false)] {
        let mut rig = Rig::active();
        rig.advance(200);
        rig.send(&format!("220: 0F 00 {set_point}"));
        rig.take();
        rig.silent_for(49);
        rig.advance(1);
        let faults = rig.take();
        assert_eq!(faults.is_empty(), fed, "{set_point}: {faults:?}");
    }
}

#[test]
fn a_short_rpdo_is_ignored_as_a_whole() {
    let mut rig = Rig::booted();
    rig.exchange("000: 01 00", &[]);
    for short in ["220:", "220: 0F", "220: 0F 00", "220: 0F 00 00"] {
        rig.exchange(short, &[]);
        assert_eq!((rig.read(0x6041, 0), rig.read(0x6040, 0)), (0x08, 0));
    }
    // It feeds no time guard either.
    rig.activate();
    rig.advance(200);
    rig.exchange("220: 0F 00 00", &[]);
    rig.advance(50);
    rig.expect("0A0: 03 80 91 01 00 00 00 00");
}

#[test]
fn a_long_rpdo_is_cut() {
    let mut rig = Rig::booted();
    rig.exchange("000: 01 00", &[]);
    rig.exchange("220: 0F 00 34 12 FF", &["1A0: 09 00 00 00"]);
    rig.exchange("220: 0F 00 34 12 FF FF FF FF", &["1A0: 0B 00 00 00"]);
    assert_eq!(rig.read(0x6300, 1), 0x1234);
}

#[test]
fn other_frames_are_no_rpdo() {
    let mut rig = Rig::booted();
    rig.exchange("000: 01 00", &[]);
    for other in [
        "220: R4",
        "220: R8",
        "1A0: R4",
        "1A0: R0",
        "00000220: 0F 00 00 00",
        "08800000: 0F 00 00 00",
        "221: 0F 00 00 00",
        "200: 0F 00 00 00",
        "320: 0F 00 00 00",
    ] {
        rig.exchange(other, &[]);
        assert_eq!(rig.read(0x6041, 0), 0x08, "{other}");
    }
}

#[test]
fn a_pdo_that_is_off_is_not_there() {
    let mut rig = Rig::booted();
    rig.exchange("000: 01 00", &[]);
    assert_eq!(rig.write(TPDO, 1, 4, 0x8000_01A0), Ok(()));
    rig.exchange("220: 0F 00 00 00", &[]);
    assert_eq!(rig.read(0x6041, 0), 0x09);
    assert_eq!(rig.write(TPDO, 1, 4, 0x0000_01A0), Ok(()));
    rig.exchange("220: 0F 00 00 00", &["1A0: 0B 00 00 00"]);
    assert_eq!(rig.write(RPDO, 1, 4, 0x8000_0220), Ok(()));
    rig.exchange("220: 0F 00 00 00", &[]);
    assert_eq!(rig.read(0x6041, 0), 0x0B);
}

/// An EMCY that falls due at the same instant goes out first, and the TPDO shows FAULT_HOLD.
#[test]
fn an_emcy_goes_before_the_tpdo_of_the_same_instant() {
    let mut rig = Rig::active();
    // The set-point of the very instant at which the time guard falls due comes too late.
    rig.leap_to(Duration::from_millis(250), "220: 0F 00 00 00");
    rig.expect_all(&["0A0: 03 80 91 01 00 00 00 00", "0A0: 00 00 00 00 00 00 00 00", "1A0: 03 00 00 00"]);
}
