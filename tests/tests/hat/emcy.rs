//! Every EMCY with its register, its entry in 0x1003, and its end (SPEC 9).

use protocol_core::controller::BusErrorMode;
use protocol_core::device::hat::{Hat, Kind, Setup};
use protocol_core::device::{Device as _, Inputs, StartCause, Viewable as _};
use protocol_core::memory::{Image, RecordKey};
use protocol_core::time::{Duration, Instant};
use tests::{Rig, lss, sdo};

use super::{SAVE, blank, booted};

const SET_UP: &str = "081: 00 FF 81 01 00 00 00 00";
const CONTROLLER: &str = "081: 00 FF 81 02 00 00 00 00";
const PASSIVE: &str = "081: 20 81 11 03 00 00 00 00";
const RECOVERED: &str = "081: 40 81 11 04 00 00 00 00";
const GONE: &str = "081: 00 00 00 00 00 00 00 00";
const BOOT_UP: &str = "701: 00";

fn internal_fault(rig: &mut Rig, there: bool) {
    rig.sense_hat(|inputs| inputs.internal_fault = there);
}

fn bus(rig: &mut Rig, mode: BusErrorMode) {
    rig.sense_hat(|inputs| inputs.bus = mode);
}

/// What 0x1003 holds, the newest first.
fn history(rig: &mut Rig) -> Vec<u32> {
    (1..=rig.read(0x1003, 0)).map(|sub| rig.read(0x1003, u8::try_from(sub).unwrap())).collect()
}

#[test]
fn a_controller_error() {
    let mut rig = booted();
    internal_fault(&mut rig, true);
    assert_eq!(rig.take(), [CONTROLLER]);
    assert_eq!((rig.read(0x1001, 0), history(&mut rig)), (0x81, vec![0x0002_FF00]));
    internal_fault(&mut rig, false);
    assert_eq!(rig.take(), [GONE]);
    assert_eq!((rig.read(0x1001, 0), history(&mut rig)), (0, vec![0x0002_FF00]), "no 0000");
}

#[test]
fn error_passive() {
    let mut rig = booted();
    bus(&mut rig, BusErrorMode::ErrorPassive);
    assert_eq!(rig.take(), [PASSIVE]);
    assert_eq!((rig.read(0x1001, 0), history(&mut rig)), (0x11, vec![0x0003_8120]));
    bus(&mut rig, BusErrorMode::ErrorActive);
    assert_eq!(rig.take(), [GONE]);
    assert_eq!(rig.read(0x1001, 0), 0);
}

#[test]
fn bus_off_is_told_when_it_is_over() {
    let mut rig = booted();
    bus(&mut rig, BusErrorMode::BusOff);
    rig.silent_for(100);
    bus(&mut rig, BusErrorMode::ErrorActive);
    assert_eq!(rig.take(), [RECOVERED, GONE]);
    assert_eq!((rig.read(0x1001, 0), history(&mut rig)), (0, vec![0x0004_8140]));
}

#[test]
fn a_reset_during_bus_off_does_not_tell_the_recovery_twice() {
    let mut rig = booted();
    rig.write_time = Duration::from_millis(10);
    rig.send_all(&[&sdo::write(1, 0x1010, 2, b"save"), "000: 82 00"]);
    bus(&mut rig, BusErrorMode::BusOff);
    rig.silent_for(20);
    bus(&mut rig, BusErrorMode::ErrorActive);
    assert_eq!(rig.take(), [BOOT_UP, RECOVERED, GONE]);
    assert_eq!(history(&mut rig), [0x0004_8140]);
}

#[test]
fn an_error_passive_that_was_not_told_before_bus_off_is_dropped() {
    let mut rig = booted();
    rig.hold_bus(true);
    bus(&mut rig, BusErrorMode::ErrorPassive);
    bus(&mut rig, BusErrorMode::BusOff);
    rig.hold_bus(false);
    bus(&mut rig, BusErrorMode::ErrorActive);
    assert_eq!(rig.take(), [RECOVERED, GONE]);
    assert_eq!(history(&mut rig), [0x0004_8140], "and not logged");
    // One that was told stays.
    bus(&mut rig, BusErrorMode::ErrorPassive);
    bus(&mut rig, BusErrorMode::BusOff);
    bus(&mut rig, BusErrorMode::ErrorPassive);
    assert_eq!(rig.take(), [PASSIVE, RECOVERED, GONE, PASSIVE]);
    assert_eq!(history(&mut rig), [0x0003_8120, 0x0004_8140, 0x0003_8120, 0x0004_8140]);
}

#[test]
fn every_error_passive_that_was_not_told_before_bus_off_is_unlogged() {
    let mut rig = booted();
    rig.hold_bus(true);
    for mode in
        [BusErrorMode::ErrorPassive, BusErrorMode::ErrorActive, BusErrorMode::ErrorPassive, BusErrorMode::BusOff]
    {
        bus(&mut rig, mode);
    }
    rig.hold_bus(false);
    bus(&mut rig, BusErrorMode::ErrorActive);
    assert_eq!(rig.take(), [RECOVERED, GONE], "nor is the end of one told");
    assert_eq!(history(&mut rig), [0x0004_8140], "only what an EMCY told");
}

#[test]
fn bus_off_withdraws_the_end_of_error_passive_with_its_begin_and_no_other_end() {
    use BusErrorMode::{BusOff, ErrorActive, ErrorPassive};
    // The end of one that was told is told, the end of one that was not told is not.
    let mut rig = booted();
    bus(&mut rig, ErrorPassive);
    assert_eq!(rig.take(), [PASSIVE]);
    rig.hold_bus(true);
    for mode in [ErrorActive, ErrorPassive, ErrorActive, BusOff] {
        bus(&mut rig, mode);
    }
    rig.hold_bus(false);
    bus(&mut rig, ErrorActive);
    assert_eq!(rig.take(), [GONE, RECOVERED, GONE]);
    assert_eq!(history(&mut rig), [0x0004_8140, 0x0003_8120], "the one that was told");
    // Nor is the end of another error withdrawn, neither before error-passive is over nor after.
    let mut rig = booted();
    rig.hold_bus(true);
    internal_fault(&mut rig, true);
    bus(&mut rig, ErrorPassive);
    internal_fault(&mut rig, false);
    bus(&mut rig, ErrorActive);
    internal_fault(&mut rig, true);
    internal_fault(&mut rig, false);
    bus(&mut rig, BusOff);
    rig.hold_bus(false);
    bus(&mut rig, ErrorActive);
    let passive_then = "081: 00 00 11 00 00 00 00 00";
    assert_eq!(rig.take(), [CONTROLLER, passive_then, CONTROLLER, GONE, RECOVERED, GONE]);
    assert_eq!(history(&mut rig), [0x0004_8140, 0x0002_FF00, 0x0002_FF00]);
    // An error that lasts: what remained when error-passive was over is known already.
    let mut rig = booted();
    internal_fault(&mut rig, true);
    assert_eq!(rig.take(), [CONTROLLER]);
    rig.hold_bus(true);
    for mode in [ErrorPassive, ErrorActive, BusOff] {
        bus(&mut rig, mode);
    }
    rig.hold_bus(false);
    bus(&mut rig, ErrorActive);
    assert_eq!(rig.take(), ["081: 40 81 91 04 00 00 00 00", "081: 00 00 81 00 00 00 00 00"]);
}

/// An 8120 that an EMCY told stays in 0x1003, whatever becomes of its repetition after reset communication.
#[test]
fn bus_off_that_withdraws_a_repetition_leaves_the_history_alone() {
    use BusErrorMode::{BusOff, ErrorActive, ErrorPassive};
    for later in [&[][..], &[ErrorActive], &[ErrorActive, ErrorPassive], &[ErrorActive, ErrorPassive, ErrorActive]] {
        let mut rig = booted();
        bus(&mut rig, ErrorPassive);
        assert_eq!(rig.take(), [PASSIVE]);
        rig.hold_bus(true);
        rig.send("000: 82 00");
        for mode in later.iter().chain([&BusOff]) {
            bus(&mut rig, *mode);
        }
        rig.hold_bus(false);
        bus(&mut rig, ErrorActive);
        assert_eq!(rig.take(), [BOOT_UP, RECOVERED, GONE], "after {later:?}");
        assert_eq!(history(&mut rig), [0x0004_8140, 0x0003_8120], "after {later:?}");
    }
}

/// What waits for the bus goes with the restart; what lasts is told again, and each error is entered once.
#[test]
fn a_reset_during_bus_off_and_the_emcys_that_wait() {
    for (lasts, told) in [(true, &[BOOT_UP, "081: 00 FF 91 02 00 00 00 00"][..]), (false, &[BOOT_UP])] {
        let mut rig = booted();
        rig.write_time = Duration::from_millis(10);
        rig.send_all(&[&sdo::write(1, 0x1010, 2, b"save"), "000: 82 00"]);
        bus(&mut rig, BusErrorMode::BusOff);
        internal_fault(&mut rig, true);
        internal_fault(&mut rig, lasts);
        rig.silent_for(20);
        bus(&mut rig, BusErrorMode::ErrorActive);
        let end =
            if lasts { ["081: 40 81 91 04 00 00 00 00", "081: 00 00 81 00 00 00 00 00"] } else { [RECOVERED, GONE] };
        assert_eq!(rig.take(), [told, &end].concat());
        assert_eq!(history(&mut rig), [0x0004_8140, 0x0002_FF00]);
    }
}

#[test]
fn a_watchdog_reset() {
    let mut rig = booted();
    rig.watchdog_reset();
    assert_eq!(rig.take(), [BOOT_UP, CONTROLLER, GONE]);
    assert_eq!((rig.read(0x1001, 0), history(&mut rig)), (0, vec![0x0002_FF00]));
    // With an injected fault that lasts.
    internal_fault(&mut rig, true);
    rig.take();
    rig.watchdog_reset();
    assert_eq!(rig.take(), [BOOT_UP, CONTROLLER, GONE, CONTROLLER]);
}

#[test]
fn every_disappearance_is_told_with_what_remains() {
    let mut rig = booted();
    internal_fault(&mut rig, true);
    bus(&mut rig, BusErrorMode::ErrorPassive);
    assert_eq!(rig.take(), [CONTROLLER, "081: 20 81 91 03 00 00 00 00"]);
    assert_eq!(rig.read(0x1001, 0), 0x91);
    internal_fault(&mut rig, false);
    assert_eq!(rig.take(), ["081: 00 00 11 00 00 00 00 00"]);
    bus(&mut rig, BusErrorMode::ErrorActive);
    assert_eq!(rig.take(), [GONE]);
}

#[test]
fn errors_of_one_instant_are_told_in_their_order() {
    let mut rig = booted();
    rig.sense_hat(|inputs| (inputs.internal_fault, inputs.bus) = (true, BusErrorMode::ErrorPassive));
    assert_eq!(rig.take(), [CONTROLLER, "081: 20 81 91 03 00 00 00 00"]);
    // A reset of the communication tells those that it leaves in the same order.
    rig.save(2);
    rig.records.get_mut(&RecordKey::Parameters).unwrap()[2] ^= 1;
    rig.sense_hat(|inputs| inputs.bus = BusErrorMode::ErrorActive);
    rig.power_cycle();
    assert_eq!(rig.take()[..2], [BOOT_UP, SET_UP]);
    rig.exchange("000: 82 00", &[BOOT_UP, SET_UP, CONTROLLER]);
}

#[test]
fn a_damaged_record_is_told_after_the_boot_up_and_ends_when_it_is_written() {
    for (key, save, load) in [
        (RecordKey::LocalLayer, (0x1010, 4), (0x1011, 4)),
        (RecordKey::Parameters, (0x1010, 2), (0x1011, 2)),
        (RecordKey::Application, (0x1010, 3), (0x1011, 3)),
    ] {
        for ((index, sub), signature) in [(save, b"save"), (load, b"load")] {
            let mut rig = booted();
            for sub in 2..=4 {
                rig.save(sub);
            }
            rig.records.get_mut(&key).unwrap()[2] ^= 1;
            for restart in 0..3 {
                match restart {
                    0 => rig.power_cycle(),
                    1 => rig.send("000: 81 00"),
                    _ => rig.send("000: 82 00"),
                }
                assert_eq!(rig.take(), [BOOT_UP, SET_UP], "{key:?}");
                assert_eq!((rig.read(0x1001, 0), history(&mut rig)), (0x81, vec![0x0001_FF00]), "entered once");
            }
            rig.exchange(&sdo::write(1, index, sub, signature), &[GONE, &sdo::written(1, index, sub)]);
            rig.power_cycle_sends(&[BOOT_UP]);
        }
    }
}

#[test]
fn two_damaged_records_are_one_error() {
    let mut rig = booted();
    rig.save(1);
    for key in [RecordKey::Parameters, RecordKey::Application] {
        rig.records.get_mut(&key).unwrap().truncate(3);
    }
    rig.power_cycle_sends(&[BOOT_UP, SET_UP]);
    rig.save(2);
    assert_eq!(rig.read(0x1001, 0), 0x81);
    rig.exchange(&sdo::write(1, 0x1010, 3, b"save"), &[GONE, &sdo::written(1, 0x1010, 3)]);
}

#[test]
fn a_damaged_memory_lasts_to_the_next_start() {
    let mut rig = booted();
    rig.memory_damaged = true;
    rig.power_cycle_sends(&[BOOT_UP, SET_UP]);
    rig.save(1);
    assert_eq!(rig.read(0x1001, 0), 0x81);
    rig.memory_damaged = false;
    rig.power_cycle_sends(&[BOOT_UP]);
}

/// A memory tells once that it was damaged, and the error lasts all the same.
#[test]
fn a_damaged_memory_lasts_over_reset_communication() {
    let mut rig = booted();
    rig.memory_damaged = true;
    rig.power_cycle_sends(&[BOOT_UP, SET_UP]);
    rig.memory_damaged = false;
    for _ in 0..2 {
        rig.exchange("000: 82 00", &[BOOT_UP, SET_UP]);
        rig.save(1);
        assert_eq!((rig.read(0x1001, 0), history(&mut rig)), (0x81, vec![0x0001_FF00]), "entered once");
    }
    rig.exchange("000: 81 00", &[BOOT_UP]);
    assert_eq!(rig.read(0x1001, 0), 0);
}

#[test]
fn errors_that_reset_communication_leaves_are_told_again_and_not_entered_again() {
    let mut rig = booted();
    internal_fault(&mut rig, true);
    bus(&mut rig, BusErrorMode::ErrorPassive);
    rig.take();
    rig.exchange("000: 82 00", &[BOOT_UP, "081: 00 FF 91 02 00 00 00 00", "081: 20 81 91 03 00 00 00 00"]);
    assert_eq!(history(&mut rig), [0x0003_8120, 0x0002_FF00]);
    // Reset node finds them anew.
    rig.exchange("000: 81 00", &[BOOT_UP, CONTROLLER, "081: 20 81 91 03 00 00 00 00"]);
    assert_eq!(history(&mut rig), [0x0003_8120, 0x0002_FF00]);
}

#[test]
fn an_error_that_no_emcy_could_tell_is_entered_when_reset_communication_tells_it() {
    let mut rig = booted();
    internal_fault(&mut rig, true);
    internal_fault(&mut rig, false);
    rig.take();
    assert_eq!(rig.write(0x1014, 0, 4, 0x8000_0081), Ok(()));
    internal_fault(&mut rig, true);
    rig.exchange("000: 82 00", &[BOOT_UP, CONTROLLER]);
    assert_eq!(history(&mut rig), [0x0002_FF00; 2]);
    rig.exchange("000: 82 00", &[BOOT_UP, CONTROLLER]);
    assert_eq!(history(&mut rig), [0x0002_FF00; 2], "once");
    // A sensor that has no node ID: with its COB-ID stored, too.
    for stored in [false, true] {
        let mut rig = if stored { booted() } else { blank() };
        if stored {
            rig.write_all(&[(0x1010, 2, 4, SAVE), (0x2001, 2, 1, 255), (0x1010, 4, 4, SAVE)]);
            rig.power_cycle();
        }
        bus(&mut rig, BusErrorMode::ErrorPassive);
        bus(&mut rig, BusErrorMode::ErrorActive);
        internal_fault(&mut rig, true);
        for request in ["04 01", "11 01", "17 00"] {
            rig.send(&format!("7E5: {request} 00 00 00 00 00 00"));
        }
        rig.take();
        rig.exchange(lss::TO_WAITING, &[BOOT_UP, CONTROLLER]);
        assert_eq!(history(&mut rig), [0x0002_FF00], "what an EMCY told, stored: {stored}");
    }
}

/// People and tools are shown how many entries of the history each error has.
#[test]
fn the_view_counts_the_entries() {
    let now = Instant::from_secs(1);
    let mut hat = Hat::power_on(Setup::new(Kind::Hat1000), &Image::empty(), StartCause::PowerOn, now);
    let healthy = Inputs::healthy(Kind::Hat1000.into());
    for _ in 0..3 {
        hat.sense(&Inputs { internal_fault: true, ..healthy }, now);
        hat.sense(&healthy, now);
    }
    hat.sense(&Inputs { bus: BusErrorMode::ErrorPassive, ..healthy }, now);
    let faults = hat.view(now).faults.into_iter().map(|fault| (fault.name, fault.active, fault.count));
    let expected = [("set-up", false, 0), ("controller", false, 3), ("error-passive", true, 1), ("can-bus", false, 0)];
    assert_eq!(faults.collect::<Vec<_>>(), expected);
}

#[test]
fn under_a_changed_29_bit_cob_id() {
    let mut rig = booted();
    assert_eq!(rig.write(0x1014, 0, 4, 0x8000_0081), Ok(()));
    internal_fault(&mut rig, true);
    rig.expect_nothing();
    assert_eq!((rig.read(0x1001, 0), rig.read(0x1003, 0)), (0x81, 0), "what no EMCY told is not entered");
    assert_eq!(rig.write(0x1014, 0, 4, 0x2ABC_DEF0), Ok(()));
    rig.expect_nothing();
    internal_fault(&mut rig, false);
    assert_eq!(rig.take(), ["0ABCDEF0: 00 00 00 00 00 00 00 00"]);
    internal_fault(&mut rig, true);
    assert_eq!(rig.take(), ["0ABCDEF0: 00 FF 81 02 00 00 00 00"]);
    rig.save(2);
    rig.exchange("000: 82 00", &[BOOT_UP, "0ABCDEF0: 00 FF 81 02 00 00 00 00"]);
    rig.power_cycle_sends(&[BOOT_UP, "0ABCDEF0: 00 FF 81 02 00 00 00 00"]);
}

/// In the order of arbitration, after answers and the heartbeat if its identifier says so.
#[test]
fn under_an_identifier_less_urgent_than_answers() {
    for (cob_id, told, place) in [
        (0x081, CONTROLLER, 0),
        (0x6A0, "6A0: 00 FF 81 02 00 00 00 00", 1),
        (0x3FFF_FFFF, "1FFFFFFF: 00 FF 81 02 00 00 00 00", 2),
    ] {
        let mut rig = booted();
        rig.write_all(&[(0x1014, 0, 4, 0x8000_0081), (0x1014, 0, 4, cob_id)]);
        for (index, sub, size, value) in
            [(0x1029, 2, 1, 1), (0x1800, 2, 1, 1), (0x1800, 1, 4, 0x080), (0x1017, 0, 2, 100)]
        {
            assert_eq!(rig.write(index, sub, size, value), Ok(()));
        }
        rig.exchange("000: 01 00", &["701: 7F"]);
        // A TPDO more urgent than all keeps them out of the controller until the bus is free.
        rig.hold_bus(true);
        rig.send("080:");
        rig.advance(100);
        rig.send("601: 40 01 10 00 00 00 00 00");
        internal_fault(&mut rig, true);
        rig.hold_bus(false);
        let mut expected = vec!["581: 4F 01 10 00 00 00 00 00", "701: 05"];
        expected.insert(place, told);
        assert_eq!(rig.take()[1..], expected);
    }
}

#[test]
fn an_emcy_that_waits_under_an_identifier_that_is_gone_is_not_sent() {
    let mut rig = booted();
    rig.hold_bus(true);
    internal_fault(&mut rig, true);
    assert_eq!(rig.pending(), 1);
    rig.send("601: 23 14 10 00 81 00 00 80");
    rig.free_bus_sends(&["581: 60 14 10 00 00 00 00 00"]);
}

/// CiA 301 reserves no identifier of an EMCY: one that waits under the TPDO's is told all the same.
#[test]
fn under_the_identifier_of_the_tpdo() {
    let mut rig = booted();
    for (sub, size, value) in [(2, 1, 1), (1, 4, 0x081)] {
        assert_eq!(rig.write(0x1800, sub, size, value), Ok(()));
    }
    assert_eq!(rig.write(0x1029, 2, 1, 1), Ok(()));
    rig.exchange("000: 01 00", &[]);
    rig.hold_bus(true);
    rig.send("080:");
    rig.sense_hat(|inputs| inputs.internal_fault = true);
    rig.send("080:");
    rig.sense_hat(|inputs| inputs.internal_fault = false);
    rig.send("080:");
    rig.hold_bus(false);
    rig.advance(1);
    let sent = rig.take();
    let told: Vec<_> = sent.iter().filter(|frame| *frame != "081: 00 00 00 00").collect();
    assert_eq!(told, ["081: 00 FF 81 02 00 00 00 00", "081: 00 00 00 00 00 00 00 00"], "{sent:?}");
}
