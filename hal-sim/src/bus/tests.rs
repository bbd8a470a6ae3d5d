//! The bus alone, without devices: timing, arbitration, errors, bus-off.

use embedded_can::nb::Can;
use protocol_core::controller::{Controller, Filter, Filters};
use protocol_core::frame::{Frame, extended, standard};
use protocol_core::time::Duration;

use super::rig::{EMPTY, RATE, Rig, bits, frame, micros};
use super::*;

#[test]
fn a_frame_takes_its_bits_at_every_bit_rate() {
    for (rate, bit_ns) in [
        (BitRate::Kbit1000, 1_000),
        (BitRate::Kbit800, 1_250),
        (BitRate::Kbit500, 2_000),
        (BitRate::Kbit250, 4_000),
        (BitRate::Kbit125, 8_000),
        (BitRate::Kbit10, 100_000),
    ] {
        let mut rig = Rig::at(rate, 3);
        let start = rig.now.as_micros() * 1000;
        let sent = [frame(EMPTY, &[]), frame(EMPTY + 1, &[])];
        let [one, two] = sent.map(|frame| u64::from(FrameBits::of(&frame).on_wire()));
        rig.send(0, sent[0]);
        rig.send(2, sent[1]);
        // The second frame follows after three bits of intermission, to the nanosecond.
        let first = start + one * bit_ns;
        assert_eq!(rig.next().0, micros(first.div_ceil(1000)), "{rate:?}");
        assert_eq!(rig.next().0, micros((first + (3 + two) * bit_ns).div_ceil(1000)), "{rate:?}");
        assert_eq!((rig.receive(1), rig.receive(1), rig.receive(1)), (Some(sent[0]), Some(sent[1]), None));
        assert_eq!(rig.receive(0), Some(sent[1]));
    }
}

#[test]
fn the_lowest_identifier_wins_the_bus() {
    let mut rig = Rig::of(4);
    let data = frame(0x300, &[]);
    let remote = Frame::remote(standard(0x300).into(), 0);
    let long = Frame::of(extended(0x300 << 18).into(), &[]).unwrap();
    rig.send(0, frame(0x301, &[]));
    rig.send(1, long);
    rig.send(2, remote);
    rig.send(3, data);
    rig.run_for(Duration::from_millis(10));
    assert_eq!(rig.frames(), [data, remote, long, frame(0x301, &[])]);
}

#[test]
fn a_frame_on_the_wire_is_not_interrupted() {
    let mut rig = Rig::of(3);
    rig.send(0, frame(0x700, &[0; 8]));
    rig.run_for(bits(20));
    rig.send(1, frame(0x200, &[]));
    rig.send(2, frame(0x100, &[]));
    rig.run_for(Duration::from_millis(10));
    assert_eq!(rig.frames(), [frame(0x700, &[0; 8]), frame(0x100, &[]), frame(0x200, &[])]);
}

#[test]
fn a_lone_sender_becomes_error_passive_and_stays_so() {
    let mut rig = Rig::of(1);
    let sent = frame(EMPTY, &[]);
    rig.send(0, sent);
    let first = rig.next();
    assert_eq!(first.1.error, Some(BusError::Acknowledgement));
    assert_eq!(first.1.from.as_ref(), "a");
    // An attempt up to the ACK slot, error flag and delimiter; the retransmission follows after the intermission.
    let attempt = FrameBits::of(&sent).on_wire() - 8 + 6 + 8;
    assert_eq!(first.0, micros(10_000) + bits(attempt));
    assert_eq!(rig.next().0, first.0 + bits(3 + attempt));
    for errors in 3..=16 {
        assert_eq!(rig.mode(0), BusErrorMode::ErrorActive);
        let _ = rig.next();
        assert_eq!(rig.counters(0), (8 * errors, 0));
    }
    assert_eq!(rig.mode(0), BusErrorMode::ErrorPassive);
    let before = rig.next().0;
    assert_eq!(rig.next().0 - before, bits(3 + 8 + attempt), "an error-passive sender waits eight bits more");
    rig.run_for(Duration::from_secs(2));
    assert_eq!((rig.counters(0), rig.mode(0)), ((128, 0), BusErrorMode::ErrorPassive));

    // A late listener acknowledges, so the frame is sent.
    let late = rig.bus.add_client("late".into(), RATE, usize::MAX, rig.now);
    rig.run_for(Duration::from_millis(5));
    assert_eq!(rig.frames(), [sent]);
    assert_eq!((rig.counters(0), rig.mode(0)), ((127, 0), BusErrorMode::ErrorActive));
    assert_eq!(rig.receive(late.0), Some(sent));
}

#[test]
fn a_sender_that_nobody_understands_goes_bus_off_and_recovers() {
    let mut rig = Rig::of(3);
    rig.bus.inject(DestroyNext::frames_of("a", 32));
    rig.send(0, frame(0x123, &[1]));
    let mut last = rig.now;
    for errors in 1..=32 {
        let (at, ended) = rig.next();
        assert_eq!(ended.error, Some(BusError::Bit));
        assert_eq!(rig.counters(0).0, 8 * errors);
        assert_eq!(rig.counters(1), (0, errors));
        last = at;
    }
    assert_eq!(rig.mode(0), BusErrorMode::BusOff);
    assert_eq!(rig.mode(1), BusErrorMode::ErrorActive);

    // On an idle bus, the port recovers 128 × 11 bits later and sends its pending frame immediately.
    let back = last + bits(128 * 11);
    rig.run(back - Duration::from_micros(1));
    assert_eq!(rig.mode(0), BusErrorMode::BusOff);
    rig.run(back);
    assert_eq!((rig.mode(0), rig.counters(0)), (BusErrorMode::ErrorActive, (0, 0)));
    let (at, ended) = rig.next();
    assert_eq!((ended.error, ended.frame), (None, frame(0x123, &[1])));
    assert_eq!(at, back + bits(FrameBits::of(&ended.frame).on_wire()));
}

#[test]
fn frames_of_others_count_towards_recovery_once_each() {
    let mut rig = Rig::of(3);
    rig.bus.force_bus_off(PortId(0), true, rig.now);
    rig.run_for(Duration::from_secs(1));
    assert_eq!(rig.mode(0), BusErrorMode::BusOff, "kept off the bus");
    rig.bus.force_bus_off(PortId(0), false, rig.now);
    let start = rig.now;
    // Back to back, each frame with its intermission is one sequence of 11 recessive bits.
    let sent = frame(EMPTY, &[]);
    for _ in 0..27 {
        rig.send(1, sent);
        let _ = rig.next();
    }
    rig.run_for(bits(3));
    let busy = bits(27 * (FrameBits::of(&sent).on_wire() + 3));
    let back = start + busy + bits((128 - 27) * 11);
    rig.run(back - Duration::from_micros(1));
    assert_eq!(rig.mode(0), BusErrorMode::BusOff);
    rig.run(back);
    assert_eq!(rig.mode(0), BusErrorMode::ErrorActive);
    assert_eq!(rig.receive(0), None, "nothing is heard while bus-off");
    assert_eq!(rig.bus.port(PortId(1)).confinement(), Confinement::default());
}

#[test]
fn a_listener_at_another_rate_disturbs_until_it_is_error_passive() {
    let mut rig = Rig::of(3);
    rig.bus.set_bit_rate(PortId(2), BitRate::Kbit500, rig.now);
    rig.run_for(Duration::from_millis(1));
    let sent = frame(0x123, &[1, 2]);
    rig.send(0, sent);
    let (_, ended) = rig.next();
    assert_eq!(ended.error, Some(BusError::Stuff));
    assert_eq!((rig.counters(0), rig.counters(1), rig.counters(2)), ((8, 0), (0, 1), (0, 9)));
    rig.run_for(Duration::from_millis(50));
    // 15 × 9 = 135: the listener is error-passive, so the frame is sent.
    assert_eq!(rig.ended.len(), 16);
    assert_eq!(rig.frames(), [sent]);
    assert_eq!(rig.mode(2), BusErrorMode::ErrorPassive);
    assert_eq!((rig.counters(0), rig.counters(1)), ((119, 0), (0, 14)));
    assert_eq!(rig.receive(1), Some(sent));
    assert_eq!(rig.receive(2), None);
}

#[test]
fn a_sender_at_another_rate_disturbs_and_ends_bus_off() {
    let mut rig = Rig::of(3);
    rig.bus.set_bit_rate(PortId(2), BitRate::Kbit125, rig.now);
    rig.run_for(Duration::from_millis(1));
    rig.send(2, frame(0x100, &[]));
    for errors in 1..=32 {
        assert_eq!(rig.next().1.error, Some(BusError::Stuff));
        assert_eq!(rig.counters(2), (8 * errors, 0));
        assert_eq!((rig.counters(0), rig.counters(1)), ((0, errors), (0, errors)));
    }
    assert_eq!(rig.mode(2), BusErrorMode::BusOff);
    rig.send(0, frame(0x200, &[]));
    assert_eq!(rig.next().1.error, None, "the others have the bus to themselves");
}

#[test]
fn equal_frames_sent_at_once_are_one() {
    let mut rig = Rig::of(3);
    rig.send(0, frame(0x700, &[0]));
    rig.send(1, frame(0x700, &[0]));
    rig.run_for(Duration::from_millis(5));
    assert_eq!(rig.frames(), [frame(0x700, &[0])]);
    assert_eq!((rig.receive(0), rig.receive(1)), (None, None));
    assert_eq!((rig.receive(2), rig.receive(2)), (Some(frame(0x700, &[0])), None));
}

#[test]
fn one_identifier_with_different_data_collides_until_one_gives_up_loudly() {
    let mut rig = Rig::of(3);
    rig.send(0, frame(0x700, &[0x7F]));
    rig.send(1, frame(0x700, &[0x05]));
    let (at, ended) = rig.next();
    assert_eq!(ended.error, Some(BusError::Bit));
    let parting = FrameBits::of(&frame(0x700, &[0x7F])).first_difference(FrameBits::of(&frame(0x700, &[0x05])));
    let parting = parting.unwrap().bit;
    assert_eq!(at, micros(10_000) + bits(parting + 1 + 20));
    assert_eq!((rig.counters(0), rig.counters(1), rig.counters(2)), ((8, 0), (8, 0), (0, 1)));
    rig.run_for(Duration::from_millis(40));
    // Both are error-passive after 16 attempts; from then on the recessive sender cannot destroy the dominant frame.
    let errors = rig.ended.iter().filter(|(_, ended)| ended.error.is_some()).count();
    assert_eq!(errors, 16);
    assert_eq!(rig.frames(), [frame(0x700, &[0x05]), frame(0x700, &[0x7F])]);
}

#[test]
fn a_sender_that_loses_its_power_breaks_its_frame_off() {
    let mut rig = Rig::of(3);
    rig.send(0, frame(0x123, &[0; 8]));
    rig.run_for(bits(30));
    rig.bus.disconnect(PortId(0), rig.now);
    let (at, ended) = rig.next();
    assert_eq!((ended.error, ended.from.as_ref()), (Some(BusError::Stuff), "a"));
    assert_eq!(at, micros(10_000) + bits(30 + 20));
    assert_eq!((rig.counters(1), rig.counters(2)), ((0, 1), (0, 1)));
    rig.run_for(Duration::from_secs(1));
    assert_eq!((rig.ended.len(), rig.receive(1)), (1, None));
}

/// ISO 11898-1, 10.4: the sender sends recessive bits after the CRC sequence, so its silence changes none of them.
#[test]
fn a_frame_whose_sender_loses_its_power_after_the_crc_is_received() {
    let sent = frame(0x123, &[0; 8]);
    let length = FrameBits::of(&sent).on_wire();
    // CRC delimiter, ACK slot, ACK delimiter and end of frame.
    let trailer = 1 + 1 + 1 + 7;
    for (left, error) in [(trailer + 1, Some(BusError::Stuff)), (trailer, None), (1, None)] {
        let mut rig = Rig::of(3);
        rig.send(0, sent);
        rig.run_for(bits(length - left));
        rig.bus.disconnect(PortId(0), rig.now);
        let (at, ended) = rig.next();
        assert_eq!((ended.error, ended.from.as_ref()), (error, "a"), "{left}");
        let (end, count) = if error.is_none() { (length, 0) } else { (length - left + 20, 1) };
        assert_eq!(at, micros(10_000) + bits(end), "{left}");
        assert_eq!((rig.counters(1), rig.counters(2)), ((0, count), (0, count)), "{left}");
        rig.run_for(Duration::from_secs(1));
        assert_eq!((rig.ended.len(), rig.receive(1)), (1, error.is_none().then_some(sent)), "{left}");
    }
}

#[test]
fn a_restarted_device_does_not_receive_its_own_frame() {
    let sent = frame(0x123, &[0; 8]);
    let mut rig = Rig::of(2);
    rig.send(0, sent);
    rig.run_for(bits(FrameBits::of(&sent).on_wire() - 1));
    rig.bus.drop_own(PortId(0), rig.now);
    rig.run_for(Duration::from_millis(10));
    assert_eq!((rig.frames(), rig.receive(0), rig.receive(1)), (vec![sent], None, Some(sent)));
}

#[test]
fn a_frame_whose_last_listener_goes_is_not_acknowledged() {
    let mut rig = Rig::of(2);
    rig.send(0, frame(0x123, &[]));
    rig.run_for(bits(10));
    rig.bus.disconnect(PortId(1), rig.now);
    assert_eq!(rig.next().1.error, Some(BusError::Acknowledgement));
    assert_eq!(rig.counters(0), (8, 0));
}

#[test]
fn a_controller_takes_part_after_eleven_recessive_bits() {
    let mut rig = Rig::of(2);
    let late = rig.bus.add_device("late".into(), RATE);
    rig.bus.connect(late, rig.now);
    rig.send(late.0, frame(0x123, &[]));
    let length = FrameBits::of(&frame(0x123, &[])).on_wire();
    assert_eq!(rig.next().0, micros(10_000) + bits(11 + length));

    // A port that joins during a frame does not receive it, but completes bus integration at its end.
    rig.run_for(bits(3));
    let now = rig.now;
    rig.send(0, frame(0x124, &[]));
    rig.run_for(bits(10));
    let later = rig.bus.add_device("later".into(), RATE);
    rig.bus.connect(later, rig.now);
    rig.send(later.0, frame(0x100, &[]));
    let first = FrameBits::of(&frame(0x124, &[])).on_wire();
    assert_eq!(rig.next().0, now + bits(first));
    let second = FrameBits::of(&frame(0x100, &[])).on_wire();
    assert_eq!(rig.next().0, now + bits(first + 3 + second));
    assert_eq!(rig.receive(later.0), None);
}

#[test]
fn random_bit_errors_delay_but_lose_nothing() {
    let run = |seed| {
        let mut rig = Rig::of(2);
        rig.bus.inject(BitErrors::one_in(500, seed).unwrap());
        for number in 0..100 {
            rig.send(0, frame(0x200, &[number]));
            rig.run_for(Duration::from_millis(20));
        }
        let expected: Vec<_> = (0..100).map(|number| frame(0x200, &[number])).collect();
        assert_eq!(rig.frames(), expected);
        let received: Vec<_> = std::iter::from_fn(|| rig.receive(1)).collect();
        assert_eq!(received, expected);
        assert!(rig.ended.len() > 105, "errors were to be expected: {}", rig.ended.len());
        rig.ended
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn the_load_is_that_of_the_last_second() {
    let mut rig = Rig::of(2);
    assert_eq!(rig.bus.load(rig.now), 0);
    let sent = frame(0x555, &[0x55; 8]);
    let length = FrameBits::of(&sent).on_wire() + 3;
    // A quarter of a second at 250 kbit/s.
    let count = 62_500 / length;
    for _ in 0..count {
        rig.send(0, sent);
        let _ = rig.next();
    }
    let busy = rig.now;
    assert!((24..=25).contains(&rig.bus.load(busy)), "{}", rig.bus.load(busy));
    assert!((24..=25).contains(&rig.bus.load(busy + Duration::from_millis(700))));
    assert_eq!(rig.bus.load(busy + Duration::from_millis(1100)), 0);
    assert_eq!(rig.bus.load(busy + Duration::from_secs(1000)), 0);
}

#[test]
fn filters_keep_frames_away_and_not_the_error_counters() {
    let mut rig = Rig::of(3);
    rig.bus.inject(DestroyNext::frames(3));
    rig.send(0, frame(1, &[]));
    rig.run_for(Duration::from_millis(10));
    assert_eq!(rig.receive(1), Some(frame(1, &[])), "everything passes where there are none");
    assert_eq!((rig.counters(1), rig.counters(2)), ((0, 2), (0, 2)));
    let one = Filters::from_iter([Filter { key: 0x100, mask: !0xF }, Filter::exactly(0x10F), Filter::exactly(0x200)]);
    for (filters, passing) in
        [(one, [true, true, false]), (Filters::from_iter([Filter::exactly(0x110)]), [false, false, true])]
    {
        rig.bus.port_mut(PortId(1)).set_filters(&filters);
        rig.bus.refresh(PortId(1), rig.now);
        for (sent, passes) in [
            (frame(0x10F, &[]), passing[0]),
            (frame(0x200, &[]), passing[1]),
            (frame(0x110, &[]), passing[2]),
            (frame(0x120, &[]), false),
            (Frame::remote(standard(0x100).into(), 0), false),
            (Frame::of(extended(0x100).into(), &[]).unwrap(), false),
        ] {
            rig.send(0, sent);
            rig.run_for(Duration::from_millis(10));
            assert_eq!(rig.receive(1), passes.then_some(sent), "{sent}");
            assert_eq!(rig.receive(1), None, "{sent} once");
        }
    }
    assert_eq!((rig.counters(1), rig.counters(2)), ((0, 0), (0, 0)));
}

#[test]
fn overruns_are_counted() {
    let mut port = Port::alone("a", RATE);
    for _ in 0..RECEIVE_QUEUE + 3 {
        port.deliver(&frame(1, &[]), micros(0));
    }
    assert_eq!(port.overruns(), 3);
    assert_eq!(std::iter::from_fn(|| port.receive().ok()).count(), RECEIVE_QUEUE);
}

mod mailboxes {
    use super::*;

    const WAIT: nb::Result<Option<Frame>, std::convert::Infallible> = Err(nb::Error::WouldBlock);

    fn device() -> Port {
        Port::alone("a", RATE)
    }

    fn pending(port: &mut Port) -> Vec<Frame> {
        let mut left = Vec::new();
        while let Some(head) = port.transmit.head().copied() {
            port.transmit.sending();
            port.transmit.sent(true);
            left.push(head);
        }
        left
    }

    #[test]
    fn beyond_the_first_frame_only_a_more_urgent_one_is_taken() {
        let mut port = device();
        assert_eq!(port.transmit(&frame(0x200, &[1])), Ok(None));
        assert_eq!(port.transmit(&frame(0x200, &[2])), WAIT, "equal identifiers keep their order");
        assert_eq!(port.transmit(&frame(0x300, &[])), WAIT);
        assert_eq!(port.transmit(&frame(0x100, &[])), Ok(None));
        assert_eq!(port.transmit(&frame(0x180, &[])), WAIT, "more urgent than one of them is not enough");
        assert_eq!(pending(&mut port), [frame(0x100, &[]), frame(0x200, &[1])]);
        assert_eq!(port.transmit(&frame(0x300, &[])), Ok(None));
    }

    #[test]
    fn a_full_controller_gives_back_the_least_urgent_frame() {
        let mut port = device();
        for id in [0x300, 0x200, 0x100] {
            assert_eq!(port.transmit(&frame(id, &[])), Ok(None));
        }
        assert_eq!(port.transmit(&frame(0x250, &[])), WAIT);
        assert_eq!(port.transmit(&frame(0x080, &[])), Ok(Some(frame(0x300, &[]))));
        assert_eq!(port.pending(), 3);
        assert_eq!(pending(&mut port), [0x080, 0x100, 0x200].map(|id| frame(id, &[])));
    }

    #[test]
    fn a_frame_on_the_wire_is_never_given_back() {
        let mut port = device();
        port.transmit(&frame(0x300, &[])).unwrap();
        port.transmit.sending();
        port.transmit(&frame(0x200, &[])).unwrap();
        port.transmit(&frame(0x100, &[])).unwrap();
        assert_eq!(port.transmit(&frame(0x080, &[])), Ok(Some(frame(0x200, &[]))));
        assert_eq!(port.transmit(&frame(0x150, &[])), WAIT);
    }

    #[test]
    fn an_abort_drops_what_waits_and_does_not_repeat_what_is_on_the_wire() {
        for success in [true, false] {
            let mut port = device();
            port.transmit(&frame(0x300, &[])).unwrap();
            port.transmit.sending();
            port.transmit(&frame(0x200, &[])).unwrap();
            port.transmit(&frame(0x100, &[])).unwrap();
            port.abort(Filter::exactly(0x200));
            port.abort(Filter::exactly(0x300));
            assert_eq!(port.pending(), 2, "one is on the wire");
            port.transmit.sent(success);
            assert_eq!(pending(&mut port), [frame(0x100, &[])]);
        }
    }

    #[test]
    fn a_failed_attempt_is_repeated_after_what_has_become_more_urgent() {
        let mut port = device();
        port.transmit(&frame(0x300, &[])).unwrap();
        port.transmit.sending();
        port.transmit(&frame(0x200, &[])).unwrap();
        port.transmit.sent(false);
        assert_eq!(pending(&mut port), [frame(0x200, &[]), frame(0x300, &[])]);
    }
}
