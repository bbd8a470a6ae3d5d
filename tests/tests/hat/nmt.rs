//! Boot-up, heartbeat, 0x1F80 and 0x1029 (SPEC 9).

use protocol_core::controller::BusErrorMode;
use protocol_core::memory::RecordKey;
use tests::{Rig, lss, sdo};

use super::{SAVE, booted};

const STARTS_ITSELF: u32 = 0x0C;

/// A sensor that starts itself, with TPDO 1 every 10 ms, stored.
fn self_starting() -> Rig {
    let mut rig = booted();
    rig.write_all(&[(0x1F80, 0, 4, STARTS_ITSELF), (0x1800, 5, 2, 10), (0x1800, 1, 4, 0x181)]);
    rig.save(2);
    rig
}

/// The NMT state, as the heartbeat tells it; a sensor that is stopped does not answer.
fn state(rig: &mut Rig) -> u8 {
    rig.send(&sdo::write(1, 0x1017, 0, &1000_u16.to_le_bytes()));
    if rig.take_next().is_none() {
        return 0x04;
    }
    let state = rig.take_next().expect("a heartbeat").data()[0];
    assert_eq!(rig.write(0x1017, 0, 2, 0), Ok(()));
    state
}

#[test]
fn it_starts_itself_after_every_boot_up_and_not_before() {
    let mut rig = self_starting();
    rig.silent_for(50);
    for restart in [Rig::power_cycle, |rig: &mut Rig| rig.send("000: 81 00"), |rig: &mut Rig| rig.send("000: 82 00")] {
        restart(&mut rig);
        rig.advance_sends(20, &["701: 00", "181: 00 00 00 00", "181: 00 00 00 00"]);
        assert_eq!(state(&mut rig), 0x05);
        rig.take();
    }
    // 0x08 does not.
    assert_eq!(rig.write(0x1F80, 0, 4, 0x08), Ok(()));
    assert_eq!(state(&mut rig), 0x05, "acts at the next boot-up");
    rig.save(2);
    rig.power_cycle_sends(&["701: 00"]);
    assert_eq!(state(&mut rig), 0x7F);
}

#[test]
fn it_starts_itself_once_and_leaves_lss_configuration() {
    let mut rig = self_starting();
    rig.hold_bus(true);
    rig.power_cycle();
    rig.send(lss::TO_CONFIGURATION);
    rig.free_bus_sends(&["701: 00"]);
    rig.sense_hat_sends(|inputs| inputs.internal_fault = true, &["081: 00 FF 81 02 00 00 00 00"]);
    rig.silent_for(100);
    assert_eq!(state(&mut rig), 0x7F, "0x1029:2 has ended operational");
    rig.take();
    rig.exchange(lss::INQUIRE_NODE_ID, &[]);
}

/// Leaving operational by itself is no start, and entering it is one, whoever leaves it.
#[test]
fn it_leaves_lss_configuration_as_it_starts_itself() {
    let mut rig = self_starting();
    rig.hold_bus(true);
    rig.power_cycle();
    rig.send(lss::TO_CONFIGURATION);
    rig.free_bus_sends(&["701: 00"]);
    rig.silent_to(&["000: 80 00", lss::INQUIRE_NODE_ID]);
}

#[test]
fn a_command_before_the_boot_up_is_out_has_the_last_word() {
    let mut rig = self_starting();
    rig.hold_bus(true);
    rig.power_cycle();
    rig.send("000: 80 00");
    rig.hold_bus(false);
    rig.advance_sends(20, &["701: 00"]);
}

#[test]
fn pending_emcys_come_before_operational_and_do_not_hold_it_back() {
    let mut rig = self_starting();
    rig.write_all(&[(0x1029, 2, 1, 2), (0x1010, 1, 4, SAVE)]);
    rig.records.get_mut(&RecordKey::Application).unwrap()[3] ^= 1;
    rig.sense_hat(|inputs| inputs.internal_fault = true);
    rig.take();
    rig.power_cycle_sends(&["701: 00", "081: 00 FF 81 01 00 00 00 00", "081: 00 FF 81 02 00 00 00 00"]);
    assert_eq!(state(&mut rig), 0x05);
    rig.take();
    // Nor does a watchdog reset.
    rig.watchdog_reset();
    rig.take();
    assert_eq!(state(&mut rig), 0x05);
}

#[test]
fn a_sensor_that_is_alone_starts_when_somebody_comes() {
    let mut rig = self_starting();
    rig.hold_bus(true);
    rig.power_cycle();
    rig.advance(100);
    rig.sense_hat(|inputs| inputs.bus = BusErrorMode::ErrorPassive);
    rig.advance(1_000);
    rig.hold_bus(false);
    rig.sense_hat(|inputs| inputs.bus = BusErrorMode::ErrorActive);
    rig.advance(10);
    let sent = rig.take();
    let (told, pdo) = (["701: 00", "081: 20 81 11 03 00 00 00 00"], "181: 00 00 00 00");
    assert_eq!(sent[..2], told, "{sent:?}");
    assert_eq!(sent.last().map(String::as_str), Some(pdo));
    assert_eq!(state(&mut rig), 0x05);
}

/// What a controller error, or bus-off, does in operational with this value in 0x1029.
fn reaction(sub: u8, value: u32, cause: impl FnOnce(&mut Rig)) -> u8 {
    let mut rig = booted();
    rig.write_all(&[(0x1029, sub, 1, value), (0x1029, 3 - sub, 1, 1)]);
    rig.exchange("000: 01 00", &[]);
    cause(&mut rig);
    rig.take();
    state(&mut rig)
}

fn controller_error(rig: &mut Rig) {
    rig.sense_hat(|inputs| inputs.internal_fault = true);
    assert_eq!(rig.take(), ["081: 00 FF 81 02 00 00 00 00"], "told whatever state is entered");
}

fn bus_off(rig: &mut Rig) {
    rig.sense_hat(|inputs| inputs.bus = BusErrorMode::BusOff);
    rig.sense_hat(|inputs| inputs.bus = BusErrorMode::ErrorActive);
}

#[test]
fn what_errors_do_in_operational() {
    for (value, entered) in [(0, 0x7F), (1, 0x05), (2, 0x04)] {
        assert_eq!(reaction(1, value, bus_off), entered, "bus-off, {value}");
        assert_eq!(reaction(2, value, controller_error), entered, "controller error, {value}");
    }
    for value in [0, 2] {
        let passive = |rig: &mut Rig| rig.sense_hat(|inputs| inputs.bus = BusErrorMode::ErrorPassive);
        assert_eq!(reaction(1, value, passive), 0x05, "error-passive is no reason");
    }
}

/// The controller error is told first: 0x1029:2 has left operational when the bus-off comes.
#[test]
fn of_two_errors_of_one_instant_the_first_acts() {
    for (controller_error, bus_off, entered) in [(0, 2, 0x7F), (2, 0, 0x04), (1, 2, 0x04)] {
        let both = |rig: &mut Rig| {
            assert_eq!(rig.write(0x1029, 1, 1, bus_off), Ok(()));
            rig.sense_hat(|inputs| (inputs.internal_fault, inputs.bus) = (true, BusErrorMode::BusOff));
            rig.sense_hat(|inputs| inputs.bus = BusErrorMode::ErrorActive);
        };
        assert_eq!(reaction(2, controller_error, both), entered, "{controller_error}, {bus_off}");
    }
}

#[test]
fn errors_do_nothing_in_pre_operational_and_stopped() {
    for (command, stays) in [("000: 80 00", 0x7F), ("000: 02 00", 0x04)] {
        for value in [0, 2] {
            let mut rig = booted();
            for sub in [1, 2] {
                assert_eq!(rig.write(0x1029, sub, 1, value), Ok(()));
            }
            rig.exchange(command, &[]);
            rig.sense_hat(|inputs| inputs.internal_fault = true);
            bus_off(&mut rig);
            rig.take();
            assert_eq!(state(&mut rig), stays);
        }
    }
}

#[test]
fn a_sensor_that_an_error_has_stopped_logs_the_recovery_and_does_not_send_it() {
    let mut rig = booted();
    assert_eq!(rig.write(0x1029, 1, 1, 2), Ok(()));
    rig.exchange("000: 01 00", &[]);
    bus_off(&mut rig);
    rig.expect_nothing();
    rig.exchange("000: 80 00", &[]);
    assert_eq!((rig.read(0x1003, 0), rig.read(0x1003, 1)), (1, 0x0004_8140));
}
