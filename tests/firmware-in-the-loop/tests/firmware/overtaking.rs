//! What waits for a bus that is full of more urgent frames goes out in the order of arbitration, whatever the order it
//! was made in: three mailboxes, and a queue behind them.

use protocol_core::frame::Frame;

use super::client::{ImageClient, frame};

/// More urgent than all that a valve sends.
const FLOOD: &str = "001: 00 00 00 00 00 00 00 00";
/// How long a frame of the flood takes at 250 kbit/s is more than half a millisecond.
const PER_MS: u64 = 2;

/// Sends a frame, and keeps the bus full for some milliseconds afterwards. The frame goes out first: what is in the queue
/// goes in its order, and the valve sends nothing before the flood ends.
fn in_flood(client: &mut ImageClient, text: Option<&str>, ms: u64) {
    if let Some(text) = text {
        client.send(text);
    }
    for _ in 0..PER_MS * ms {
        client.send(FLOOD);
    }
    // Up to the last frame of the flood, which the next call follows.
    while client.bench.rig.world.pending(client.bench.master) > 2 {
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
    client.send("000: 01 00");
    for status in ["09", "0B", "0F"] {
        client.send("090: 0F 00 00 00");
        client.expect(&format!("1A0: {status} 00 00 00"));
    }
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
    client.bench.rig.type_line(client.bench.board, "internal_fault on");
    in_flood(&mut client, None, 10);
    assert_eq!(client.aside, [], "the flood leaves no room");
    assert_eq!(
        sent(&mut client)[..5],
        [
            "0A0: 00 10 01 01 00 00 00 00",
            "1A0: 0F 00 00 00",
            "5A0: 43 18 10 01 19 00 00 01",
            "1BC100F1: 04 62 10 01 20",
            "720: 05",
        ]
    );
    assert_eq!(client.bench.rig.connections(client.bench.board).can.lock().can.lost(), [0, 0]);
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
        client.bench.rig.type_line(client.bench.board, word);
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
        while client.bench.rig.world.pending(client.bench.master) > 0 {
            client.step();
        }
        let pause = client.now_us() + random.u64(..1500);
        client.bench.rig.run_until(protocol_core::time::Instant::from_micros(pause));
    }
    let frames = sent(&mut client);
    let count = |start: &str| frames.iter().filter(|frame| frame.starts_with(start)).count();
    assert_eq!((count("5A0: 43"), count("1A0: 0"), count("1BC100F1: 04 62")), (sdo, rpdo, uds));
    assert_eq!(frames.len(), sdo + rpdo + uds + count("0A0:"));
    client.end_without_reset();
}

#[test]
fn a_frame_that_is_destroyed_is_sent_once_in_the_end() {
    let mut client = scene();
    client.bench.rig.world.inject(hal_sim::bus::DestroyNext::frames_of("board", 3));
    client.send("620: 40 18 10 01 00 00 00 00");
    client.send("090: 0F 00 00 00");
    client.send("1BC78820: 03 22 10 01");
    let mut frames = sent(&mut client);
    frames.sort();
    assert_eq!(frames, ["1A0: 0F 00 00 00", "1BC100F1: 04 62 10 01 20", "5A0: 43 18 10 01 19 00 00 01"]);
    client.end_without_reset();
}
