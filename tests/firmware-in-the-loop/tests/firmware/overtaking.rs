//! What waits for a bus that is full of more urgent frames goes out in the order of arbitration, whatever the order it
//! was made in: three mailboxes, and a queue behind them.

use firmware_in_the_loop::bxcan::registers::{BTR, MCR, TI0R, mcr};
use hal_sim::ClientPortId;
use hal_sim::bus::{DestroyNext, FrameBits};
use protocol_core::controller::BitRate;
use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Instant, since};

use super::client::{ImageClient, frame};

/// More urgent than all that a valve sends.
const FLOOD: &str = "001: 00 00 00 00 00 00 00 00";
/// How long a frame of the flood takes at 250 kbit/s is more than half a millisecond.
const PER_MS: u64 = 2;

/// Sends a frame, and keeps the bus full for some milliseconds afterwards. The frame goes out first: what is in the
/// queue goes in its order, and the valve sends nothing before the flood ends.
fn in_flood(client: &mut ImageClient, text: Option<&str>, ms: u64) {
    if let Some(text) = text {
        client.send(text);
    }
    for _ in 0..PER_MS * ms {
        client.send(FLOOD);
    }
    // Up to the last frame of the flood, which the next call follows.
    while client.rig.boards.world.pending(client.rig.master) > 2 {
        client.step();
    }
}

/// What the valve sends when the flood is over.
fn sent(client: &mut ImageClient) -> Vec<String> {
    client.listen_ms(30).iter().map(Frame::to_string).collect()
}

/// Operational, ACTIVE, with a heartbeat every 50 ms, and an RPDO that is more urgent than a TPDO.
fn scene() -> ImageClient {
    let mut client = ImageClient::booted();
    client.write(0x1400, 1, 4, 0x8000_0220);
    client.write(0x1400, 1, 4, 0x8000_0090);
    client.write(0x1400, 1, 4, 0x90);
    client.activate("090");
    client
}

/// Waits for a heartbeat, and a little: the next one comes in the flood.
fn heartbeat(client: &mut ImageClient) {
    client.write(0x1017, 0, 2, 50);
    while client.receive() != Some(frame("720: 05")) {}
    client.wait_ms(20);
    assert_eq!(client.listen_ms(1), []);
}

#[test]
fn five_services_that_were_made_in_the_opposite_order() {
    let mut client = scene();
    heartbeat(&mut client);
    // Each is less urgent than the next one: what waits has to make room, twice.
    in_flood(&mut client, None, 35);
    in_flood(&mut client, Some("1BC78820: 03 22 10 01"), 2);
    in_flood(&mut client, Some("620: 40 18 10 01 00 00 00 00"), 2);
    in_flood(&mut client, Some("090: 0F 00 00 00"), 2);
    client.type_line("internal_fault on");
    in_flood(&mut client, None, 10);
    assert_eq!(client.aside, [], "the flood leaves no room");
    assert_eq!(
        sent(&mut client)[..5],
        [
            "0A0: 00 10 01 01 00 00 00 00",
            // The state as it is when the frame goes out.
            "1A0: 03 00 00 00",
            "5A0: 43 18 10 01 19 00 00 01",
            "1BC100F1: 04 62 10 01 20",
            "720: 05",
        ]
    );
    assert_eq!(client.connections().can.lock().can.lost(), [0, 0]);
    client.end_without_reset();
}

#[test]
fn equal_identifiers_go_in_the_order_they_were_made_in() {
    let mut client = scene();
    in_flood(&mut client, Some("620: 40 18 10 01 00 00 00 00"), 2);
    // Emergencies: more of them than there are mailboxes, with a more urgent one than what waits each time.
    for word in
        ["internal_fault on", "internal_fault off", "internal_fault on", "internal_fault off", "internal_fault on"]
    {
        client.type_line(word);
        in_flood(&mut client, None, 8);
    }
    in_flood(&mut client, Some("090: 0F 00 00 00"), 2);
    assert_eq!(client.aside, []);
    assert_eq!(
        sent(&mut client),
        [
            "0A0: 00 10 01 01 00 00 00 00",
            "0A0: 00 00 00 00 00 00 00 00",
            "0A0: 00 10 01 02 00 00 00 00",
            "0A0: 00 00 00 00 00 00 00 00",
            "0A0: 00 10 01 03 00 00 00 00",
            "1A0: 03 00 00 00",
            "5A0: 43 18 10 01 19 00 00 01",
        ]
    );
    client.end_without_reset();
}

#[test]
fn in_random_traffic_nothing_is_lost_or_doubled() {
    let mut client = scene();
    let mut random = fastrand::Rng::with_seed(1);
    let (mut sdo, mut rpdo, mut uds) = (0, 0, 0);
    for _ in 0..400 {
        // At most one request of a sort is open: more than the device's own queue holds is not asked for.
        for _ in 0..random.u32(..6) {
            client.send(FLOOD);
        }
        for (sort, text) in [
            (&mut uds, "1BC78820: 03 22 10 01"),
            (&mut sdo, "620: 40 18 10 01 00 00 00 00"),
            (&mut rpdo, "090: 0F 00 00 00"),
        ] {
            if random.bool() {
                client.send(text);
                *sort += 1;
            }
        }
        for _ in 0..random.u32(..6) {
            client.send(FLOOD);
        }
        // From an empty bus on, so that the next requests come at any distance from the answers.
        client.finish_sending();
        let pause = client.now_us() + random.u64(..1500);
        client.rig.boards.run_until(protocol_core::time::Instant::from_micros(pause));
    }
    let frames = sent(&mut client);
    let count = |start: &str| frames.iter().filter(|frame| frame.starts_with(start)).count();
    assert_eq!((count("5A0: 43"), count("1BC100F1: 04 62")), (sdo, uds));
    // A TPDO tells the state as it is: one that is due again before it is out is sent once.
    let tpdos = count("1A0: 0");
    assert!((rpdo * 9 / 10..=rpdo).contains(&tpdos), "{tpdos} TPDOs after {rpdo} RPDOs");
    assert_eq!(frames.len(), sdo + tpdos + uds + count("0A0:"));
    client.end_without_reset();
}

#[test]
fn a_frame_that_is_destroyed_is_sent_once_in_the_end() {
    let mut client = scene();
    client.rig.boards.world.inject(DestroyNext::frames_of("board", 3));
    client.send("620: 40 18 10 01 00 00 00 00");
    client.send("090: 0F 00 00 00");
    client.send("1BC78820: 03 22 10 01");
    let mut frames = sent(&mut client);
    frames.sort();
    assert_eq!(frames, ["1A0: 0F 00 00 00", "1BC100F1: 04 62 10 01 20", "5A0: 43 18 10 01 19 00 00 01"]);
    client.end_without_reset();
}

/// Listens to all frames from now on.
pub fn listen(client: &mut ImageClient) -> ClientPortId {
    client.rig.boards.world.add_client_port("listener")
}

/// The frames that a listener has heard, each with its end.
pub fn heard(client: &mut ImageClient, listener: ClientPortId) -> Vec<(Instant, Frame)> {
    client.rig.boards.world.take_received(listener).collect()
}

/// Runs bus and controller at a bit rate that a valve cannot be told, behind the firmware's back.
fn set_timing(client: &mut ImageClient, rate: BitRate) {
    {
        let mut shared = client.connections().can.lock();
        let control = shared.can.read(MCR);
        shared.can.write(MCR, control | mcr::INRQ);
        shared.can.write(BTR, firmware::bit_timing::BitTiming::of(rate).register());
        shared.can.write(MCR, control);
    }
    client.rig.set_bit_rate(rate);
    client.wait_ms(10);
}

#[test]
fn frames_leave_back_to_back_at_1_mbit() {
    let mut client = scene();
    heartbeat(&mut client);
    set_timing(&mut client, BitRate::Kbit1000);
    // Each is less urgent than the one before: the TPDO is staged behind the emergency, the heartbeat waits in the
    // device.
    client.type_line("internal_fault on");
    in_flood(&mut client, None, 35);
    in_flood(&mut client, Some("090: 0F 00 00 00"), 200);
    let listener = listen(&mut client);
    client.listen_ms(5);
    let seen = heard(&mut client, listener);
    let own: Vec<_> = seen.iter().filter(|(_, sent)| *sent != frame(FLOOD)).collect();
    let order: Vec<String> = own.iter().map(|(_, frame)| frame.to_string()[..4].to_owned()).collect();
    assert_eq!(order, ["0A0:", "1A0:", "720:"]);
    for pair in own.windows(2) {
        let [(before, _), (end, frame)] = pair else { unreachable!("windows of two") };
        let gap = since(*end, *before).as_micros() - u64::from(FrameBits::of(frame).on_wire());
        assert_eq!(gap, 3, "between frames before {frame} there is the intermission");
    }
}

/// Fills a mailbox behind the firmware's back.
pub fn fill(client: &mut ImageClient, mailbox: u32, text: &str) {
    let frame = frame(text);
    let Id::Standard(id) = frame.id() else { panic!("{text}: only standard identifiers here") };
    let mut shared = client.connections().can.lock();
    let at = TI0R + 0x10 * mailbox;
    shared.can.write(at + 4, frame.len().into());
    shared.can.write(at, u32::from(id.as_raw()) << 21 | 1);
    shared.changed = true;
}

/// The answer to an SDO request is on the wire, more urgent frames fill the other mailboxes, and an emergency comes:
/// what is on the bus from the answer on. MSR.TXM reads as is given.
fn emergency_while_an_answer_is_on_the_wire(client: &mut ImageClient, txm: Option<bool>) -> Vec<String> {
    client.connections().terminal.lock().typed.extend(b"internal_fault on");
    client.wait_ms(10);
    let listener = listen(client);
    client.send("620: 40 18 10 01 00 00 00 00");
    let is_sending = |client: &ImageClient| {
        let shared = client.connections().can.lock();
        shared.can.read(firmware_in_the_loop::bxcan::registers::MSR) & 1 << 8 != 0
    };
    while !is_sending(client) {
        client.step();
    }
    client.connections().can.lock().can.show_sending(txm);
    fill(client, 1, "1A1:");
    fill(client, 2, "1A2:");
    client.connections().terminal.lock().typed.push_back(b'\n');
    client.listen_ms(20);
    heard(client, listener).iter().skip(1).map(|(_, frame)| frame.to_string()).collect()
}

const EMERGENCY: &str = "0A0: 00 10 01 01 00 00 00 00";
const ANSWER: &str = "5A0: 43 18 10 01 19 00 00 01";

#[test]
fn a_frame_on_the_wire_is_not_taken_back() {
    let mut client = scene();
    let seen = emergency_while_an_answer_is_on_the_wire(&mut client, None);
    assert_eq!(seen[..4], [ANSWER, EMERGENCY, "1A1:", "1A2:"]);
    assert_eq!(seen.iter().filter(|text| *text == ANSWER).count(), 1);
}

#[test]
fn a_frame_that_begins_just_when_it_is_taken_back_is_sent_once() {
    let mut client = scene();
    let seen = emergency_while_an_answer_is_on_the_wire(&mut client, Some(false));
    assert_eq!(seen[..4], [ANSWER, EMERGENCY, "1A1:", "1A2:"]);
    assert_eq!(seen.iter().filter(|text| *text == ANSWER).count(), 1);
}

#[test]
fn a_frame_that_is_taken_back_on_the_wire_and_then_destroyed_is_sent_once() {
    // Where it is not taken back, the emergency waits for up to a millisecond.
    for (txm, first) in [(None, ["1A1:", EMERGENCY, "1A2:"]), (Some(false), [EMERGENCY, "1A1:", "1A2:"])] {
        let mut client = scene();
        client.rig.boards.world.inject(DestroyNext::frames_of("board", 1));
        let seen = emergency_while_an_answer_is_on_the_wire(&mut client, txm);
        assert_eq!(seen[..3], first, "{txm:?}");
        assert_eq!(seen.iter().filter(|text| *text == ANSWER).count(), 1, "{txm:?}: {seen:?}");
    }
}

#[test]
fn an_urgent_frame_does_not_wait_for_an_interrupt_that_does_not_come() {
    for (failures, mode) in [(0, "error-active"), (20, "error-passive")] {
        let mut client = scene();
        client.rig.boards.world.inject(DestroyNext::frames_of("board", failures));
        client.read(0x1018, 1);
        assert_eq!(client.status_of("bus"), mode);
        the_emergency_goes_first(client);
    }
}

fn the_emergency_goes_first(mut client: ImageClient) {
    // Less urgent than an emergency, more urgent than all else.
    let flood = |client: &mut ImageClient, ms: u64| {
        (0..PER_MS * ms).for_each(|_| client.send("0B0: 00 00 00 00 00 00 00 00"));
        while client.rig.boards.world.pending(client.rig.master) > 2 {
            client.step();
        }
    };
    flood(&mut client, 2);
    // None of these is taken back, as a PDO is that is out of date: no mailbox gets empty.
    let waiting = ["7A1:", "7A2:", "7A3:"];
    (0..).zip(waiting).for_each(|(mailbox, text)| fill(&mut client, mailbox, text));
    flood(&mut client, 2);
    // The controller is about to lose arbitration when the emergency comes.
    client.connections().can.lock().can.show_sending(Some(true));
    client.type_line("internal_fault on");
    flood(&mut client, 4);
    assert_eq!(client.aside, []);
    client.connections().can.lock().can.show_sending(None);
    flood(&mut client, 4);
    client.wait_ms(0);
    assert_eq!(client.aside.pop_front().map(|frame| frame.to_string()).as_deref(), Some(EMERGENCY));
    assert_eq!(sent(&mut client), waiting);
    client.end_without_reset();
}

#[test]
fn who_leaves_the_bus_drops_the_frame_on_the_wire_when_it_is_destroyed() {
    let mut client = scene();
    client.connections().terminal.lock().typed.extend(b"bus_off on");
    client.wait_ms(10);
    client.rig.boards.world.inject(DestroyNext::frames_of("board", 1));
    client.send("620: 40 18 10 01 00 00 00 00");
    client.finish_sending();
    client.connections().terminal.lock().typed.push_back(b'\n');
    client.wait_ms(20);
    client.obeyed("bus_off off");
    client.wait_ms(50);
    assert!(client.aside.iter().all(|frame| frame.to_string() != ANSWER), "{:?}", client.aside);
    assert_eq!(client.status_of("bus"), "error-active");
}

#[test]
fn a_frame_that_is_out_of_date_is_taken_back_from_the_controller() {
    let mut client = ImageClient::on_isobus();
    // A message with the position waits in a mailbox when the spool is moved, and when the next one is due.
    in_flood(&mut client, None, 150);
    client.type_line("lever 16384");
    in_flood(&mut client, None, 400);
    client.aside.clear();
    let position = |frames: Vec<String>| -> Vec<String> {
        frames.into_iter().filter(|text| text.starts_with("0CFE1383:")).collect()
    };
    let first = position(client.listen_ms(3).iter().map(Frame::to_string).collect());
    let later = position(client.listen_ms(250).iter().map(Frame::to_string).collect());
    assert_eq!(first.len(), 1, "{first:?}");
    assert_eq!(first[0], later[0], "the position as it is");
    assert_ne!(first[0], "0CFE1383: 7D 7D 30 FF FF FF FF FF", "neutral is out of date");
}
