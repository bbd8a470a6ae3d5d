//! What a world tells of what happened.

use super::*;

/// The events of one controller or device since this was last asked, frames and error frames aside.
fn changes(bench: &mut Bench, who: &str) -> Vec<EventKind> {
    let of_bus = |event: &Event| event.frame().is_some() || event.is_error_frame();
    let events = bench.world.take_events().filter(|event| &*event.who == who && !of_bus(event));
    events.map(|event| event.what).collect()
}

#[test]
fn a_world_records_nothing_until_it_is_told_to() {
    let mut bench = Bench::of(1);
    bench.world.record_events(false);
    bench.world.send(bench.client, std_frame(ECHO + 1, &[]));
    bench.run_for(10);
    assert_eq!(bench.world.take_events().count(), 0);
    bench.world.record_events(true);
    bench.world.send(bench.client, std_frame(ECHO + 1, &[]));
    bench.run_for(10);
    assert_eq!(bench.world.take_events().count(), 2);
    assert_eq!(bench.world.take_events().count(), 0, "taken once");
}

#[test]
fn every_change_of_an_error_mode_is_told_the_recovery_too() {
    use BusErrorMode::{BusOff, ErrorActive, ErrorPassive};

    let mut bench = Bench::of(1);
    bench.world.inject(DestroyNext::frames_of("probe-1", 32));
    bench.world.send(bench.client, std_frame(ECHO + 1, &[7]));
    bench.run_for(1000);
    let modes = [(ErrorActive, ErrorPassive), (ErrorPassive, BusOff), (BusOff, ErrorActive)];
    assert_eq!(changes(&mut bench, "probe-1"), modes.map(|(from, to)| EventKind::ErrorMode { from, to }));
    bench.world.force_bus_off(bench.nodes[0], true);
    assert_eq!(changes(&mut bench, "probe-1"), [EventKind::ErrorMode { from: ErrorActive, to: BusOff }]);
}

#[test]
fn an_error_frame_names_its_sender_and_who_signals_it() {
    let mut bench = Bench::with(2, 1, |id| Plan::new(id, if id == 1 { BitRate::Kbit125 } else { RATE }));
    let start = bench.world.now();
    let frame = std_frame(ECHO + 2, &[]);
    bench.world.send(bench.client, frame);
    bench.run_for(1);
    let first = bench.trace().into_iter().next().expect("an error frame");
    assert_eq!(&*first.who, "client");
    let error = BusError::Stuff;
    assert_eq!(first.what, EventKind::ErrorFrame { frame, start, error, signalled_by: "probe-1".into() });
}

#[test]
fn frames_that_a_device_dropped_are_told() {
    let mut bench = Bench::of(2);
    for count in [3, 1] {
        bench.command(Command::Drop, 2, &[count]);
        bench.run_for(10);
        assert_eq!(changes(&mut bench, "probe-2"), [EventKind::FramesDropped { count: count.into() }]);
    }
    // A new start counts from the beginning.
    bench.world.power(bench.nodes[1], false);
    bench.world.power(bench.nodes[1], true);
    bench.run_for(10);
    bench.command(Command::Drop, 2, &[2]);
    bench.run_for(10);
    assert_eq!(changes(&mut bench, "probe-2"), [EventKind::FramesDropped { count: 2 }]);
}
