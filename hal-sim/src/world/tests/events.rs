//! The recorded events of a world.

use super::*;

/// Takes the events of one controller or device since the last call, except for frames and error frames.
fn changes(rig: &mut Rig, who: &str) -> Vec<EventKind> {
    let of_bus = |event: &Event| event.frame().is_some() || event.is_error_frame();
    let events = rig.world.take_events().filter(|event| &*event.who == who && !of_bus(event));
    events.map(|event| event.what).collect()
}

#[test]
fn a_world_records_nothing_until_it_is_told_to() {
    let mut rig = Rig::of(1);
    rig.world.record_events(false);
    rig.world.send(rig.client, std_frame(ECHO + 1, &[]));
    rig.run_for(10);
    assert_eq!(rig.world.take_events().count(), 0);
    rig.world.record_events(true);
    rig.world.send(rig.client, std_frame(ECHO + 1, &[]));
    rig.run_for(10);
    assert_eq!(rig.world.take_events().count(), 2);
    assert_eq!(rig.world.take_events().count(), 0, "taken once");
}

#[test]
fn every_change_of_an_error_mode_is_told_the_recovery_too() {
    use BusErrorMode::{BusOff, ErrorActive, ErrorPassive};

    let mut rig = Rig::of(1);
    rig.world.inject(DestroyNext::frames_of("probe-1", 32));
    rig.world.send(rig.client, std_frame(ECHO + 1, &[7]));
    rig.run_for(1000);
    let modes = [(ErrorActive, ErrorPassive), (ErrorPassive, BusOff), (BusOff, ErrorActive)];
    assert_eq!(changes(&mut rig, "probe-1"), modes.map(|(from, to)| EventKind::ErrorMode { from, to }));
    rig.world.force_bus_off(rig.nodes[0], true);
    assert_eq!(changes(&mut rig, "probe-1"), [EventKind::ErrorMode { from: ErrorActive, to: BusOff }]);
}

#[test]
fn an_error_frame_names_its_sender_and_who_signals_it() {
    let mut rig = Rig::with(2, 1, |id| Plan::new(id, if id == 1 { BitRate::Kbit125 } else { RATE }));
    let start = rig.world.now();
    let frame = std_frame(ECHO + 2, &[]);
    rig.world.send(rig.client, frame);
    rig.run_for(1);
    let first = rig.trace().into_iter().next().expect("an error frame");
    assert_eq!(&*first.who, "client");
    let error = BusError::Stuff;
    assert_eq!(first.what, EventKind::ErrorFrame { frame, start, error, signalled_by: "probe-1".into() });
}

#[test]
fn frames_that_a_device_dropped_are_told() {
    let mut rig = Rig::of(2);
    for count in [3, 1] {
        rig.command(Command::Drop, 2, &[count]);
        rig.run_for(10);
        assert_eq!(changes(&mut rig, "probe-2"), [EventKind::FramesDropped { count: count.into() }]);
    }
    // A new start resets the counter.
    rig.world.power(rig.nodes[1], false);
    rig.world.power(rig.nodes[1], true);
    rig.run_for(10);
    rig.command(Command::Drop, 2, &[2]);
    rig.run_for(10);
    assert_eq!(changes(&mut rig, "probe-2"), [EventKind::FramesDropped { count: 2 }]);
}
