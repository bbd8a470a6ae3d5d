//! After a blocked bus a valve says what is true then: nothing that is out of date, and the last word of every EMCY
//! story (SPEC 4.2).

use protocol_core::controller::BusErrorMode;
use tests::Rig;

use super::CLEARED;

/// The newest messages of an EMCY story that are kept.
const KEPT: usize = 16;

fn toggle_internal_fault(valve: &mut Rig, times: usize) {
    for active in [true, false].into_iter().cycle().take(2 * times) {
        valve.sense(|inputs| inputs.internal_fault = active);
        valve.advance(1);
    }
}

/// The end of a story: the newest messages in order, after one older message at the most, which was in the controller.
/// The messages between them count as dropped.
#[track_caller]
fn is_end_of(sent: &[String], story: &[String], dropped: u32) {
    let is_end = story.ends_with(sent) || sent.split_first().is_some_and(|(_, newest)| story.ends_with(newest));
    assert!(is_end, "{sent:#?} is not the end of {story:#?}");
    assert!(sent.len() >= KEPT.min(story.len()), "{sent:#?} of {story:#?}");
    assert_eq!(usize::try_from(dropped).unwrap(), story.len() - sent.len(), "counted as dropped");
}

/// The story of an internal error that comes and goes: `code, register, counter`.
fn story(first: usize, last: usize) -> Vec<String> {
    let told = (first..=last).map(|count| format!("0A0: 00 10 01 {:02X} 00 00 00 00", count.min(127)));
    told.flat_map(|error| [error, CLEARED.to_owned()]).collect()
}

/// Perhaps it ends with an error, perhaps it begins behind a boot-up that the bus does not take.
#[test]
fn emcys_of_a_long_held_bus() {
    for toggles in [1, 4, 7, 8, 9, 11, 12, 15, 20, 40, 127] {
        for (error_stays, boots) in [(false, false), (true, false), (false, true)] {
            let mut valve = Rig::booted();
            valve.hold_bus(true);
            let mut whole = story(1, toggles);
            if boots {
                valve.power_cycle();
                whole.insert(0, CLEARED.to_owned());
            }
            toggle_internal_fault(&mut valve, toggles);
            if error_stays {
                valve.sense(|inputs| inputs.internal_fault = true);
                whole.extend(story(toggles + 1, toggles + 1));
                whole.pop();
            }
            valve.hold_bus(false);
            if boots {
                valve.expect("720: 00");
            }
            let sent = valve.take_under("0A0");
            is_end_of(&sent, &whole, valve.device().frames_dropped());
            assert_eq!(valve.read(0x1001, 0), u32::from(error_stays));
        }
    }
}

/// The CAN bus error lasts as long as bus-off: no "no error" before its end.
#[test]
fn emcys_of_bus_off() {
    for toggles in [1, 13, 14, 15, 16, 22, 23, 24, 40] {
        let mut valve = Rig::booted();
        valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
        toggle_internal_fault(&mut valve, toggles);
        valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
        valve.advance(1000);
        let sent = valve.take();
        let errors = (1..=toggles).map(|count| format!("0A0: 00 10 11 {count:02X} 00 00 00 00"));
        let mut whole = vec!["0A0: 40 81 11 01 00 00 00 00".to_owned()];
        whole.extend(errors);
        whole.push(CLEARED.to_owned());
        is_end_of(&sent, &whole, valve.device().frames_dropped());
        assert_eq!(valve.read(0x1001, 0), 0);
    }
}

/// Several set-points on a held bus: one TPDO, sampled when it is sent.
#[test]
fn tpdos_tell_the_present_state() {
    let mut valve = Rig::booted();
    valve.exchange("000: 01 20", &[]);
    valve.hold_bus(true);
    for _ in 0..3 {
        valve.send("220: 0F 00 00 00");
    }
    valve.free_bus_sends(&["1A0: 0F 00 00 00"]);
}

/// The same on SYNC.
#[test]
fn synchronous_tpdos_tell_the_present_state() {
    let mut valve = Rig::booted();
    assert_eq!(valve.write(0x1800, 2, 1, 1), Ok(()));
    valve.exchange("000: 01 20", &[]);
    valve.hold_bus(true);
    for _ in 0..3 {
        valve.send_all(&["080:", "220: 0F 00 00 00"]);
    }
    valve.send("080:");
    valve.free_bus_sends(&["1A0: 0F 00 00 00"]);
}

/// A change that comes while the TPDO is in the controller, without another RPDO: by SDO, or by a fault.
#[test]
fn a_waiting_tpdo_tells_the_state_as_it_is_sent() {
    let mut valve = Rig::booted();
    valve.exchange("000: 01 20", &[]);
    valve.hold_bus(true);
    valve.send("220: 0F 00 00 00");
    assert_eq!(valve.pending(), 1);
    valve.send("620: 2B 40 60 00 0F 00 00 00");
    valve.free_bus_sends(&["1A0: 0B 00 00 00", "5A0: 60 40 60 00 00 00 00 00"]);

    valve.hold_bus(true);
    valve.send("220: 0F 00 00 00");
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.free_bus_sends(&["0A0: 00 10 01 01 00 00 00 00", "1A0: 03 00 00 00"]);
}

/// A fourth frame takes the place of the least urgent of three, which goes back to the device: it is not lost.
#[test]
fn a_displaced_frame_is_sent_after_all() {
    let mut valve = Rig::booted();
    assert_eq!(valve.write(0x1017, 0, 2, 100), Ok(()));
    valve.send("000: 01 20");
    valve.take();
    valve.hold_bus(true);
    valve.advance(100);
    valve.send_all(&["620: 40 00 10 00 00 00 00 00", "220: 01 00 00 00"]);
    valve.sense(|inputs| inputs.internal_fault = true);
    assert_eq!(valve.pending(), 3);
    let emcy = "0A0: 00 10 01 01 00 00 00 00";
    valve.free_bus_sends(&[emcy, "1A0: 03 00 00 00", "5A0: 43 00 10 00 98 01 00 00", "720: 05"]);
}

/// PDOs are sent in operational only.
#[test]
fn no_tpdo_after_operational() {
    for command in ["80", "02"] {
        let mut valve = Rig::booted();
        valve.exchange("000: 01 20", &[]);
        valve.hold_bus(true);
        valve.send_all(&["220: 0F 00 00 00", &format!("000: {command} 20")]);
        valve.hold_bus(false);
        valve.expect_nothing();
    }
}

/// A PDO that was switched off or given another identifier does not go out under the old one.
#[test]
fn no_tpdo_of_a_pdo_that_is_off() {
    const OFF: &str = "620: 23 00 18 01 A0 01 00 80";
    const IS_OFF: &str = "5A0: 60 00 18 01 00 00 00 00";
    let mut valve = Rig::booted();
    valve.exchange("000: 01 20", &[]);
    valve.hold_bus(true);
    valve.send_all(&["220: 0F 00 00 00", OFF]);
    valve.free_bus_sends(&[IS_OFF]);

    // Nor does one that the controller has not taken yet, for the EMCY before it.
    let mut valve = Rig::booted();
    valve.exchange("000: 01 20", &[]);
    valve.hold_bus(true);
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.send_all(&["220: 0F 00 00 00", OFF]);
    assert_eq!(valve.pending(), 1);
    valve.free_bus_sends(&["0A0: 00 10 01 01 00 00 00 00", IS_OFF]);
}

/// An EMCY outlives the writes of all other objects.
#[test]
fn a_waiting_emcy_and_a_write_of_another_object() {
    let mut valve = Rig::booted();
    valve.hold_bus(true);
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.send("620: 23 05 10 00 90 00 00 00");
    valve.free_bus_sends(&["0A0: 00 10 01 01 00 00 00 00", "5A0: 60 05 10 00 00 00 00 00"]);
}
