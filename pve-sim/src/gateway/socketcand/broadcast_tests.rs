//! Subscriptions, filters and cycles, step by step.

use protocol_core::frame::standard;

use super::*;

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::of(standard(id).into(), data).unwrap()
}

fn id(raw: u16) -> Id {
    standard(raw).into()
}

const fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

#[test]
fn who_has_subscribed_to_nothing_gets_nothing() {
    let (mut broadcast, now) = (Broadcast::default(), Instant::now());
    assert!(!broadcast.deliver(&frame(0x1A0, &[1]), now));
    broadcast.subscribe(id(0x1A0), None, ms(0)).unwrap();
    assert!(broadcast.deliver(&frame(0x1A0, &[1]), now));
    assert!(broadcast.deliver(&frame(0x1A0, &[1]), now));
    assert!(!broadcast.deliver(&frame(0x720, &[5]), now));
    broadcast.unsubscribe(id(0x1A0));
    assert!(!broadcast.deliver(&frame(0x1A0, &[1]), now));
    broadcast.mode = Mode::Raw;
    assert!(broadcast.deliver(&frame(0x720, &[5]), now));
    broadcast.mode = Mode::Control;
    assert!(!broadcast.deliver(&frame(0x720, &[5]), now));
}

#[test]
fn a_throttle_leaves_out_what_comes_too_soon() {
    let (mut broadcast, now) = (Broadcast::default(), Instant::now());
    broadcast.subscribe(id(0x1A0), None, ms(1500)).unwrap();
    let taken: Vec<bool> =
        [0, 100, 1499, 1500, 1600, 3000].map(|at| broadcast.deliver(&frame(0x1A0, &[1]), now + ms(at))).into();
    assert_eq!(taken, [true, false, false, true, false, true]);
}

#[test]
fn a_filter_looks_at_the_bits_of_its_mask() {
    let (mut broadcast, now) = (Broadcast::default(), Instant::now());
    broadcast.subscribe(id(0x1A0), Some(&[0xFF, 0x00, 0xF8]), ms(0)).unwrap();
    let mut takes = |data: &[u8]| broadcast.deliver(&frame(0x1A0, data), now);
    assert!(takes(&[1, 2, 3]));
    assert!(!takes(&[1, 9, 4]));
    assert!(takes(&[1, 9, 8]));
    assert!(takes(&[2, 9, 8]));
    assert!(!takes(&[2, 9, 8, 7]));
}

#[test]
fn cyclic_frames_are_due_at_once_and_then_in_their_cycle() {
    let (mut broadcast, now) = (Broadcast::default(), Instant::now());
    assert_eq!(broadcast.due(), None);
    broadcast.add(frame(0x220, &[1]), ms(20), now).unwrap();
    assert_eq!(broadcast.due(), Some(now));
    assert_eq!(broadcast.take_due(now), Some(frame(0x220, &[1])));
    assert_eq!((broadcast.take_due(now), broadcast.due()), (None, Some(now + ms(20))));
    assert!(broadcast.update(frame(0x220, &[2])));
    assert!(!broadcast.update(frame(0x221, &[2])));
    assert_eq!(broadcast.take_due(now + ms(21)), Some(frame(0x220, &[2])));
    // in its cycle, not 20 ms after the frame that was late
    assert_eq!(broadcast.due(), Some(now + ms(40)));
    // what was missed is not made up for
    assert_eq!(broadcast.take_due(now + ms(500)), Some(frame(0x220, &[2])));
    assert_eq!(broadcast.due(), Some(now + ms(520)));
    broadcast.delete(id(0x220));
    assert_eq!(broadcast.due(), None);
}

#[test]
fn a_frame_without_a_period_is_sent_once_and_no_cycle_is_shorter_than_a_millisecond() {
    let (mut broadcast, now) = (Broadcast::default(), Instant::now());
    broadcast.add(frame(0x220, &[1]), ms(0), now).unwrap();
    assert_eq!(broadcast.take_due(now), Some(frame(0x220, &[1])));
    assert_eq!(broadcast.due(), None);
    broadcast.add(frame(0x220, &[1]), Duration::from_micros(10), now).unwrap();
    broadcast.take_due(now);
    assert_eq!(broadcast.due(), Some(now + ms(1)));
}

#[test]
fn statistics_count_what_came_and_what_went() {
    let (mut broadcast, now) = (Broadcast::default(), Instant::now());
    broadcast.deliver(&frame(0x1A0, &[1, 2, 3, 4]), now);
    broadcast.deliver(&frame(0x080, &[]), now);
    broadcast.count_sent(&frame(0x220, &[1]));
    broadcast.set_statistics(ms(1000), now);
    assert_eq!(broadcast.statistics_due(), None, "only in control mode");
    broadcast.mode = Mode::Control;
    assert_eq!(broadcast.take_statistics(now + ms(999)), None);
    let counts = [Traffic { frames: 2, bytes: 4 }, Traffic { frames: 1, bytes: 1 }];
    assert_eq!(broadcast.take_statistics(now + ms(1000)), Some(counts));
    assert_eq!(broadcast.statistics_due(), Some(now + ms(2000)));
    broadcast.set_statistics(ms(0), now);
    assert_eq!(broadcast.statistics_due(), None);
}

#[test]
fn room_is_bounded() {
    let (mut broadcast, now) = (Broadcast::default(), Instant::now());
    for raw in 0..MOST as u16 {
        broadcast.subscribe(id(raw), None, ms(0)).unwrap();
        broadcast.add(frame(raw, &[]), ms(1), now).unwrap();
    }
    assert_eq!(broadcast.subscribe(id(0x7FF), None, ms(0)), Err(Full));
    assert_eq!(broadcast.add(frame(0x7FF, &[]), ms(1), now), Err(Full));
    broadcast.subscribe(id(0), None, ms(5)).unwrap();
    broadcast.add(frame(0, &[1]), ms(5), now).unwrap();
}
