//! The bus as physics, with real valves on it: bit rates that differ, bus-off and the way back, a valve alone, valves
//! that share a node ID, noise (SPEC 2, 4.2; ISO 11898-1).

use hal_sim::bus::DestroyNext;
use hal_sim::{Event, Memory, NodeId};
use protocol_core::actuator::Color;
use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::time::{Duration, Instant, after, since};
use tests::BusRig;

const CLEARED: &str = "0A0: 00 00 00 00 00 00 00 00";

/// Brings the valve at node 0x20 to ACTIVE.
fn activate(rig: &mut BusRig) {
    rig.send("000: 01 00");
    for status in ["09", "0B", "0F"] {
        rig.exchange("220: 0F 00 00 00", &format!("1A0: {status} 00 00 00"));
    }
}

/// Records everything from now on.
fn watch(rig: &mut BusRig) {
    rig.world.record_events(true);
}

/// The error frames since this was last asked.
fn errors(rig: &mut BusRig) -> usize {
    rig.world.take_events().filter(Event::is_error_frame).count()
}

fn bits(count: u64, rate: BitRate) -> Duration {
    Duration::from_nanos(count * 1_000_000_000 / u64::from(rate.bits_per_second()))
}

/// Steps until `reached`.
#[track_caller]
fn run_to(rig: &mut BusRig, reached: impl Fn(&BusRig) -> bool) -> Instant {
    let end = after(rig.world.now(), Duration::from_secs(10));
    while !reached(rig) {
        assert!(rig.world.next_event() <= end, "it never comes to that");
        rig.world.step();
    }
    rig.world.now()
}

#[test]
fn bus_off_and_the_way_back() {
    let (mut rig, valve) = BusRig::booted();
    activate(&mut rig);
    rig.send("220: 0F 00 00 20");
    rig.run_for(100);
    rig.take();
    // Whatever the valve sends is destroyed 32 times: that is 8 for each, and 256 is too many.
    rig.world.inject(DestroyNext::frames_of("valve-1", 32));
    watch(&mut rig);
    rig.send("220: 0F 00 00 20");
    let passive = run_to(&mut rig, |rig| rig.mode(valve) == BusErrorMode::ErrorPassive);
    assert_eq!((rig.errors(valve).transmit_errors(), errors(&mut rig)), (128, 16));
    assert!(rig.outputs(valve).solenoids, "error-passive is no fault");
    let off = run_to(&mut rig, |rig| rig.mode(valve) == BusErrorMode::BusOff);
    assert!(off > passive && errors(&mut rig) == 16);
    // The CAN error, at once: solenoids off, LED red, and neither frame nor acknowledgement.
    assert!(!rig.outputs(valve).solenoids);
    let led = rig.outputs(valve).led;
    assert_eq!((led.color, led.flashing), (Color::Red, false));
    assert_eq!(rig.take(), [""; 0]);
    // Back after 128 times 11 recessive bits, not a bit earlier.
    let back = run_to(&mut rig, |rig| rig.mode(valve) != BusErrorMode::BusOff);
    assert_eq!(since(back, off), bits(128 * 11, BitRate::Kbit250));
    assert_eq!((rig.mode(valve), rig.errors(valve).transmit_errors()), (BusErrorMode::ErrorActive, 0));
    rig.run_for(10);
    // The TPDO that it could not send would say that the valve is active: it is not sent any more.
    assert_eq!(rig.take(), ["0A0: 40 81 11 01 00 00 00 00", CLEARED]);
    assert!(rig.outputs(valve).led.flashing, "FAULT_HOLD without a fault");
    assert_eq!(rig.read(0x20, 0x2019, 0), Some(1));
    // It is operational still, and is let out of FAULT_HOLD as after any fault.
    for (control, status) in [("0F", "03"), ("03", "03"), ("0B", "0B"), ("0F", "0F")] {
        let answer = rig.ask(&format!("220: {control} 00 00 00")).expect("a TPDO");
        assert!(answer.starts_with(&format!("1A0: {status} 00")), "{answer}");
    }
}

#[test]
fn a_valve_alone_waits_for_company() {
    let (mut rig, valve) = BusRig::with_flash(hal_sim::memory::Flash::new());
    rig.world.remove_client_port(rig.master);
    rig.world.power(valve, true);
    rig.run_for(60_000);
    // Nobody acknowledges its boot-up: error-passive, never bus-off, and no fault.
    assert_eq!((rig.mode(valve), rig.errors(valve).transmit_errors()), (BusErrorMode::ErrorPassive, 128));
    assert_eq!(rig.outputs(valve).led.color, Color::Yellow);
    rig.master = rig.world.add_client_port("late master");
    rig.run_for(10);
    assert_eq!(rig.take(), ["720: 00", CLEARED]);
    assert_eq!(rig.mode(valve), BusErrorMode::ErrorActive);
    activate(&mut rig);
    assert_eq!(rig.read(0x20, 0x2019, 0), Some(0), "no CAN error was counted");
}

#[test]
fn use_case_5_with_a_master_that_is_late() {
    let (mut rig, valve) = BusRig::booted();
    // It has something to say: a heartbeat every 100 ms.
    assert!(rig.write(0x20, (0x1017, 0, 2, 100)));
    rig.send("7E5: 04 01 00 00 00 00 00 00");
    rig.run_for(5);
    rig.take();
    rig.exchange("7E5: 13 00 02 00 00 00 00 00", "7E4: 13 00 00 00 00 00 00 00");
    // 20 ms until it switches, 20 ms more until it speaks; the master takes a second.
    rig.send("7E5: 15 14 00 00 00 00 00 00");
    rig.run_for(15);
    assert_eq!(rig.world.port(valve).bit_rate(), BitRate::Kbit250);
    rig.run_for(10);
    assert_eq!(rig.world.port(valve).bit_rate(), BitRate::Kbit500);
    rig.take();
    watch(&mut rig);
    for _ in 0..10 {
        rig.send("080:");
        rig.run_for(100);
    }
    // Each disturbs the other until it is error-passive, and no further.
    let seen = errors(&mut rig);
    assert!(seen > 20, "{seen}");
    assert_eq!(rig.take(), [""; 0], "nothing is heard");
    assert_eq!(rig.mode(valve), BusErrorMode::ErrorPassive);
    assert_eq!(rig.world.client_port(rig.master).mode(), BusErrorMode::ErrorPassive);
    assert_eq!(rig.outputs(valve).led.color, Color::Yellow, "no fault");
    rig.world.set_bit_rate(BitRate::Kbit500);
    rig.run_for(300);
    let heard = rig.take();
    assert!(heard.len() >= 2 && heard.iter().all(|frame| frame == "720: 7F"), "{heard:?}");
    rig.run_for(5000);
    assert_eq!(rig.mode(valve), BusErrorMode::ErrorActive, "{:?}", rig.errors(valve));
    rig.take();
    rig.exchange("7E5: 17 00 00 00 00 00 00 00", "7E4: 17 00 00 00 00 00 00 00");
    rig.world.power(valve, false);
    assert_eq!(rig.boot(valve), ["720: 00", CLEARED]);
    assert_eq!(rig.world.port(valve).bit_rate(), BitRate::Kbit500);
    assert_eq!(rig.read(0x20, 0x2019, 0), Some(0), "it never was bus-off");
}

#[test]
fn a_valve_with_the_wrong_bit_rate_harms_nobody_for_long() {
    let (mut rig, intruder) = BusRig::booted();
    rig.send("7E5: 04 01 00 00 00 00 00 00");
    for (request, answer) in [("13 00 04", "13 00 00"), ("17 00 00", "17 00 00")] {
        rig.exchange(&format!("7E5: {request} 00 00 00 00 00"), &format!("7E4: {answer} 00 00 00 00 00"));
    }
    rig.world.power(intruder, false);
    let valve = rig.add_booted(0x21);
    rig.send("000: 01 00");
    let cycle = |rig: &mut BusRig, cycles: u32| {
        let mut answered = 0;
        for _ in 0..cycles {
            rig.send("221: 0F 00 00 00");
            rig.run_for(100);
            answered += rig.take().iter().filter(|frame| frame.starts_with("1A1: ")).count();
        }
        answered
    };
    assert_eq!(cycle(&mut rig, 5), 5);
    assert_eq!(rig.read(0x21, 0x6041, 0), Some(0x0F));
    watch(&mut rig);
    rig.world.power(intruder, true);
    assert_eq!(cycle(&mut rig, 50), 50, "no cycle is lost, and none is late enough for the time guarding");
    let seen: Vec<Event> = rig.world.take_events().collect();
    assert!(seen.iter().filter(|event| event.is_error_frame()).count() > 32);
    assert!(seen.iter().all(|event| event.frame().is_none() || event.who.as_ref() != "valve-1"));
    assert_eq!(rig.read(0x21, 0x6041, 0), Some(0x0F));
    assert_ne!(rig.mode(valve), BusErrorMode::BusOff);
    assert_ne!(rig.mode(intruder), BusErrorMode::ErrorActive);
    // It is gone: all is as before.
    rig.world.power(intruder, false);
    assert_eq!(cycle(&mut rig, 150), 150);
    assert_eq!((rig.mode(valve), rig.errors(valve).receive_errors()), (BusErrorMode::ErrorActive, 0));
    // And heard by a master that knows its bit rate.
    rig.world.power(valve, false);
    rig.world.set_bit_rate(BitRate::Kbit125);
    let heard = rig.boot(intruder);
    assert_eq!(heard[..2], ["720: 00", CLEARED], "{heard:?}");
}

#[test]
fn valves_that_share_a_node_id() {
    let mut rig = BusRig::default();
    let valves: Vec<NodeId> = (0..3)
        .map(|number| {
            let setup = Setup { serial: Some(0x1111_1111 << number), ..Setup::new(Kind::PveaCanopen) };
            rig.add(setup, Memory::in_ram())
        })
        .collect();
    watch(&mut rig);
    rig.world.power_all(Duration::from_ticks(0));
    rig.run_for(50);
    // What they say is the same to the last bit: one frame.
    assert_eq!((rig.take(), errors(&mut rig)), (vec!["720: 00".to_owned(), CLEARED.to_owned()], 0));
    rig.exchange("620: 40 00 10 00 00 00 00 00", "5A0: 43 00 10 00 98 01 00 00");
    assert_eq!(errors(&mut rig), 0);
    // Here they differ. They collide until they are error-passive; then one after the other gets through, by its bits.
    rig.send("620: 40 18 10 04 00 00 00 00");
    rig.run_for(100);
    let mut answers = rig.take();
    answers.sort();
    let expected = ["11 11 11 11", "22 22 22 22", "44 44 44 44"].map(|serial| format!("5A0: 43 18 10 04 {serial}"));
    assert_eq!(answers, expected);
    let seen = errors(&mut rig);
    assert!((16..50).contains(&seen), "{seen}");
    assert!(valves.iter().all(|valve| rig.mode(*valve) != BusErrorMode::BusOff));
    // LSS tells them apart by their serial numbers.
    for (number, serial) in [(1_u8, "22 22 22 22"), (2, "44 44 44 44")] {
        rig.send("7E5: 04 00 00 00 00 00 00 00");
        for select in ["40 19 00 00 01", "41 00 00 36 53", "42 20 00 01 00"] {
            rig.send(&format!("7E5: {select} 00 00 00"));
        }
        rig.exchange(&format!("7E5: 43 {serial} 00 00 00"), "7E4: 44 00 00 00 00 00 00 00");
        rig.exchange(&format!("7E5: 11 {:02X} 00 00 00 00 00 00", 0x20 + number), "7E4: 11 00 00 00 00 00 00 00");
        rig.exchange("7E5: 17 00 00 00 00 00 00 00", "7E4: 17 00 00 00 00 00 00 00");
        rig.exchange("7E5: 04 00 00 00 00 00 00 00", &format!("{:03X}: 00", 0x720 + u16::from(number)));
        rig.run_for(10);
        rig.take();
    }
    for number in 0..3 {
        assert_eq!(rig.read(0x20 + number, 0x1018, 4), Some(0x1111_1111 << number));
    }
}

#[test]
fn a_client_that_sends_what_the_valve_sends_does_not_jam_the_bus() {
    let (mut rig, valve) = BusRig::booted();
    assert!(rig.write(0x20, (0x1017, 0, 2, 100)));
    rig.world.remove_client_port(rig.master);
    rig.master = rig.world.add_gateway("gateway");
    while rig.world.port(valve).pending() == 0 {
        rig.world.step();
    }
    // A frame that is on the wire while the next heartbeat falls due: that and the client's own start at the same bit.
    let due_soon = after(rig.world.now(), Duration::from_micros(99_800));
    rig.world.run_until(due_soon);
    rig.send("7FF: 00 00 00 00 00 00 00 00");
    rig.send("720: 7F");
    watch(&mut rig);
    rig.run_for(10);
    let seen: Vec<Event> = rig.world.take_events().collect();
    assert_eq!(seen.iter().filter(|event| event.is_error_frame()).count(), 0, "{seen:?}");
    let frames: Vec<String> = seen.iter().filter_map(Event::frame).map(ToString::to_string).collect();
    assert_eq!(frames, ["7FF: 00 00 00 00 00 00 00 00", "720: 7F"], "two senders, one frame");
    assert_eq!((rig.world.pending(rig.master), rig.world.port(valve).pending()), (0, 0));
    // The bus goes on.
    rig.send("000: 81 20");
    rig.run_for(50);
    let frames: Vec<String> =
        rig.world.take_events().filter_map(|event| event.frame().map(ToString::to_string)).collect();
    assert_eq!(frames, ["000: 81 20", "720: 00", CLEARED]);
}
