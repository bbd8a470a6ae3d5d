//! Senders of the same identifier with different data (ISO 11898-1, 10.11 and 12.1): the loser, its bus integration,
//! and the times.

use protocol_core::controller::BusErrorMode;
use protocol_core::time::Duration;

use super::rig::{Rig, bits, frame, micros};
use super::{BusError, Event, EventKind, FrameBits, PortId};

/// The identifier of `a` and `b`; the frame of `a` is dominant at the first difference.
const ID: u16 = 0x700;
const DOMINANT: &[u8] = &[0x05];
const RECESSIVE: &[u8] = &[0x7F];

/// Makes `a` and `b` collide until both are error-passive.
fn both_passive(rig: &mut Rig) {
    for _ in 0..16 {
        rig.send(0, frame(ID, DOMINANT));
        rig.send(1, frame(ID, RECESSIVE));
        let (_, ended) = rig.next();
        assert_eq!(ended.error, Some(BusError::Bit));
        rig.bus.drop_pending(PortId(0), rig.now);
        rig.bus.drop_pending(PortId(1), rig.now);
    }
    rig.run_for(Duration::from_millis(1));
    assert_eq!((rig.mode(0), rig.mode(1)), (BusErrorMode::ErrorPassive, BusErrorMode::ErrorPassive));
}

#[test]
fn the_loser_of_a_bit_neither_receives_nor_acknowledges() {
    let mut rig = Rig::of(2);
    both_passive(&mut rig);
    rig.send(0, frame(ID, DOMINANT));
    rig.send(1, frame(ID, RECESSIVE));
    let (_, ended) = rig.next();
    // No other port acknowledges.
    assert_eq!((ended.error, ended.frame), (Some(BusError::Acknowledgement), frame(ID, DOMINANT)));
    assert_eq!((rig.counters(0), rig.counters(1)), ((128, 0), (136, 0)));
    assert_eq!(rig.receive(1), None);
}

#[test]
fn the_loser_of_a_bit_waits_before_it_sends_again() {
    let mut rig = Rig::of(3);
    both_passive(&mut rig);
    rig.send(0, frame(ID, DOMINANT));
    rig.send(1, frame(ID, RECESSIVE));
    let (won, ended) = rig.next();
    assert_eq!((ended.error, ended.frame), (None, frame(ID, DOMINANT)));
    assert_eq!((rig.receive(1), rig.receive(2)), (None, Some(frame(ID, DOMINANT))));
    assert_eq!(rig.counters(1), (136, 0), "a frame that is not received counts nothing down");
    // The intermission, and suspend transmission by the error-passive sender.
    let (sent, ended) = rig.next();
    assert_eq!((ended.error, ended.frame), (None, frame(ID, RECESSIVE)));
    assert_eq!(sent, won + bits(3 + 8 + FrameBits::of(&ended.frame).on_wire()));
}

#[test]
fn a_loser_whose_counter_overruns_recovers() {
    let mut rig = Rig::of(3);
    both_passive(&mut rig);
    let mut collisions = 0;
    while rig.mode(1) != BusErrorMode::BusOff {
        collisions += 1;
        assert!(collisions <= 16, "{:?}", rig.counters(1));
        rig.send(0, frame(ID, DOMINANT));
        rig.send(1, frame(ID, RECESSIVE));
        let (_, ended) = rig.next();
        assert_eq!((ended.error, ended.frame), (None, frame(ID, DOMINANT)));
        rig.bus.drop_pending(PortId(1), rig.now);
        rig.run_for(bits(20));
    }
    assert_eq!(collisions, 16);
    // The winner's frame and the intermission count as one sequence of 11 recessive bits; then the bus is idle.
    let end = rig.ended.last().expect("the last frame").0;
    let back = end + bits(3 + 127 * 11);
    rig.run(back - Duration::from_micros(1));
    assert_eq!(rig.mode(1), BusErrorMode::BusOff);
    rig.run(back);
    assert_eq!((rig.mode(1), rig.counters(1)), (BusErrorMode::ErrorActive, (0, 0)));
    rig.send(1, frame(ID, RECESSIVE));
    assert_eq!(rig.next().1.error, None);
}

#[test]
fn events_tell_who_signals_and_every_change_of_a_mode() {
    use BusErrorMode::{BusOff, ErrorActive, ErrorPassive};

    let mut rig = Rig::of(3);
    rig.bus.set_bit_rate(PortId(2), protocol_core::controller::BitRate::Kbit500, rig.now);
    rig.run_for(Duration::from_millis(1));
    let start = rig.now;
    rig.send(0, frame(0x123, &[1, 2]));
    let (mut now, mut events) = (rig.now, Vec::new());
    rig.bus.begin(now);
    while rig.bus.next_event() <= micros(30_000) {
        now = now.max(rig.bus.next_event());
        rig.bus.finish(now);
        events.extend(rig.bus.journal.take());
        rig.bus.begin(now);
    }
    let Event { who, what, .. } = &events[0];
    let error =
        EventKind::ErrorFrame { frame: frame(0x123, &[1, 2]), start, error: BusError::Stuff, signalled_by: "c".into() };
    assert_eq!((who.as_ref(), what), ("a", &error));
    let modes: Vec<_> = events
        .iter()
        .filter_map(|event| match event.what {
            EventKind::ErrorMode { from, to } => Some((event.who.as_ref(), from, to)),
            _ => None,
        })
        .collect();
    assert_eq!(modes, [("c", ErrorActive, ErrorPassive)]);
    assert_ne!(rig.mode(0), BusOff);
}
