//! Heartbeat producer, and the boot-up that counts as its first (SPEC 4.1 row 0x1017, 4.2).

use protocol_core::time::Duration;
use tests::Rig;

const TIME: (u16, u8) = (0x1017, 0);

fn set(rig: &mut Rig, ms: u32) {
    assert_eq!(rig.write(TIME.0, TIME.1, 2, ms), Ok(()));
}

#[test]
fn off_by_default() {
    let mut rig = Rig::booted();
    rig.silent_for(100_000);
}

/// (R) the manual's example, which calls it 1000 ms: the unit is 1 ms.
#[test]
fn the_manuals_example() {
    let mut rig = Rig::booted();
    rig.exchange("620: 2B 17 10 00 64 00 00 00", &["5A0: 60 17 10 00 00 00 00 00", "720: 7F"]);
    for _ in 0..20 {
        rig.silent_until(100, &["720: 7F"]);
    }
}

#[test]
fn the_period_is_rounded_up_to_10_ms_and_reads_back_as_written() {
    for (written, period) in
        [(1, 10), (9, 10), (10, 10), (11, 20), (99, 100), (105, 110), (1000, 1000), (1001, 1010), (0x7FFF, 32_770)]
    {
        let mut rig = Rig::booted();
        set(&mut rig, written);
        rig.expect("720: 7F");
        for _ in 0..3 {
            rig.silent_until(period, &["720: 7F"]);
        }
        assert_eq!(rig.read(TIME.0, TIME.1), written);
    }
}

#[test]
fn every_write_of_a_time_begins_at_once_and_0_ends_it() {
    let mut rig = Rig::booted();
    set(&mut rig, 100);
    rig.expect("720: 7F");
    rig.advance(30);
    set(&mut rig, 50);
    rig.expect("720: 7F");
    rig.silent_until(50, &["720: 7F"]);
    rig.advance(30);
    set(&mut rig, 50);
    rig.expect("720: 7F");
    rig.silent_until(50, &["720: 7F"]);
    // A time that is refused changes nothing.
    rig.advance(20);
    assert_eq!(rig.write(TIME.0, TIME.1, 2, 0x8000), Err(0x0609_0031));
    rig.silent_until(30, &["720: 7F"]);
    set(&mut rig, 0);
    rig.silent_for(100_000);
}

#[test]
fn it_tells_the_nmt_state_and_keeps_its_pace() {
    let mut rig = Rig::booted();
    set(&mut rig, 100);
    rig.expect("720: 7F");
    for (command, state) in [
        ("000: 01 00", "05"),
        ("000: 02 00", "04"),
        ("000: 02 00", "04"),
        ("000: 80 00", "7F"),
        ("000: 01 20", "05"),
        ("000: 80 20", "7F"),
        ("000: 02 20", "04"),
        ("000: 01 21", "04"),
    ] {
        rig.advance(60);
        rig.exchange(command, &[]);
        rig.silent_until(40, &[&format!("720: {state}")]);
    }
}

#[test]
fn the_boot_up_counts_as_the_first() {
    let boot = ["720: 00", "0A0: 00 00 00 00 00 00 00 00"];
    let mut rig = Rig::booted();
    set(&mut rig, 195);
    rig.expect("720: 7F");
    rig.exchange("620: 23 10 10 01 73 61 76 65", &["5A0: 60 10 10 01 00 00 00 00"]);
    for reset in ["000: 81 00", "000: 82 00"] {
        rig.advance(70);
        rig.exchange(reset, &boot);
        for _ in 0..3 {
            rig.silent_until(200, &["720: 7F"]);
        }
        assert_eq!(rig.read(TIME.0, TIME.1), 195);
    }
    rig.advance(70);
    rig.power_cycle_sends(&boot);
    rig.silent_until(200, &["720: 7F"]);
}

/// After a pause one heartbeat goes out, whatever was missed; the pace is kept, or begins anew after a whole period.
#[test]
fn a_late_poll() {
    for (late, until_next) in [(30, 70), (99, 1), (100, 100), (250, 100)] {
        let mut rig = Rig::booted();
        set(&mut rig, 100);
        rig.expect("720: 7F");
        rig.leap(Duration::from_millis(100 + late));
        rig.expect_all(&["720: 7F"]);
        rig.silent_until(until_next, &["720: 7F"]);
    }
}

/// A valve whose reset waits for the memory is no node of the bus any more.
#[test]
fn none_while_a_reset_waits() {
    for reset in ["000: 81 00", "000: 82 00"] {
        let mut rig = Rig::booted();
        set(&mut rig, 100);
        rig.expect("720: 7F");
        rig.write_time = Duration::from_secs(1);
        rig.silent_to(&["620: 23 10 10 01 73 61 76 65", reset]);
        rig.silent_until(1_000, &["720: 00", "0A0: 00 00 00 00 00 00 00 00"]);
    }
}

#[test]
fn a_time_that_was_not_stored_is_gone_with_a_reset() {
    for reset in ["000: 81 00", "000: 82 00"] {
        let mut rig = Rig::booted();
        set(&mut rig, 100);
        rig.expect("720: 7F");
        rig.exchange(reset, &["720: 00", "0A0: 00 00 00 00 00 00 00 00"]);
        assert_eq!(rig.read(TIME.0, TIME.1), 0);
        rig.silent_for(10_000);
    }
}

#[test]
fn what_falls_into_bus_off_is_not_sent_afterwards() {
    use protocol_core::controller::BusErrorMode::{BusOff, ErrorActive};
    let mut rig = Rig::booted();
    set(&mut rig, 100);
    rig.expect("720: 7F");
    rig.sense(|senses| senses.bus = BusOff);
    rig.advance(350);
    rig.sense(|senses| senses.bus = ErrorActive);
    assert_eq!(rig.take(), ["0A0: 40 81 11 01 00 00 00 00", "0A0: 00 00 00 00 00 00 00 00"]);
    rig.silent_until(50, &["720: 7F"]);
}

/// No node guarding, and no consumer.
#[test]
fn nobody_is_guarded() {
    let mut rig = Rig::booted();
    for request in ["720: R1", "720: R0", "720: R8", "721: 05", "720: 05", "701: 00"] {
        rig.exchange(request, &[]);
    }
    rig.silent_for(10_000);
}
