//! Whoever uses the valve's source address hears its claim (ISO 11783-5; SPEC 5).

use tests::Rig;
use tests::isobus::{BLOCK, CLAIM, HIGHER_NAME, LOWER_NAME};

/// J1939 frames under the valve's source address: what it takes itself, what it sends itself, and what it knows nothing
/// of.
const FOREIGN: [&str; 9] = [
    "18FECA83: 00 FF 00 00 00 00 FF FF",
    "0CFE1383: 7D 7D 30 FF FF FF FF FF",
    "18E8FF83: 00 FF FF FF 27 CC FE 00",
    "1CEBFF83: 01 01 00 20 07 08 FF 02",
    "1CECFF83: 20 09 00 02 FF D8 FE 00",
    "18EF2783: 01 02 03",
    "1CFFFF83:",
    // Data page 1, and the extended one alone.
    "19FECA83: 00 FF 00 00 00 00 FF FF",
    "1AFECA83: 00 FF 00 00 00 00 FF FF",
];

/// Not a J1939 frame under its address: a UDS request, whose identifier ends alike; 11 bits; a claim; another's.
const OTHER: [&str; 6] = [
    "1BC78983: 03 22 F0 10",
    "1BC00083:",
    "083: 00 FF 00 00 00 00 FF FF",
    "783: 00 FF 00 00 00 00 FF FF",
    "18FECA84: 00 FF 00 00 00 00 FF FF",
    "18FE8327: 00 FF 00 00 00 00 FF FF",
];

#[test]
fn a_foreign_frame_is_answered_by_a_claim() {
    for frame in FOREIGN {
        let mut valve = Rig::claimed();
        valve.send(frame);
        assert_eq!(valve.take_news(), [CLAIM], "{frame}");
        assert_eq!(valve.node_id(), Some(0x83));
    }
}

/// One claim in 5 s, whatever comes.
#[test]
fn not_again_for_five_seconds() {
    let mut valve = Rig::claimed();
    valve.exchange(FOREIGN[0], &[CLAIM]);
    for _ in 0..49 {
        valve.advance(100);
        for frame in FOREIGN {
            valve.send(frame);
        }
    }
    valve.advance(99);
    valve.send(FOREIGN[0]);
    valve.expect_news(&[]);
    valve.advance(1);
    valve.send(FOREIGN[0]);
    valve.expect_news(&[CLAIM]);
    // Other reasons to claim are another matter.
    valve.send_all(&[HIGHER_NAME, "18EAFF27: 00 EE 00"]);
    valve.expect_news(&[CLAIM, CLAIM]);
}

/// A request under its own address is answered, and so is the one who took it; an AVC acts.
#[test]
fn it_is_served_all_the_same() {
    let mut valve = Rig::claimed();
    valve.send("18EA8383: CB FE 00");
    let mut sent = valve.take_news();
    sent.sort();
    assert_eq!(sent, [CLAIM, "18FECB83: 00 FF 00 00 00 00 FF FF"]);
    valve.advance_cyclic(5000, BLOCK);
    valve.take();
    valve.send("0CFE3383: FA FF 31 FF FF FF FF FF");
    valve.expect_news(&[CLAIM]);
    assert_eq!(valve.flow()[2], 0x31);
}

#[test]
fn what_is_no_use_of_its_address() {
    for frame in OTHER {
        let mut valve = Rig::claimed();
        valve.send(frame);
        assert_eq!(valve.take_news(), [""; 0], "{frame}");
    }
}

/// After the claim wait, and never without the address.
#[test]
fn not_while_it_has_no_address() {
    let mut valve = Rig::claimed();
    valve.power_cycle();
    valve.expect(CLAIM);
    valve.advance(249);
    for frame in FOREIGN {
        valve.exchange(frame, &[]);
    }
    valve.advance(1);
    valve.send(LOWER_NAME);
    valve.advance(200);
    valve.take();
    for frame in FOREIGN {
        valve.exchange(frame, &[]);
    }
}
