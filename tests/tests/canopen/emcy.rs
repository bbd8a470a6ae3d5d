//! EMCY producer and consumer (SPEC 3, 4.2).

use protocol_core::actuator::SpoolFault;
use protocol_core::controller::BusErrorMode::{BusOff, ErrorActive};
use protocol_core::time::Duration;
use tests::{Inputs, Rig};

const NO_ERROR: &str = "0A0: 00 00 00 00 00 00 00 00";
const BOOT_UP: &str = "720: 00";

/// A fault that needs nothing of the device: how it comes and goes, after how long, and its row of SPEC 3.
struct Row {
    cause: fn(&mut Inputs),
    healthy: fn(&mut Inputs),
    delay_ms: u64,
    emcy: &'static str,
    register: u32,
    counter: u16,
}

const INTERNAL: Row = Row {
    cause: |inputs| inputs.internal_fault = true,
    healthy: |inputs| inputs.internal_fault = false,
    delay_ms: 0,
    emcy: "00 10 01",
    register: 0x01,
    counter: 0x2024,
};
const HOT: Row = Row {
    cause: |inputs| inputs.temperature_c = 121,
    healthy: |inputs| inputs.temperature_c = 25,
    delay_ms: 250,
    emcy: "01 83 09",
    register: 0x09,
    counter: 0x200F,
};
const COLD: Row = Row { cause: |inputs| inputs.temperature_c = -41, ..HOT };
const SUPPLY_HIGH: Row = Row {
    cause: |inputs| inputs.supply_mv = 36_001,
    healthy: |inputs| inputs.supply_mv = 24_000,
    delay_ms: 2000,
    emcy: "11 34 05",
    register: 0x05,
    counter: 0x2001,
};
const SUPPLY_LOW: Row =
    Row { cause: |inputs| inputs.supply_mv = 8_999, emcy: "12 34 05", counter: 0x2002, ..SUPPLY_HIGH };

const ROWS: [Row; 5] = [INTERNAL, HOT, COLD, SUPPLY_HIGH, SUPPLY_LOW];

/// Keeps an active valve fed with this set-point for so long.
fn feed(rig: &mut Rig, set_point: &str, ms: u64) {
    for _ in 0..ms / 50 {
        rig.send(&format!("220: 0F 00 {set_point}"));
        rig.advance(50);
    }
}

/// The EMCYs among what was sent.
fn emcys(rig: &mut Rig) -> Vec<String> {
    rig.take().into_iter().filter(|frame| frame.starts_with("0A0")).collect()
}

#[test]
fn a_fault_comes_counts_and_goes() {
    for row in ROWS {
        let mut rig = Rig::booted();
        for count in 1..=3 {
            rig.sense(row.cause);
            if row.delay_ms > 0 {
                rig.advance_by(Duration::from_micros(row.delay_ms * 1000 - 1));
                rig.expect_nothing();
                rig.advance_by(Duration::from_micros(1));
            }
            rig.expect(&format!("0A0: {} {count:02X} 00 00 00 00", row.emcy));
            rig.silent_for(10_000);
            assert_eq!((rig.read(0x1001, 0), rig.read(0x6041, 0)), (row.register, 0x03), "{}", row.emcy);
            assert_eq!(rig.read(row.counter, 0), count);
            rig.sense(row.healthy);
            rig.expect(NO_ERROR);
            rig.silent_for(10_000);
            assert_eq!((rig.read(0x1001, 0), rig.read(row.counter, 0)), (0, count));
        }
        if row.counter == INTERNAL.counter {
            assert_eq!(rig.read(0x2040, 0), 3, "the second index reads the same");
        }
    }
}

#[test]
fn no_set_point_in_time() {
    let mut rig = Rig::active();
    rig.advance(250);
    rig.expect("0A0: 03 80 91 01 00 00 00 00");
    assert_eq!((rig.read(0x1001, 0), rig.read(0x2023, 0)), (0x91, 1));
    rig.silent_for(10_000);
    // The next valid set-point ends it.
    rig.exchange("220: 00 00 00 00", &[NO_ERROR, "1A0: 03 00 00 00"]);
    assert_eq!((rig.read(0x1001, 0), rig.read(0x2023, 0)), (0, 1));
}

/// Both faults of the spool have one code and one counter.
#[test]
fn a_spool_that_does_not_follow() {
    let mut rig = Rig::active();
    feed(&mut rig, "00 40", 300);
    rig.take();
    rig.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
    feed(&mut rig, "00 C0", 500);
    assert_eq!(emcys(&mut rig), ["0A0: 05 83 21 01 00 00 00 00"]);
    assert_eq!((rig.read(0x1001, 0), rig.read(0x201D, 0)), (0x21, 1));
    // Freed, it springs to neutral: then it is gone.
    rig.sense(|inputs| inputs.spool.fault = SpoolFault::NoFloat);
    feed(&mut rig, "00 00", 200);
    assert_eq!(emcys(&mut rig), [NO_ERROR]);
    rig.send_all(&["220: 03 00 00 00", "220: 0B 00 00 00", "220: 0F 00 00 00"]);
    rig.take();
    feed(&mut rig, "FF 7F", 1000);
    assert_eq!(emcys(&mut rig), ["0A0: 05 83 21 02 00 00 00 00"]);
    assert_eq!(rig.read(0x201D, 0), 2);
}

#[test]
fn the_counter_stops_at_127() {
    let mut rig = Rig::booted();
    for count in 1..=130_u32 {
        rig.sense(INTERNAL.cause);
        rig.expect(&format!("0A0: 00 10 01 {:02X} 00 00 00 00", count.min(127)));
        rig.sense(INTERNAL.healthy);
        rig.expect(NO_ERROR);
    }
    assert_eq!(rig.read(0x2024, 0), 127);
}

#[test]
fn the_register_is_that_of_all_active_faults() {
    let mut rig = Rig::booted();
    rig.sense(SUPPLY_LOW.cause);
    rig.advance(2000);
    rig.expect("0A0: 12 34 05 01 00 00 00 00");
    rig.sense(HOT.cause);
    rig.advance(250);
    rig.expect("0A0: 01 83 0D 01 00 00 00 00");
    rig.sense(INTERNAL.cause);
    rig.expect("0A0: 00 10 0D 01 00 00 00 00");
    assert_eq!(rig.read(0x1001, 0), 0x0D);
    // Those that go before the last are not told.
    rig.sense(HOT.healthy);
    rig.expect_nothing();
    assert_eq!(rig.read(0x1001, 0), 0x05);
    rig.sense(SUPPLY_LOW.healthy);
    rig.expect_nothing();
    assert_eq!(rig.read(0x1001, 0), 0x01);
    rig.sense(INTERNAL.healthy);
    rig.expect_all(&[NO_ERROR]);
}

#[test]
fn several_at_once_are_told_by_priority() {
    let mut rig = Rig::booted();
    rig.sense(SUPPLY_LOW.cause);
    rig.advance(1750);
    rig.sense(HOT.cause);
    rig.advance_sends(250, &["0A0: 01 83 09 01 00 00 00 00", "0A0: 12 34 0D 01 00 00 00 00"]);
    assert_eq!(rig.read(0x1003, 1), 0x0001_3412, "the last one told is the newest");
    assert_eq!(rig.read(0x1003, 2), 0x0001_8301);
}

/// The register is that of 0x1001: one fault goes at the look at which another comes.
#[test]
fn a_fault_that_goes_when_another_comes_is_not_in_its_register() {
    let mut rig = Rig::booted();
    rig.sense(SUPPLY_LOW.cause);
    rig.advance(2000);
    rig.expect("0A0: 12 34 05 01 00 00 00 00");
    rig.sense(|inputs| {
        (SUPPLY_LOW.healthy)(inputs);
        (INTERNAL.cause)(inputs);
    });
    rig.expect_all(&["0A0: 00 10 01 01 00 00 00 00"]);
    assert_eq!(rig.read(0x1001, 0), 0x01);
    // Several come: those that stay are in it, each from its own EMCY on.
    rig.sense(SUPPLY_HIGH.cause);
    rig.advance(2000);
    rig.expect("0A0: 11 34 05 01 00 00 00 00");
    rig.sense(HOT.cause);
    rig.advance(249);
    rig.sense(|inputs| {
        (SUPPLY_HIGH.healthy)(inputs);
        (INTERNAL.healthy)(inputs);
    });
    rig.expect(NO_ERROR);
    rig.sense(|inputs| inputs.bus = BusOff);
    rig.advance(1);
    rig.sense(|inputs| inputs.bus = ErrorActive);
    assert_eq!(rig.take(), ["0A0: 40 81 11 01 00 00 00 00", "0A0: 01 83 19 01 00 00 00 00"]);
}

#[test]
fn both_of_an_injected_fault_and_bus_off_at_once() {
    let mut rig = Rig::booted();
    rig.sense(|inputs| {
        inputs.internal_fault = true;
        inputs.bus = BusOff;
    });
    rig.expect_nothing();
    rig.sense(|inputs| inputs.bus = ErrorActive);
    assert_eq!(rig.take(), ["0A0: 00 10 01 01 00 00 00 00", "0A0: 40 81 11 01 00 00 00 00"]);
    assert_eq!(rig.read(0x1001, 0), 0x01);
}

#[test]
fn a_cause_at_power_up_activates_from_init_after_its_delay() {
    let mut rig = Rig::booted();
    rig.sense(SUPPLY_LOW.cause);
    rig.power_cycle_sends(&[BOOT_UP, NO_ERROR]);
    assert_eq!(rig.read(0x6041, 0), 0x08);
    rig.silent_until(2_000, &["0A0: 12 34 05 01 00 00 00 00"]);
    assert_eq!(rig.read(0x6041, 0), 0x03);
}

#[test]
fn bus_off_is_told_when_the_bus_is_back() {
    for start in ["000: 80 00", "000: 01 00"] {
        let mut rig = Rig::booted();
        rig.send(start);
        rig.sense(|inputs| inputs.bus = BusOff);
        rig.silent_for(500);
        rig.sense_sends(|inputs| inputs.bus = ErrorActive, &["0A0: 40 81 11 01 00 00 00 00", NO_ERROR]);
        assert_eq!((rig.read(0x2019, 0), rig.read(0x6041, 0)), (1, 0x03));
        // The NMT state is what it was.
        assert_eq!(rig.write(0x1017, 0, 2, 1000), Ok(()));
        rig.expect(if start == "000: 01 00" { "720: 05" } else { "720: 7F" });
    }
}

#[test]
fn bus_off_while_another_fault_is_active() {
    let mut rig = Rig::booted();
    rig.sense(INTERNAL.cause);
    rig.expect("0A0: 00 10 01 01 00 00 00 00");
    rig.sense(|inputs| inputs.bus = BusOff);
    rig.sense_sends(|inputs| inputs.bus = ErrorActive, &["0A0: 40 81 11 01 00 00 00 00"]);
    rig.sense(INTERNAL.healthy);
    rig.expect(NO_ERROR);
}

#[test]
fn in_stopped_an_emcy_is_logged_and_counted_and_never_sent() {
    let mut rig = Rig::booted();
    rig.exchange("000: 02 00", &[]);
    rig.sense(INTERNAL.cause);
    rig.silent_for(1000);
    rig.exchange("000: 80 00", &[]);
    assert_eq!((rig.read(0x1001, 0), rig.read(0x2024, 0)), (0x01, 1));
    assert_eq!((rig.read(0x1003, 0), rig.read(0x1003, 1)), (1, 0x0001_1000));
    rig.expect_nothing();
    rig.sense(INTERNAL.healthy);
    rig.expect(NO_ERROR);
    // Nor does its end come later.
    rig.sense(INTERNAL.cause);
    rig.expect("0A0: 00 10 01 02 00 00 00 00");
    rig.exchange("000: 02 00", &[]);
    rig.sense(INTERNAL.healthy);
    rig.exchange("000: 01 00", &[]);
    rig.silent_for(1000);
    assert_eq!(rig.read(0x1001, 0), 0);
}

#[test]
fn after_reset_communication_what_is_active_is_told_again_and_not_counted() {
    let mut rig = Rig::booted();
    rig.sense(SUPPLY_LOW.cause);
    rig.advance(2000);
    rig.sense(INTERNAL.cause);
    assert_eq!(rig.take(), ["0A0: 12 34 05 01 00 00 00 00", "0A0: 00 10 05 01 00 00 00 00"]);
    rig.exchange(
        "000: 82 00",
        // By priority, each with the register as it is: both are active already.
        &[BOOT_UP, NO_ERROR, "0A0: 00 10 05 01 00 00 00 00", "0A0: 12 34 05 01 00 00 00 00"],
    );
    assert_eq!((rig.read(0x2024, 0), rig.read(0x2002, 0), rig.read(0x1003, 0)), (1, 1, 2));
    assert_eq!((rig.read(0x1001, 0), rig.read(0x6041, 0)), (0x05, 0x03));
    rig.sense(SUPPLY_LOW.healthy);
    rig.sense(INTERNAL.healthy);
    rig.expect_all(&[NO_ERROR]);
    // With nothing active, nothing follows.
    rig.exchange("000: 82 00", &[BOOT_UP, NO_ERROR]);
}

#[test]
fn after_reset_application_what_lasts_is_found_and_counted_anew() {
    let mut rig = Rig::booted();
    rig.sense(SUPPLY_LOW.cause);
    rig.advance(2000);
    rig.expect("0A0: 12 34 05 01 00 00 00 00");
    rig.exchange("000: 81 00", &[BOOT_UP, NO_ERROR]);
    assert_eq!((rig.read(0x1001, 0), rig.read(0x6041, 0)), (0, 0x08));
    rig.silent_until(2_000, &["0A0: 12 34 05 02 00 00 00 00"]);
}

const EMERGENCY_STOP: &str = "0A1: 00 10 01 05 00 00 00 00";

/// Listens for the EMCY of node 0x21, and is in ACTIVE.
fn listening() -> Rig {
    let mut rig = Rig::booted();
    assert_eq!(rig.write(0x1028, 1, 4, 0xA1), Ok(()));
    rig.activate();
    rig
}

#[test]
fn an_emergency_stop_from_another_node() {
    let mut rig = listening();
    feed(&mut rig, "00 40", 300);
    rig.take();
    rig.exchange(EMERGENCY_STOP, &[]);
    assert!(!rig.outputs().solenoids);
    // It is no fault of this device.
    assert_eq!((rig.read(0x1001, 0), rig.read(0x1003, 0)), (0, 0));
    for counter in [0x2001, 0x2002, 0x200F, 0x2019, 0x201D, 0x2023, 0x2024, 0x2040] {
        assert_eq!(rig.read(counter, 0), 0);
    }
    rig.exchange("220: 0F 00 00 40", &["1A0: 03 00 00 40"]);
    rig.silent_for(1000);
    // D11 leads out at once.
    rig.exchange("220: 03 00 00 00", &["1A0: 03 00 00 00"]);
    rig.exchange("220: 0B 00 00 00", &["1A0: 0B 00 00 00"]);
}

#[test]
fn it_comes_before_an_rpdo_and_a_sync_with_its_identifier() {
    for (index, sub) in [(0x1400, 1), (0x1005, 0)] {
        let mut rig = listening();
        if index == 0x1400 {
            assert_eq!(rig.write(index, sub, 4, 0x8000_0220), Ok(()));
        }
        assert_eq!(rig.write(index, sub, 4, 0xA1), Ok(()));
        rig.exchange(EMERGENCY_STOP, &[]);
        assert_eq!(rig.read(0x6041, 0), 0x03, "{index:04X}");
    }
}

#[test]
fn in_either_device_mode_and_in_pre_operational_too() {
    for mode in [1, 2] {
        for state in ["000: 01 00", "000: 80 00"] {
            let mut rig = listening();
            assert_eq!(rig.write(0x6042, 0, 1, mode), Ok(()));
            rig.silent_to(&[state, EMERGENCY_STOP]);
            assert_eq!(rig.read(0x6041, 0), 0x03, "mode {mode}, {state}");
        }
    }
}

#[test]
fn in_other_device_states_it_is_ignored() {
    let mut rig = Rig::booted();
    assert_eq!(rig.write(0x1028, 1, 4, 0xA1), Ok(()));
    rig.exchange("000: 01 00", &[]);
    for (word, status) in [("00", "08"), ("01", "09"), ("03", "0B")] {
        rig.exchange(&format!("220: {word} 00 00 00"), &[&format!("1A0: {status} 00 00 00")]);
        rig.exchange(EMERGENCY_STOP, &[]);
        assert_eq!(format!("{:02X}", rig.read(0x6041, 0)), status);
    }
}

#[test]
fn what_is_no_emergency_stop() {
    for other in [
        "0A1: 00 00 00 00 00 00 00 00",
        "0A1: 01 10 01 00 00 00 00 00",
        "0A1: 00 20 01 00 00 00 00 00",
        "0A1: 10 00 01 00 00 00 00 00",
        "0A1: 12 34 05 01 00 00 00 00",
        "0A1: 00 10",
        "0A1: 00 10 01 05 00 00 00",
        "0A1: R8",
        "0A2: 00 10 01 05 00 00 00 00",
        "080: 00 10 01 05 00 00 00 00",
        "000000A1: 00 10 01 05 00 00 00 00",
    ] {
        let mut rig = listening();
        rig.exchange(other, &[]);
        assert_eq!(rig.read(0x6041, 0), 0x0F, "{other}");
    }
}

#[test]
fn the_consumer_is_off_until_it_is_configured() {
    for cob_id in [0x8000_0000, 0x8000_00A1, 0x0000_00A2] {
        let mut rig = listening();
        assert_eq!(rig.write(0x1028, 1, 4, cob_id), Ok(()));
        rig.exchange(EMERGENCY_STOP, &[]);
        assert_eq!(rig.read(0x6041, 0), 0x0F);
        // Changed at any time, in force at once.
        assert_eq!(rig.write(0x1028, 1, 4, 0x4000_00A1), Ok(()));
        rig.exchange(EMERGENCY_STOP, &[]);
        assert_eq!(rig.read(0x6041, 0), 0x03);
    }
}
