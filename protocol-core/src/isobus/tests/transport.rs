use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::isobus::Outcome;
use crate::isobus::transport::{
    BamReceiver, BamSender, MAX_GAP, Message, PACKET_SPACING, Refused, SEND_GAP, refuse_connection,
};
use crate::time::{Duration, NEVER, after, since};
use crate::wire::j1939_id::{J1939Id, Pgn};
use crate::wire::tp::{Announcement, Packet};

const SENDERS: usize = 16;
const SIZE: usize = 34;

type Receiver = BamReceiver<SENDERS, SIZE>;
type Sender = BamSender<SIZE>;

const WANTED: &[Pgn] = &[Pgn::COMMANDED_ADDRESS, Pgn::DM2];

const ANNOUNCE: &str = "1CECFF27: 20 09 00 02 FF D8 FE 00";
const FIRST: &str = "1CEBFF27: 01 01 00 20 07 08 FF 02";
const SECOND: &str = "1CEBFF27: 02 20 81 FF FF FF FF FF";
const PAYLOAD: [u8; 9] = [0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20, 0x81];

fn take<const N: usize>(receiver: &mut BamReceiver<N, SIZE>, frame: &Frame, now: Instant) -> Option<Message<SIZE>> {
    receiver.handle(J1939Id::of(frame)?, frame, now)
}

/// Returns the first message received from these frames, each given with its time in milliseconds.
fn after_frames(frames: &[(u64, &str)]) -> Option<Vec<u8>> {
    let mut receiver = Receiver::new(WANTED);
    let mut messages = frames.iter().filter_map(|(at, text)| take(&mut receiver, &frame(text), ms(*at)));
    messages.next().map(|message| message.payload.to_vec())
}

fn bytes(len: usize) -> Vec<u8> {
    (0..len).map(|at| at as u8 ^ 0xA5).collect()
}

fn payload(bytes: &[u8]) -> heapless::Vec<u8, SIZE> {
    heapless::Vec::from_slice(bytes).unwrap()
}

/// Returns the frame that is due now.
fn next<const N: usize>(sender: &mut BamSender<N>, source: Address, now: Instant) -> Option<Frame> {
    if sender.poll(now) == Outcome::Pending { sender.render(source) } else { None }
}

/// Returns all frames of a message with their due times.
fn sent(source: Address, pgn: Pgn, bytes: &[u8]) -> Vec<(Instant, Frame)> {
    let mut sender = Sender::new();
    sender.start(pgn, payload(bytes), ms(0)).unwrap();
    let mut frames = Vec::new();
    while sender.deadline() != NEVER {
        let due = sender.deadline();
        frames.push((due, next(&mut sender, source, due).unwrap()));
        sender.sent(due);
    }
    frames
}

#[test]
fn the_commanded_address_of_the_manual() {
    let mut receiver = Receiver::new(WANTED);
    assert_eq!(take(&mut receiver, &frame(ANNOUNCE), ms(0)), None);
    assert_eq!(take(&mut receiver, &frame(FIRST), ms(50)), None);
    let message = Message { pgn: Pgn::COMMANDED_ADDRESS, source: TOOL, payload: payload(&PAYLOAD) };
    assert_eq!(take(&mut receiver, &frame(SECOND), ms(100)), Some(message));
    assert_eq!(receiver.under_way(), 0);
    assert_eq!(take(&mut receiver, &frame(SECOND), ms(150)), None);
}

#[test]
fn packets_go_out_within_50_to_200_ms() {
    assert!(PACKET_SPACING > Duration::from_millis(50) && PACKET_SPACING < Duration::from_millis(200));
    let frames = sent(OWN, Pgn::DM2, &bytes(SIZE));
    assert_eq!(frames.len(), 6);
    assert_eq!(frames[0].0, ms(0));
    for pair in frames.windows(2) {
        assert_eq!(since(pair[1].0, pair[0].0), PACKET_SPACING);
    }
    // A frame handed out late and sent even later keeps its distance from the next one.
    let mut sender = Sender::new();
    sender.start(Pgn::DM2, payload(&bytes(10)), ms(0)).unwrap();
    assert_eq!(text(next(&mut sender, OWN, ms(70))), "1CECFF83: 20 0A 00 02 FF CB FE 00");
    assert_eq!(sender.poll(ms(199)), Outcome::Nothing);
    sender.sent(ms(199));
    sender.sent(ms(200));
    assert_eq!(sender.deadline(), after(ms(199), PACKET_SPACING));
    assert_eq!(sender.poll(us(sender.deadline().as_micros() - 1)), Outcome::Nothing);
}

/// From the start to the announcement, and from each frame to the next, at most 200 ms may pass; otherwise the message
/// is abandoned.
#[test]
fn a_message_whose_gap_is_too_long_is_given_up() {
    for (frames, in_controller) in [(0, false), (0, true), (1, false), (1, true), (2, false), (2, true)] {
        let mut sender = Sender::new();
        sender.start(Pgn::DM2, payload(&bytes(10)), ms(0)).unwrap();
        let mut now = ms(0);
        for _ in 0..frames {
            assert!(next(&mut sender, OWN, now).is_some());
            sender.sent(now);
            now += PACKET_SPACING;
        }
        assert_eq!(sender.poll(now), Outcome::Pending);
        if in_controller {
            assert!(sender.render(OWN).is_some());
        }
        let limit = if frames == 0 { after(now, SEND_GAP) } else { now + SEND_GAP - PACKET_SPACING };
        assert_eq!(sender.deadline(), limit);
        assert_eq!(sender.poll(us(limit.as_micros() - 1)), Outcome::Nothing);
        assert_eq!(sender.poll(limit), Outcome::GivenUp);
        assert_eq!((sender.is_busy(), sender.deadline()), (false, NEVER));
    }
}

/// After the controller returns a packet, that packet is again the next packet.
#[test]
fn a_frame_that_is_taken_back_is_rendered_again() {
    let mut sender = Sender::new();
    sender.start(Pgn::DM2, payload(&bytes(10)), ms(0)).unwrap();
    let first = next(&mut sender, OWN, ms(0));
    sender.take_back();
    sender.sent(ms(1));
    assert_eq!(sender.render(OWN), first);
    sender.sent(ms(2));
    assert_eq!(sender.pgn(), Pgn::TP_DATA);
}

#[test]
fn a_connection_is_refused() {
    let abort = |text: &str| refuse_connection(J1939Id::of(&frame(text)).unwrap(), &frame(text), OWN);
    assert_eq!(text(abort("1CEC8327: 10 09 00 02 FF D8 FE 00")), "1CEC2783: FF 02 FF FF FF D8 FE 00");
    for other in [
        "1CEC83FE: 10 09 00 02 FF D8 FE 00",
        "1CEC83FF: 10 09 00 02 FF D8 FE 00",
        "1CEC8327: 11 09 00 02 FF D8 FE 00",
        "1CEC8327: 13 09 00 02 FF D8 FE 00",
        "1CEC8327: FF 02 FF FF FF D8 FE 00",
        "1CEC8327: 20 09 00 02 FF D8 FE 00",
        "1CEC8327: 10 09 00 02 FF D8 FE",
        "1CEC8327: R8",
    ] {
        assert_eq!(abort(other), None, "{other}");
    }
}

#[test]
fn one_message_at_a_time_of_9_bytes_or_more() {
    let mut sender = Sender::new();
    assert_eq!(sender.start(Pgn::DM2, payload(&bytes(8)), ms(0)), Err(Refused::Size));
    assert!(!sender.is_busy());
    assert_eq!(sender.start(Pgn::DM2, payload(&bytes(9)), ms(0)), Ok(()));
    assert_eq!(sender.start(Pgn::DM2, payload(&bytes(9)), ms(0)), Err(Refused::Busy));
    assert!(sender.cancel());
    assert!(!sender.cancel());
    assert_eq!((sender.deadline(), sender.poll(ms(1_000))), (NEVER, Outcome::Nothing));
    assert_eq!(sender.start(Pgn::DM2, payload(&bytes(9)), ms(0)), Ok(()));
}

#[test]
fn the_longest_message_has_255_packets() {
    let mut sender = BamSender::<1786>::new();
    assert_eq!(sender.start(Pgn::DM2, heapless::Vec::from_slice(&bytes(1786)).unwrap(), ms(0)), Err(Refused::Size));
    assert_eq!(sender.start(Pgn::DM2, heapless::Vec::from_slice(&bytes(1785)).unwrap(), ms(0)), Ok(()));
    let mut receiver = BamReceiver::<1, 1785>::new(WANTED);
    let mut message = None;
    while sender.deadline() != NEVER {
        let now = sender.deadline();
        let frame = next(&mut sender, OWN, now).unwrap();
        sender.sent(now);
        message = receiver.handle(J1939Id::of(&frame).unwrap(), &frame, now);
    }
    assert_eq!(message.unwrap().payload.as_slice(), bytes(1785));
}

#[test]
fn a_gap_of_750_ms_is_borne_and_a_longer_one_is_not() {
    assert_eq!(MAX_GAP, Duration::from_millis(750));
    let borne = after_frames(&[(0, ANNOUNCE), (750, FIRST), (1_500, SECOND)]);
    assert_eq!(borne, Some(PAYLOAD.to_vec()));
    for gaps in [[750_001, 10], [10, 750_001]] {
        let mut receiver = Receiver::new(WANTED);
        let mut now = us(0);
        assert_eq!(take(&mut receiver, &frame(ANNOUNCE), now), None);
        for (gap, text) in gaps.into_iter().zip([FIRST, SECOND]) {
            now = us(now.as_micros() + gap);
            assert_eq!(take(&mut receiver, &frame(text), now), None, "{gaps:?}");
        }
        assert_eq!(receiver.under_way(), 0);
    }
}

#[test]
fn what_is_out_of_order_is_dropped_for_good() {
    for frames in [
        &[ANNOUNCE, SECOND, FIRST, SECOND][..],
        &[ANNOUNCE, FIRST, FIRST, SECOND],
        &[ANNOUNCE, "1CEBFF27: 00 01 00 20 07 08 FF 02", FIRST, SECOND],
        &[ANNOUNCE, FIRST, "1CEBFF27: 03 20 81 FF FF FF FF FF", SECOND],
        &[ANNOUNCE, FIRST, "1CEBFF27: 02 20 81", SECOND],
        &[ANNOUNCE, FIRST, "1CEBFF27: R8", SECOND],
        &[FIRST, SECOND],
    ] {
        let timed: Vec<_> = (0..).step_by(50).zip(frames.iter().copied()).collect();
        assert_eq!(after_frames(&timed), None, "{frames:?}");
    }
}

#[test]
fn an_announcement_that_is_wrong_unwanted_or_too_long_is_let_pass() {
    for announcement in [
        "1CECFF27: 20 09 00 03 FF D8 FE 00",
        "1CECFF27: 20 09 00 01 FF D8 FE 00",
        "1CECFF27: 20 08 00 02 FF D8 FE 00",
        "1CECFF27: 20 00 00 00 FF D8 FE 00",
        "1CECFF27: 20 23 00 05 FF D8 FE 00",
        "1CECFF27: 20 09 00 02 FF CA FE 00",
        "1CECFF27: 20 09 00 02 FF D8 FE",
        "1CECFF27: 10 09 00 02 FF D8 FE 00",
        "1CEC8327: 20 09 00 02 FF D8 FE 00",
        "1DECFF27: 20 09 00 02 FF D8 FE 00",
    ] {
        let mut receiver = Receiver::new(WANTED);
        for text in [announcement, FIRST, SECOND] {
            assert_eq!(take(&mut receiver, &frame(text), ms(0)), None, "{announcement}");
        }
        assert_eq!(receiver.under_way(), 0);
    }
}

#[test]
fn packets_to_one_controller_are_not_those_of_a_broadcast() {
    let addressed = "1CEB8327: 01 01 00 20 07 08 FF 02";
    let message = after_frames(&[(0, ANNOUNCE), (50, addressed), (60, FIRST), (110, SECOND)]);
    assert_eq!(message, Some(PAYLOAD.to_vec()));
}

#[test]
fn a_new_announcement_replaces_the_old() {
    let again = after_frames(&[(0, ANNOUNCE), (50, FIRST), (60, ANNOUNCE), (110, FIRST), (160, SECOND)]);
    assert_eq!(again, Some(PAYLOAD.to_vec()));
    let late = after_frames(&[(0, ANNOUNCE), (50, FIRST), (60, ANNOUNCE), (110, SECOND)]);
    assert_eq!(late, None);
    let unwanted = "1CECFF27: 20 09 00 02 FF CA FE 00";
    assert_eq!(after_frames(&[(0, ANNOUNCE), (50, FIRST), (60, unwanted), (110, SECOND)]), None);
    // An announcement by another sender replaces nothing.
    let other = "1CECFF28: 20 09 00 02 FF D8 FE 00";
    assert_eq!(after_frames(&[(0, ANNOUNCE), (50, FIRST), (60, other), (110, SECOND)]), Some(PAYLOAD.to_vec()));
}

#[test]
fn sixteen_senders_at_once() {
    let mut receiver = Receiver::new(WANTED);
    let messages: Vec<_> = (0..16_u8)
        .map(|sender| {
            let mut bytes = bytes(9 + usize::from(sender));
            bytes[0] = sender;
            (Address::new(0x20 + sender), bytes)
        })
        .collect();
    let trains: Vec<_> = messages.iter().map(|(source, bytes)| sent(*source, Pgn::DM2, bytes)).collect();
    let mut received = Vec::new();
    for step in 0..6 {
        for (at, train) in trains.iter().enumerate() {
            let Some((due, frame)) = train.get(step) else { continue };
            let now = us(due.as_micros() + at as u64);
            received.extend(take(&mut receiver, frame, now));
        }
        if step == 0 {
            assert_eq!(receiver.under_way(), 16);
        }
    }
    received.sort_by_key(|message| message.source);
    let received: Vec<_> = received.into_iter().map(|message| (message.source, message.payload.to_vec())).collect();
    assert_eq!(received, messages);
    assert_eq!(receiver.under_way(), 0);
}

#[test]
fn a_sender_too_many_waits_until_a_place_is_free() {
    let mut receiver = BamReceiver::<2, SIZE>::new(WANTED);
    let announce = |source: u8| Announcement::new(Pgn::DM2, 9).unwrap().frame(Address::new(source));
    let packet = |source: u8, sequence: u8| Packet::new(sequence, &[source; 7]).frame(Address::new(source));
    assert_eq!(take(&mut receiver, &announce(1), ms(0)), None);
    assert_eq!(take(&mut receiver, &announce(2), ms(100)), None);
    assert_eq!(take(&mut receiver, &announce(3), ms(200)), None);
    assert_eq!(take(&mut receiver, &packet(3, 1), ms(300)), None);
    assert_eq!(take(&mut receiver, &packet(2, 1), ms(300)), None);
    assert_eq!(take(&mut receiver, &packet(3, 2), ms(400)), None);
    let second = take(&mut receiver, &packet(2, 2), ms(400)).unwrap();
    assert_eq!((second.source, &second.payload[..]), (Address::new(2), &[2; 9][..]));
    // Sender 1 has been silent since 0: at 750 ms it still keeps its slot, a microsecond later it does not.
    assert_eq!(take(&mut receiver, &announce(4), ms(500)), None);
    assert_eq!(take(&mut receiver, &announce(5), ms(750)), None);
    assert_eq!(take(&mut receiver, &packet(5, 1), ms(750)), None);
    assert_eq!(take(&mut receiver, &announce(6), us(750_001)), None);
    assert_eq!(take(&mut receiver, &packet(6, 1), ms(800)), None);
    assert_eq!(take(&mut receiver, &packet(1, 1), ms(800)), None);
    assert_eq!(take(&mut receiver, &packet(6, 2), ms(900)).unwrap().source, Address::new(6));
    assert_eq!(receiver.under_way(), 1);
}

proptest! {
    /// Every message sent arrives, however the frames of the senders interleave.
    #[test]
    fn what_is_sent_arrives(lens in prop::collection::vec(9_usize..=SIZE, 1..=SENDERS), seed in any::<u64>()) {
        let mut receiver = Receiver::new(WANTED);
        let mut trains: Vec<_> = lens
            .iter()
            .enumerate()
            .map(|(at, len)| sent(Address::new(at as u8), Pgn::DM2, &bytes(*len)).into_iter().map(|(_, frame)| frame))
            .collect();
        let mut received = vec![None; lens.len()];
        let mut mix = seed;
        let mut now = 0;
        let mut left: Vec<usize> = (0..lens.len()).collect();
        while !left.is_empty() {
            mix = mix.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let pick = (mix >> 33) as usize % left.len();
            now += 1;
            match trains[left[pick]].next() {
                Some(frame) => {
                    if let Some(message) = take(&mut receiver, &frame, ms(now)) {
                        received[usize::from(message.source.get())] = Some(message.payload.len());
                    }
                }
                None => _ = left.swap_remove(pick),
            }
        }
        prop_assert_eq!(received, lens.into_iter().map(Some).collect::<Vec<_>>());
    }

    /// Noise in the groups of the transport protocol: the receptions never exceed the slots, and every received message
    /// was announced and wanted.
    #[test]
    fn noise_stays_within_bounds(
        frames in prop::collection::vec((any::<bool>(), 0_u8..20, any::<[u8; 8]>(), 0_u8..4, 0_u64..900), 0..300),
    ) {
        let mut receiver = BamReceiver::<4, SIZE>::new(WANTED);
        let mut now = 0;
        for (data, source, mut bytes, sequence, gap) in frames {
            now += if gap > 800 { gap } else { gap / 50 };
            let source = Address::new(source);
            let frame = if data {
                bytes[0] = sequence;
                Packet::parse(&bytes).frame(source)
            } else {
                let size = u16::from(bytes[0] % 48);
                let pgn = if bytes[1] < 200 { Pgn::DM2 } else { Pgn::DM1 };
                Announcement { size, packets: (size.div_ceil(7) as u8).wrapping_add(bytes[2] / 250), pgn }.frame(source)
            };
            if let Some(message) = take(&mut receiver, &frame, ms(now)) {
                prop_assert_eq!((message.pgn, message.source), (Pgn::DM2, source));
                prop_assert!((9..=SIZE).contains(&message.payload.len()));
            }
            prop_assert!(receiver.under_way() <= 4);
        }
    }
}
