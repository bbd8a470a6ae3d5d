//! Bus-off and the way back (SPEC 4.2), as the host device does it.

use hal_sim::bus::DestroyNext;
use protocol_core::controller::BusErrorMode;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant};

use super::client::ImageClient;

/// 128 sequences of 11 recessive bits at 250 kbit/s, in microseconds.
const RECOVERY: u64 = 128 * 11 * 4;
/// How many failures in a row end in bus-off.
const FAILURES: u32 = 32;

fn mode(client: &ImageClient) -> BusErrorMode {
    let boards = &client.rig.boards;
    boards.world.controller_port(boards.controller(client.rig.board)).mode()
}

/// Runs until the mode is as wanted; says when.
fn run_to(client: &mut ImageClient, wanted: BusErrorMode) -> Instant {
    let end = client.now_us() + 1_000_000;
    while mode(client) != wanted {
        assert!(client.now_us() < end, "still {:?}", mode(client));
        client.step();
    }
    client.rig.boards.world.now()
}

#[test]
fn it_is_silent_recovers_after_128_sequences_and_tells() {
    // The second answer waits for the end of the first, behind the mailboxes.
    for requests in
        [&["620: 40 18 10 01 00 00 00 00"][..], &["620: 40 18 10 01 00 00 00 00", "620: 40 00 10 00 00 00 00 00"]]
    {
        let mut client = ImageClient::booted();
        client.wait_ms(50);
        client.rig.boards.world.inject(DestroyNext::frames_of("board", FAILURES));
        requests.iter().for_each(|request| client.send(request));
        let off = run_to(&mut client, BusErrorMode::BusOff);
        let back = run_to(&mut client, BusErrorMode::ErrorActive);
        let took = back.as_micros() - off.as_micros();
        // What ended with the error frame and the intermission counts as one of the sequences.
        assert!((RECOVERY - 2 * 44..=RECOVERY + 44).contains(&took), "{took} us after {requests:?}");
        let told: Vec<String> = client.listen_ms(100).iter().map(Frame::to_string).collect();
        // The answers that it was bus-off over are out of date.
        assert_eq!(told, ["0A0: 40 81 11 01 00 00 00 00", "0A0: 00 00 00 00 00 00 00 00"], "{requests:?}");
        assert_eq!(client.read(0x2019, 0), 1, "occurrences of the CAN bus error");
        assert_eq!(client.read(0x1018, 1), 0x0100_0019);
        client.end_without_reset();
    }
}

#[test]
fn error_passive_is_not_bus_off() {
    let mut client = ImageClient::booted();
    client.rig.boards.world.inject(DestroyNext::frames_of("board", FAILURES - 1));
    assert_eq!(client.read(0x1018, 1), 0x0100_0019, "the 32nd attempt");
    assert_eq!(client.listen_ms(100), []);
    assert_eq!(mode(&client), BusErrorMode::ErrorPassive);
}

#[test]
fn alone_on_the_bus_it_waits_and_comes_back() {
    let mut client = ImageClient::booted();
    let master = client.rig.master;
    client.rig.boards.world.remove_client_port(master);
    client.wait_ms(3000);
    assert_ne!(mode(&client), BusErrorMode::BusOff);
    client.rig.master = client.rig.boards.world.add_client_port("another master");
    client.wait_ms(100);
    assert_eq!(client.listen_ms(1), []);
    assert_eq!(client.read(0x1018, 1), 0x0100_0019);
    assert_eq!(client.receive_for(Duration::from_millis(10)), None);
}

#[test]
fn in_traffic_it_counts_the_ends_of_frames_and_each_time_is_counted() {
    let mut client = ImageClient::booted();
    for count in 1..=2 {
        client.rig.boards.world.inject(DestroyNext::frames_of("board", FAILURES));
        client.send("620: 40 18 10 01 00 00 00 00");
        let off = run_to(&mut client, BusErrorMode::BusOff);
        // Somebody else acknowledges.
        let listener = client.rig.boards.world.add_client_port("listener");
        (0..200).for_each(|_| client.send("7FF: 00 00 00 00 00 00 00 00"));
        let back = run_to(&mut client, BusErrorMode::ErrorActive);
        let heard = client.rig.boards.world.take_received(listener).count();
        let took = back.as_micros() - off.as_micros();
        assert!((126..=129).contains(&heard) && took > 4 * RECOVERY, "{heard} frames, {took} us");
        client.finish_sending();
        client.rig.boards.world.remove_client_port(listener);
        let told: Vec<String> = client.listen_ms(50).iter().map(Frame::to_string).collect();
        let can_error = format!("0A0: 40 81 11 {count:02X} 00 00 00 00");
        assert_eq!(told, [can_error.as_str(), "0A0: 00 00 00 00 00 00 00 00"]);
    }
    client.end_without_reset();
}
