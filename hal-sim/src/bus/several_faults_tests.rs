//! Several faults at one sender: each acts on the result of the previous fault.

use protocol_core::time::Duration;

use super::fault::{Delay, Fault, FaultKind};
use super::fault_tests::{START, SWAP, delay, length, millis, named, of_220};
use super::rig::{Rig, bits, frame};
use super::*;

const BURST: FaultKind = FaultKind::Delay { delay: Delay::Burst(millis(100)), overtake: false };

fn repeat(times: u32, ms: u64) -> FaultKind {
    FaultKind::Repeat { times, after: millis(ms) }
}

/// Creates a bus with faults of the frames with the identifier 220h, in this order.
fn rig_with(kinds: &[FaultKind]) -> Rig {
    let mut rig = Rig::of(3);
    for (number, kind) in kinds.iter().enumerate() {
        rig.bus.add_fault(named(&number.to_string(), of_220(kind.clone())), &[], rig.now).unwrap();
    }
    rig
}

/// Returns the whole milliseconds from the start to the end of each frame.
fn ends(rig: &Rig) -> Vec<u64> {
    rig.ended.iter().map(|(at, _)| (*at - START).as_millis()).collect()
}

fn struck(rig: &Rig) -> Vec<u64> {
    rig.bus.faults(rig.now).map(|state| state.struck).collect()
}

#[test]
fn delays_add_up() {
    let mut rig = rig_with(&[delay(20), delay(30)]);
    rig.send(0, frame(0x220, &[1]));
    rig.run_for(millis(100));
    assert_eq!(ends(&rig), [50]);
    assert_eq!(rig.effects, [20, 30].map(|ms| FaultEffect::Delayed(millis(ms))));
}

/// Every frame waits for the burst after its own time.
#[test]
fn a_burst_gathers_delayed_frames_and_copies() {
    for (first, expected, late) in
        [(delay(30), &[200][..], 90), (repeat(3, 37), &[100, 200, 200, 200], 20), (repeat(1, 20), &[100, 100], 20)]
    {
        let mut rig = rig_with(&[first.clone(), BURST]);
        rig.run_for(millis(80));
        rig.send(0, frame(0x220, &[1]));
        rig.run_for(millis(500));
        assert_eq!(ends(&rig), expected, "{first:?}");
        assert_eq!(rig.effects[1], FaultEffect::Delayed(millis(late)), "{first:?}");
    }
    // The frame itself is sent at the instant of a burst, but its copy is not.
    let mut rig = rig_with(&[repeat(1, 30), BURST]);
    rig.run_for(millis(100));
    rig.send(0, frame(0x220, &[1]));
    rig.run_for(millis(500));
    assert_eq!((ends(&rig), struck(&rig)), (vec![100, 200], vec![1, 1]));
    assert_eq!(rig.effects[1], FaultEffect::Delayed(millis(70)));
}

/// The answer delay of a slow application precedes the faults at the sender.
#[test]
fn a_burst_gathers_slow_answers() {
    let mut rig = rig_with(&[BURST]);
    let answers =
        SlowAnswers { is_answer: |_| true, from: millis(30), to: millis(30), random: fastrand::Rng::with_seed(1) };
    rig.bus.delay_answers(PortId(0), Some(answers));
    rig.run_for(millis(80));
    rig.send(0, frame(0x220, &[1]));
    rig.run_for(millis(500));
    assert_eq!(ends(&rig), [200]);
}

/// A frame that waits for its exchange has no time of its own.
#[test]
fn only_the_first_of_a_swap_and_a_delay_or_repetition_acts() {
    let (sent, next) = (frame(0x220, &[1]), frame(0x221, &[2]));
    for (kinds, effect, expected) in [
        ([SWAP, delay(30)], FaultEffect::Swapped, vec![next, sent]),
        ([SWAP, repeat(1, 5)], FaultEffect::Swapped, vec![next, sent]),
        ([delay(30), SWAP], FaultEffect::Delayed(millis(30)), vec![next, sent]),
        ([repeat(1, 5), SWAP], FaultEffect::Repeated(1), vec![sent, sent, next]),
    ] {
        let mut rig = rig_with(&kinds);
        rig.send(0, sent);
        rig.run_for(millis(10));
        rig.send(0, next);
        rig.run_for(millis(100));
        assert_eq!((rig.frames(), &rig.effects[..], struck(&rig)), (expected, &[effect][..], vec![1, 0]), "{kinds:?}");
    }
}

/// A repetition copies the frame, and not the copies of an earlier repetition.
#[test]
fn two_repetitions_add_up() {
    let mut rig = rig_with(&[repeat(1, 10), repeat(2, 20)]);
    rig.send(0, frame(0x220, &[1]));
    rig.run_for(millis(100));
    assert_eq!((ends(&rig), struck(&rig)), (vec![0, 10, 20, 40], vec![1, 1]));
}

/// A fault counts for the frame whose sender is cut off after the CRC sequence.
#[test]
fn faults_of_the_receivers_act_after_the_sender_is_gone() {
    let sent = frame(0x220, &[1, 2, 3]);
    for (kind, error) in [
        (FaultKind::Lose { receivers: vec!["b".into()] }, None),
        (FaultKind::Omit { receivers: vec!["b".into()] }, Some(BusError::Bit)),
    ] {
        let mut rig = Rig::of(3);
        let frames = FrameFilter { sender: Some("a".into()), ..FrameFilter::default() };
        rig.bus.add_fault(Fault { frames, ..Fault::new("test", kind) }, &[], rig.now).unwrap();
        rig.send(0, sent);
        rig.run_for(bits(length(&sent) - 4));
        rig.bus.disconnect(PortId(0), rig.now);
        rig.run_for(Duration::from_millis(10));
        let ended: Vec<_> = rig.ended.iter().map(|(_, ended)| (&*ended.from, ended.error)).collect();
        assert_eq!(ended, [("a", error)]);
        assert_eq!((rig.receive(1), rig.receive(2), rig.receive(2)), (None, Some(sent), None), "{error:?}");
        assert_eq!(struck(&rig), [1], "{error:?}");
    }
}
