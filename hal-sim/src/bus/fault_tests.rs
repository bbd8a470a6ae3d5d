//! Communication faults as seen by the sender, a named receiver and a third party, to the microsecond.

use protocol_core::controller::{Controller as _, Filter};
use protocol_core::frame::{extended, standard};
use protocol_core::time::Duration;

use super::clock::bit_times;
use super::fault::{Corruption, Delay, Fault, FaultKind, FrameFilter, Masks};
use super::rig::{RATE, Rig, bits, frame};
use super::*;

pub(super) const START: Instant = Instant::from_micros(10_000);

pub(super) const fn millis(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

pub(super) fn length(frame: &protocol_core::frame::Frame) -> u32 {
    FrameBits::of(frame).on_wire()
}

/// Creates a fault that affects frames with the identifier 220h.
pub(super) fn of_220(kind: FaultKind) -> Fault {
    let frames = FrameFilter { id: Some(standard(0x220).into()), ..FrameFilter::default() };
    Fault { frames, ..Fault::new("test", kind) }
}

fn rig_with(fault: Fault) -> Rig {
    let mut rig = Rig::of(3);
    rig.bus.add_fault(fault, &[], rig.now).unwrap();
    rig
}

#[test]
fn a_lost_frame_is_on_the_bus_and_acknowledged() {
    let lose = FaultKind::Lose { receivers: vec!["b".into()] };
    let mut rig = rig_with(Fault { count: Some(1), ..of_220(lose) });
    let [first, second] = [1, 2].map(|byte| frame(0x220, &[byte]));
    rig.send(0, first);
    assert_eq!(rig.next().0, START + bits(length(&first)));
    rig.send(0, second);
    rig.run_for(millis(5));
    assert_eq!(rig.frames(), [first, second]);
    assert_eq!((rig.receive(1), rig.receive(1)), (Some(second), None));
    assert_eq!((rig.receive(2), rig.receive(2)), (Some(first), Some(second)));
    assert_eq!(rig.effects, [FaultEffect::Lost(vec!["b".into()])]);
    assert_eq!((rig.counters(0), rig.counters(1)), ((0, 0), (0, 0)));
}

#[test]
fn a_frame_is_lost_for_all() {
    let mut rig = rig_with(of_220(FaultKind::Lose { receivers: Vec::new() }));
    rig.send(0, frame(0x220, &[]));
    rig.send(1, frame(0x221, &[]));
    rig.run_for(millis(5));
    assert_eq!(rig.frames(), [frame(0x220, &[]), frame(0x221, &[])]);
    assert_eq!((rig.receive(1), rig.receive(2)), (None, Some(frame(0x221, &[]))));
}

#[test]
fn later_frames_of_the_identifier_wait_behind_a_delayed_one() {
    let delay = FaultKind::Delay { delay: Delay::Constant(millis(20)), overtake: false };
    let mut rig = rig_with(Fault { count: Some(1), ..of_220(delay) });
    let [late, behind, other] = [frame(0x220, &[1]), frame(0x220, &[2]), frame(0x300, &[])];
    rig.send(0, late);
    assert_eq!(rig.bus.port(PortId(0)).pending(), 1, "it is not sent yet");
    rig.run_for(millis(1));
    rig.send(0, behind);
    rig.send(0, other);
    rig.run_for(millis(30));
    assert_eq!(rig.frames(), [other, late, behind]);
    assert_eq!(rig.ended[1].0, START + millis(20) + bits(length(&late)));
}

#[test]
fn a_delayed_frame_is_overtaken() {
    let delay = FaultKind::Delay { delay: Delay::Constant(millis(20)), overtake: true };
    let mut rig = rig_with(Fault { count: Some(1), ..of_220(delay) });
    rig.send(0, frame(0x220, &[1]));
    rig.run_for(millis(1));
    rig.bus.end_fault("test");
    rig.send(0, frame(0x220, &[2]));
    rig.run_for(millis(30));
    assert_eq!(rig.frames(), [frame(0x220, &[2]), frame(0x220, &[1])]);
}

#[test]
fn frames_gather_until_a_burst() {
    let delay = FaultKind::Delay { delay: Delay::Burst(millis(50)), overtake: false };
    let mut rig = rig_with(of_220(delay));
    rig.run_for(millis(1));
    for byte in 0..3 {
        rig.send(0, frame(0x220, &[byte]));
        rig.run_for(millis(10));
    }
    assert_eq!(rig.frames(), []);
    rig.run_for(millis(30));
    assert_eq!(rig.frames(), [0, 1, 2].map(|byte| frame(0x220, &[byte])));
    assert_eq!(rig.ended[0].0, START + millis(50) + bits(length(&frame(0x220, &[0]))));
}

#[test]
fn a_frame_is_repeated() {
    let mut rig = rig_with(Fault { count: Some(1), ..of_220(FaultKind::Repeat { times: 2, after: millis(7) }) });
    let sent = frame(0x220, &[1]);
    rig.send(0, sent);
    rig.run_for(millis(30));
    let ends: Vec<Instant> = rig.ended.iter().map(|(at, _)| *at).collect();
    assert_eq!(ends, [0, 7, 14].map(|ms| START + millis(ms) + bits(length(&sent))));
}

/// A frame whose first copy is still to come counts towards the limit, but is not affected yet.
#[test]
fn a_repetition_counts_when_the_first_copy_is_sent() {
    let mut rig = rig_with(count_one(FaultKind::Repeat { times: 2, after: millis(50) }));
    for byte in 1..=2 {
        rig.send(0, frame(0x220, &[byte]));
        rig.run_for(millis(10));
    }
    assert_eq!(struck(&rig), (0, false));
    rig.run_for(millis(40));
    assert_eq!(struck(&rig), (1, true));
    rig.run_for(millis(100));
    assert_eq!(struck(&rig), (1, true));
    assert_eq!(rig.frames(), [1, 2, 1, 1].map(|byte| frame(0x220, &[byte])));
}

/// The copies of a device without power are dropped.
#[test]
fn a_repetition_without_a_copy_does_not_count() {
    let mut rig = rig_with(count_one(FaultKind::Repeat { times: 1, after: millis(50) }));
    rig.send(0, frame(0x220, &[1]));
    rig.run_for(millis(10));
    rig.bus.disconnect(PortId(0), rig.now);
    rig.run_for(millis(100));
    assert_eq!(struck(&rig), (0, false));
    rig.send(1, frame(0x220, &[2]));
    rig.run_for(millis(100));
    assert_eq!(struck(&rig), (1, true));
    assert_eq!(rig.frames(), [1, 2, 2].map(|byte| frame(0x220, &[byte])));
}

#[test]
fn two_frames_are_swapped_whatever_their_urgency() {
    for next in [frame(0x220, &[2]), frame(0x100, &[]), frame(0x700, &[])] {
        let mut rig = rig_with(Fault { count: Some(1), ..of_220(FaultKind::Swap { within: millis(1000) }) });
        rig.send(0, frame(0x220, &[1]));
        rig.run_for(millis(3));
        assert_eq!(rig.frames(), []);
        rig.send(0, next);
        rig.run_for(millis(3));
        assert_eq!(rig.frames(), [next, frame(0x220, &[1])]);
    }
}

#[test]
fn a_frame_without_a_successor_is_not_swapped() {
    let mut rig = rig_with(of_220(FaultKind::Swap { within: millis(1000) }));
    let sent = frame(0x220, &[1]);
    rig.send(0, sent);
    rig.run_for(millis(1100));
    assert_eq!(rig.ended[0].0, START + millis(1000) + bits(length(&sent)));
    assert_eq!(struck(&rig), (0, false), "a swap without a successor affects no frame");
    rig.send(0, sent);
    rig.send(0, sent);
    rig.run_for(millis(5));
    assert_eq!(struck(&rig), (1, false));
}

/// Frames that still wait for their successors count towards the limit.
#[test]
fn a_swap_exchanges_no_more_than_its_count() {
    let mut rig = rig_with(count_one(SWAP));
    for port in [0, 1, 0, 1] {
        rig.send(port, frame(0x220, &[port as u8]));
        rig.run_for(millis(3));
    }
    assert_eq!(struck(&rig), (1, true));
    // The second sender was not held back.
    assert_eq!(rig.frames(), [1, 0, 0, 1].map(|port| frame(0x220, &[port])));
}

/// Two faults that swap the same frame exchange it once.
#[test]
fn two_swaps_of_one_frame_are_one() {
    let mut rig = rig_with(count_one(SWAP));
    rig.bus.add_fault(named("other", count_one(SWAP)), &[], rig.now).unwrap();
    for byte in 1..=4 {
        rig.send(0, frame(0x220, &[byte]));
        rig.run_for(millis(3));
    }
    assert_eq!(rig.frames(), [2, 1, 4, 3].map(|byte| frame(0x220, &[byte])));
    assert_eq!(rig.bus.faults(rig.now).map(|state| state.struck).collect::<Vec<_>>(), [1, 1]);
}

/// Returns the number of affected frames of the first fault, and whether the fault is over.
fn struck(rig: &Rig) -> (u64, bool) {
    let state = rig.bus.faults(rig.now).next().unwrap();
    (state.struck, state.is_over)
}

#[test]
fn identifier_length_and_data_are_corrupted() {
    let corruption = Corruption {
        id: Masks { toggle: 0x001, ..Masks::default() },
        dlc: Masks { set: 0x04, ..Masks::default() },
        data: Masks { set: [0x0F; 8], clear: [0, 0, 0x01, 0, 0, 0, 0, 0], toggle: [0x80, 0, 0, 0, 0, 0, 0, 0] },
    };
    let mut rig = rig_with(of_220(FaultKind::Corrupt(corruption)));
    rig.send(0, frame(0x220, &[0x10, 0x20]));
    rig.run_for(millis(3));
    let corrupted = frame(0x221, &[0x9F, 0x2F, 0x0E, 0x0F, 0x0F, 0x0F]);
    assert_eq!(rig.frames(), [corrupted]);
    assert_eq!(rig.receive(1), Some(corrupted));
    assert_eq!(rig.effects, [FaultEffect::Corrupted(corrupted)]);
}

#[test]
fn a_mask_compares_some_bits_of_one_format() {
    let frames = FrameFilter { id: Some(standard(0x200).into()), mask: Some(0x780), ..FrameFilter::default() };
    let lose = FaultKind::Lose { receivers: Vec::new() };
    let mut rig = rig_with(Fault { frames, ..Fault::new("test", lose) });
    for id in [0x200, 0x27F, 0x280] {
        rig.send(0, frame(id, &[]));
        rig.run_for(millis(3));
    }
    rig.send(0, protocol_core::frame::Frame::of(extended(0x200).into(), &[]).unwrap());
    rig.run_for(millis(3));
    let received: Vec<_> = std::iter::from_fn(|| rig.receive(1)).collect();
    assert_eq!(received.len(), 2);
    assert_eq!(received[0], frame(0x280, &[]));
}

/// ISO 11898-1, 10.4.6: a receiver accepts a frame without an error up to the last but one bit of the end of frame; the
/// transmitter requires that the last bit is correct, too.
#[test]
fn an_omitted_frame_is_had_twice_by_the_others() {
    let omit = FaultKind::Omit { receivers: vec!["b".into()] };
    let mut rig = rig_with(Fault { count: Some(1), ..of_220(omit) });
    let sent = frame(0x220, &[1, 2, 3]);
    rig.send(0, sent);
    // The unaffected receivers accept the frame with the last but one bit; the error flag begins with the last bit.
    let accepted = START + bits(length(&sent) - 1);
    rig.run(accepted - Duration::from_ticks(1));
    assert_eq!(rig.receive(2), None);
    rig.run(accepted);
    assert_eq!((rig.receive(1), rig.receive(2)), (None, Some(sent)));
    let failed = rig.next();
    assert_eq!(failed.1.error, Some(BusError::Bit));
    // The error flag, the overload flag of the other receivers one bit later, and the delimiter.
    assert_eq!(failed.0, accepted + bits(6 + 1 + 8));
    // TEC of the sender, REC of the receiver that detected the error first; an overload condition does not change a
    // REC.
    assert_eq!((rig.counters(0), rig.counters(1), rig.counters(2)), ((8, 0), (0, 9), (0, 0)));
    assert_eq!(rig.next().0, failed.0 + bits(INTERMISSION + length(&sent)));
    assert_eq!((rig.receive(1), rig.receive(2), rig.receive(2)), (Some(sent), Some(sent), None));
    assert_eq!(rig.effects, [FaultEffect::Omitted(vec!["b".into()])]);
}

#[test]
fn a_destroyed_frame_is_repeated_by_its_controller() {
    let mut rig = rig_with(Fault { count: Some(2), ..of_220(FaultKind::Destroy) });
    rig.send(0, frame(0x220, &[1]));
    let errors = [rig.next().1.error, rig.next().1.error, rig.next().1.error];
    assert_eq!(errors, [Some(BusError::Bit), Some(BusError::Bit), None]);
    assert_eq!(rig.receive(1), Some(frame(0x220, &[1])));
}

#[test]
fn a_fault_has_a_begin_and_an_end() {
    let lose = FaultKind::Lose { receivers: Vec::new() };
    let mut rig = rig_with(Fault { from: millis(10), lasts: Some(millis(20)), ..of_220(lose) });
    for byte in 0..4 {
        rig.send(0, frame(0x220, &[byte]));
        rig.run_for(millis(10));
    }
    let received: Vec<_> = std::iter::from_fn(|| rig.receive(1)).collect();
    assert_eq!(received, [frame(0x220, &[0]), frame(0x220, &[3])]);
    let state = rig.bus.faults(rig.now).next().unwrap();
    assert_eq!((state.struck, state.is_over), (2, true));
}

#[test]
fn a_fault_that_never_strikes_changes_nothing() {
    let kinds = [
        FaultKind::Lose { receivers: Vec::new() },
        FaultKind::Delay { delay: Delay::Constant(millis(1)), overtake: false },
        FaultKind::Repeat { times: 1, after: millis(1) },
        FaultKind::Swap { within: millis(1) },
        FaultKind::Corrupt(Corruption { dlc: Masks { set: 1, ..Masks::default() }, ..Corruption::default() }),
        FaultKind::Insert { frame: frame(0x220, &[]), every: Some(millis(1)) },
        FaultKind::Destroy,
        FaultKind::Omit { receivers: vec!["b".into()] },
    ];
    let run = |kinds: &[FaultKind]| {
        let mut rig = Rig::of(3);
        for (number, kind) in kinds.iter().enumerate() {
            let fault = Fault { probability: 0, ..Fault::new(&number.to_string(), kind.clone()) };
            rig.bus.add_fault(fault, &[], rig.now).unwrap();
        }
        let mut random = fastrand::Rng::with_seed(1);
        for _ in 0..500 {
            let port = PortId(random.usize(..3));
            let offered = frame(random.u16(0x200..0x204), &[random.u8(..)]);
            // The three transmit buffers of bxCAN refuse frames and return displaced frames.
            let answer = rig.bus.hand_over(port, &offered, rig.now);
            rig.bus.refresh(port, rig.now);
            rig.run_for(Duration::from_micros(random.u64(..400)));
            rig.ended
                .push((rig.now, super::rig::Ended { from: format!("{answer:?}").into(), frame: offered, error: None }));
        }
        (rig.ended, rig.effects)
    };
    assert_eq!(run(&kinds), run(&[]));
}

#[test]
fn a_bad_fault_is_refused() {
    let mut rig = Rig::of(2);
    let lose = || FaultKind::Lose { receivers: vec!["nobody".into()] };
    let refused = rig.bus.add_fault(Fault::new("x", lose()), &[], START).unwrap_err();
    assert_eq!(refused.to_string(), "no device or client 'nobody'; known: a, b");
    let all = || FaultKind::Lose { receivers: Vec::new() };
    let cases = [
        (Fault { probability: 1_000_001, ..Fault::new("x", all()) }, "the probability must not exceed 1"),
        (Fault { count: Some(0), ..Fault::new("x", all()) }, "count must be at least 1"),
        (Fault::new("x", FaultKind::Omit { receivers: Vec::new() }), "omit needs receivers"),
        (Fault::new("x", FaultKind::Corrupt(Corruption::default())), "corrupt needs at least one mask"),
        (Fault { from: Duration::MAX, ..Fault::new("x", all()) }, "durations must not exceed one day"),
        (Fault::new("x", FaultKind::Repeat { times: 0, after: millis(1) }), "times must be from 1 to 1000"),
    ];
    for (fault, reason) in cases {
        assert_eq!(rig.bus.add_fault(fault, &[], START).unwrap_err().to_string(), reason);
    }
    assert_eq!(rig.bus.faults(START).count(), 0);
    for number in 0..MAX_FAULTS {
        rig.bus.add_fault(Fault::new(&number.to_string(), all()), &[], START).unwrap();
    }
    assert_eq!(rig.bus.add_fault(Fault::new("0", all()), &[], START), Err(FaultError::Taken("0".into())));
    assert_eq!(rig.bus.add_fault(Fault::new("x", all()), &[], START), Err(FaultError::TooMany));
    assert!(rig.bus.end_fault("7") && !rig.bus.end_fault("7"));
    assert_eq!(rig.bus.add_fault(Fault::new("x", all()), &[], START), Ok(()));
}

/// Delayed frames hold back later frames of the device, up to a limit.
#[test]
fn a_device_is_held_back_by_delayed_frames() {
    let delay = FaultKind::Delay { delay: Delay::Constant(millis(500)), overtake: false };
    let mut rig = rig_with(of_220(delay));
    let taken = (0..1000).filter(|_| rig.bus.hand_over(PortId(0), &frame(0x220, &[]), START).is_ok()).count();
    assert_eq!(taken, 256);
    assert_eq!(rig.bus.port(PortId(0)).pending(), 256);
    rig.run_for(millis(600));
    assert_eq!(rig.frames().len(), 256);
    let first = Duration::from_nanos(bit_times(length(&frame(0x220, &[])), RATE));
    assert_eq!(rig.ended[0].0, START + millis(500) + first);
}

fn count_one(kind: FaultKind) -> Fault {
    Fault { count: Some(1), ..of_220(kind) }
}

pub(super) fn named(name: &str, fault: Fault) -> Fault {
    Fault { name: name.into(), ..fault }
}

pub(super) const SWAP: FaultKind = FaultKind::Swap { within: millis(1000) };

pub(super) fn delay(ms: u64) -> FaultKind {
    FaultKind::Delay { delay: Delay::Constant(millis(ms)), overtake: false }
}

#[test]
fn time_goes_on_with_a_frame_behind_two_swapped_ones() {
    let mut rig = rig_with(count_one(SWAP));
    rig.send(0, frame(0x220, &[1]));
    rig.send(0, frame(0x220, &[2]));
    rig.send(0, frame(0x100, &[3]));
    rig.run_for(millis(10));
    // The last two frames are in the controller together; the more urgent one is sent first.
    assert_eq!(rig.frames(), [frame(0x220, &[2]), frame(0x100, &[3]), frame(0x220, &[1])]);
}

#[test]
fn frames_are_swapped_in_pairs() {
    let mut rig = rig_with(of_220(SWAP));
    for byte in 1..=6 {
        rig.send(0, frame(0x220, &[byte]));
        rig.run_for(millis(10));
    }
    assert_eq!(rig.frames(), [2, 1, 4, 3, 6, 5].map(|byte| frame(0x220, &[byte])));
}

#[test]
fn a_fault_of_the_next_frame_does_not_undo_a_swap() {
    for other in [delay(5), FaultKind::Repeat { times: 1, after: millis(20) }] {
        let mut rig = rig_with(count_one(SWAP));
        rig.send(0, frame(0x220, &[1]));
        rig.bus.add_fault(named("other", of_220(other)), &[], rig.now).unwrap();
        rig.send(0, frame(0x220, &[2]));
        rig.run_for(millis(100));
        assert_eq!(rig.frames()[..2], [2, 1].map(|byte| frame(0x220, &[byte])));
    }
}

/// The hazard of a repetition: old content is sent after newer content.
#[test]
fn a_copy_comes_after_a_newer_frame() {
    let mut rig = rig_with(count_one(FaultKind::Repeat { times: 1, after: millis(50) }));
    rig.send(0, frame(0x220, &[1]));
    rig.run_for(millis(10));
    rig.send(0, frame(0x220, &[2]));
    rig.run_for(millis(100));
    assert_eq!(rig.frames(), [1, 2, 1].map(|byte| frame(0x220, &[byte])));
}

/// bxCAN returns a frame that a more urgent frame displaces; the device offers it again.
#[test]
fn a_frame_that_is_given_back_is_struck_once() {
    let toggle = Masks { toggle: [0x80, 0, 0, 0, 0, 0, 0, 0], ..Masks::default() };
    let kinds = [
        FaultKind::Corrupt(Corruption { data: toggle, ..Corruption::default() }),
        FaultKind::Repeat { times: 1, after: millis(1) },
    ];
    for kind in kinds {
        let mut rig = rig_with(of_220(kind));
        rig.send(1, frame(0x001, &[0; 8]));
        rig.bus.begin(rig.now);
        let mut offered: std::collections::VecDeque<_> = [0x220, 0x210, 0x200, 0x1F0].map(|id| frame(id, &[1])).into();
        for _ in 0..100 {
            if let Some(frame) = offered.pop_front() {
                match rig.bus.hand_over(PortId(0), &frame, rig.now) {
                    Ok(returned) => offered.extend(returned),
                    Err(_) => offered.push_back(frame),
                }
                rig.bus.refresh(PortId(0), rig.now);
            }
            rig.run_for(Duration::from_micros(300));
        }
        assert_eq!(rig.effects.len(), 1, "{:?}", rig.effects);
    }
}

#[test]
fn an_abort_makes_room_for_what_waits_behind() {
    let mut rig = rig_with(count_one(SWAP));
    rig.send(1, frame(0x001, &[0; 8]));
    rig.bus.begin(rig.now);
    rig.send(0, frame(0x220, &[1]));
    rig.send(0, frame(0x300, &[]));
    let next = protocol_core::frame::key(standard(0x300).into());
    DeviceCan::new(&mut rig.bus, PortId(0), rig.now).abort(Filter::exactly(next));
    rig.bus.refresh(PortId(0), rig.now);
    rig.run_for(millis(10));
    assert_eq!(rig.frames(), [frame(0x001, &[0; 8]), frame(0x220, &[1])]);
}

#[test]
fn an_omission_without_its_receiver_is_none() {
    let mut rig = rig_with(count_one(FaultKind::Omit { receivers: vec!["b".into()] }));
    let sent = frame(0x220, &[1]);
    rig.send(0, sent);
    rig.run_for(bits(20));
    rig.bus.disconnect(PortId(1), rig.now);
    rig.run_for(millis(5));
    assert_eq!((rig.ended.len(), rig.frames(), rig.receive(2)), (1, vec![sent], Some(sent)));
    assert_eq!(rig.ended[0].0, START + bits(length(&sent)));
    rig.send(0, sent);
    rig.run_for(millis(5));
    assert_eq!(rig.bus.faults(rig.now).next().unwrap().struck, 1, "nobody of that name listens");
}

#[test]
fn a_frame_that_its_only_receiver_sends_is_not_lost() {
    let mut rig = rig_with(of_220(FaultKind::Lose { receivers: vec!["b".into()] }));
    rig.send(1, frame(0x220, &[]));
    rig.run_for(millis(5));
    assert_eq!(rig.effects, []);
}
