//! Faults of the communication with devices: the eight errors that IEC 61784-3 names.

use hal_sim::bus::{Delay, Fault, FaultError, FaultKind, FrameFilter};
use protocol_core::frame::standard;
use protocol_core::time::Duration;
use tests::{BusRig, frame};

/// A fault of the frames with an identifier.
fn of(id: u16, kind: FaultKind) -> Fault {
    let frames = FrameFilter { id: Some(standard(id).into()), ..FrameFilter::default() };
    Fault { frames, ..Fault::new("fault", kind) }
}

const fn millis(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

#[test]
fn a_lost_request_is_not_answered() {
    let (mut rig, _) = BusRig::booted();
    let lose = FaultKind::Lose { receivers: vec!["valve-1".into()] };
    rig.world.fault(Fault { count: Some(1), ..of(0x620, lose) }).expect("a fault");
    assert_eq!(rig.ask("620: 40 08 10 00 00 00 00 00"), None);
    assert!(rig.ask("620: 40 08 10 00 00 00 00 00").is_some());
}

#[test]
fn an_answer_is_late_and_another_device_does_not_care() {
    let mut rig = BusRig::default();
    rig.add_booted(0x20);
    rig.add_booted(0x21);
    let delay = FaultKind::Delay { delay: Delay::Constant(millis(200)), overtake: false };
    rig.world.fault(of(0x5A0, delay)).expect("a fault");
    rig.take();
    rig.send("620: 40 17 10 00 00 00 00 00");
    rig.send("621: 40 17 10 00 00 00 00 00");
    rig.run_for(100);
    let ids = |lines: Vec<String>| lines.into_iter().map(|line| line[..3].to_owned()).collect::<Vec<_>>();
    assert_eq!(ids(rig.take()), ["5A1"]);
    rig.run_for(200);
    assert_eq!(ids(rig.take()), ["5A0"]);
}

/// An inserted set-point under the identifier of the master: the valve cannot tell the two.
#[test]
fn a_masqueraded_set_point_is_followed() {
    let (mut rig, valve) = BusRig::booted();
    rig.send("000: 01 20");
    rig.run_for(10);
    let insert = FaultKind::Insert { frame: frame("220: 0F 00 00 20"), every: Some(millis(100)) };
    rig.world.record_events(true);
    rig.world.fault(Fault { count: Some(5), ..Fault::new("intruder", insert) }).expect("a fault");
    rig.run_for(450);
    assert_eq!(rig.world.view(valve).expect("power").position, 0x2000);
    let senders = |rig: &mut BusRig| {
        let frames = rig.world.take_events().filter(|event| event.frame() == Some(&frame("220: 0F 00 00 20")));
        frames.map(|event| event.who.to_string()).collect::<Vec<_>>()
    };
    assert_eq!(senders(&mut rig), ["intruder"; 5]);
    rig.run_for(2000);
    assert_eq!(senders(&mut rig), [""; 0], "five, and no more");
}

/// The device knows nothing of a delayed frame: a restart neither waits for it nor loses it.
#[test]
fn a_restart_does_not_wait_for_a_delayed_answer() {
    let (mut rig, _) = BusRig::booted();
    let delay = FaultKind::Delay { delay: Delay::Constant(millis(300)), overtake: false };
    rig.world.fault(of(0x5A0, delay)).expect("a fault");
    rig.take();
    rig.send("620: 40 08 10 00 00 00 00 00");
    rig.run_for(1);
    rig.send("000: 81 20");
    rig.run_for(50);
    assert!(rig.take().iter().any(|line| line == "720: 00"));
    rig.run_for(300);
    assert!(rig.take().iter().any(|line| line.starts_with("5A0: ")));
}

#[test]
fn a_fault_of_nobody_is_refused() {
    let (mut rig, _) = BusRig::booted();
    let frames = FrameFilter { sender: Some("nobody".into()), ..FrameFilter::default() };
    let refused = rig.world.fault(Fault { frames, ..Fault::new("fault", FaultKind::Destroy) });
    assert!(matches!(refused, Err(FaultError::Unknown { .. })), "{refused:?}");
    assert_eq!(rig.world.faults().count(), 0);
}

/// A device aborts an older heartbeat when the next one is due: one that a fault delays is on its way all the same.
#[test]
fn delayed_heartbeats_come_late() {
    let (mut rig, _) = BusRig::booted();
    assert!(rig.write(0x20, (0x1017, 0, 2, 50)));
    rig.run_for(200);
    let delay = FaultKind::Delay { delay: Delay::Constant(millis(80)), overtake: false };
    rig.world.fault(of(0x720, delay)).expect("a fault");
    rig.take();
    rig.run_for(2000);
    assert!((37..=40).contains(&rig.take().len()));
}

/// The copies of a boot-up hold back neither answers nor a restart.
#[test]
fn copies_do_not_hold_back_the_device() {
    let (mut rig, valve) = BusRig::booted();
    rig.world.power(valve, false);
    let repeat = FaultKind::Repeat { times: 5, after: millis(1000) };
    rig.world.fault(Fault { count: Some(1), ..of(0x720, repeat) }).expect("a fault");
    rig.world.power(valve, true);
    rig.run_for(500);
    rig.take();
    assert!(rig.ask("620: 40 18 10 01 00 00 00 00").is_some());
    rig.send("000: 81 20");
    rig.run_for(100);
    assert!(rig.take().iter().any(|line| line == "720: 00"));
}

#[test]
fn the_controller_of_a_fault_leaves_with_it() {
    let (mut rig, _) = BusRig::booted();
    rig.world.record_events(true);
    let insert =
        || FaultKind::Insert { frame: frame("123: 01 02 03 04 05 06 07 08"), every: Some(Duration::from_micros(100)) };
    for _ in 0..3 {
        rig.world.fault(Fault::new("intruder", insert())).expect("a fault");
        rig.run_for(2000);
        assert!(rig.world.end_fault("intruder"));
        rig.run_for(10);
        assert!(rig.world.take_events().filter(|event| event.who.as_ref() == "intruder").count() > 100);
        rig.run_for(1000);
        assert_eq!(rig.world.take_events().filter(|event| event.who.as_ref() == "intruder").count(), 0);
    }
    let once = FaultKind::Insert { frame: frame("123:"), every: None };
    rig.world.fault(Fault::new("intruder", once.clone())).expect("a fault");
    rig.run_for(10);
    let names = rig.world.fault(Fault {
        frames: FrameFilter { sender: Some("?".into()), ..FrameFilter::default() },
        ..Fault::new("x", FaultKind::Destroy)
    });
    assert_eq!(names.unwrap_err().to_string(), "no device or client '?'; known: master, valve-1");
    assert!(rig.world.faults().all(|state| state.is_over));
    assert!(rig.world.fault(Fault::new("valve-1", once)).is_err(), "the name of a device");
}
