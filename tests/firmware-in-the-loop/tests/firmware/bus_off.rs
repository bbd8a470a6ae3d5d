//! Bus-off and the way back, as the host device does it.

use firmware_in_the_loop::bench::ImageBench;
use hal_sim::bus::DestroyNext;
use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant};

use super::client::{Client, ImageClient, VALVE};

/// 128 sequences of 11 recessive bits at 250 kbit/s, in microseconds.
const RECOVERY: u64 = 128 * 11 * 4;
/// How many failures in a row end in bus-off.
const FAILURES: u32 = 32;

fn mode(client: &ImageClient) -> BusErrorMode {
    let rig = &client.bench.rig;
    rig.world.controller_port(rig.controller(client.bench.board)).mode()
}

/// Runs until the mode is as wanted; says when.
fn run_to(client: &mut ImageClient, wanted: BusErrorMode) -> Instant {
    let end = client.now_us() + 1_000_000;
    while mode(client) != wanted {
        assert!(client.now_us() < end, "still {:?}", mode(client));
        client.step();
    }
    client.bench.rig.world.now()
}

#[test]
fn it_is_silent_recovers_after_128_sequences_and_tells() {
    let mut client = Client::powered(ImageBench::with_valves(BitRate::Kbit250, &VALVE, &[]));
    client.wait_ms(50);
    client.bench.rig.world.inject(DestroyNext::frames_of("board", FAILURES));
    client.send("620: 40 18 10 01 00 00 00 00");
    let off = run_to(&mut client, BusErrorMode::BusOff);
    let back = run_to(&mut client, BusErrorMode::ErrorActive);
    let took = back.as_micros() - off.as_micros();
    // What ended with the error frame and the intermission counts as one of the sequences.
    assert!((RECOVERY - 2 * 44..=RECOVERY + 44).contains(&took), "{took} us");
    let told: Vec<String> = client.listen_ms(100).iter().map(Frame::to_string).collect();
    let can_error = told.iter().position(|frame| frame.starts_with("0A0: 40 81 11 01"));
    let no_error = told.iter().position(|frame| frame == "0A0: 00 00 00 00 00 00 00 00");
    assert!(can_error.is_some() && can_error < no_error, "{told:?}");
    assert_eq!(client.read(0x2019, 0), 1, "occurrences of the CAN bus error");
    assert_eq!(client.read(0x1018, 1), 0x0100_0019);
    let board = client.bench.board;
    client.bench.rig.power(board, false);
    assert_eq!(client.bench.rig.resets(board), []);
}

#[test]
fn error_passive_is_not_bus_off() {
    let mut client = ImageClient::booted();
    client.bench.rig.world.inject(DestroyNext::frames_of("board", FAILURES - 1));
    assert_eq!(client.read(0x1018, 1), 0x0100_0019, "the 32nd attempt");
    assert_eq!(client.listen_ms(100), []);
    assert_eq!(mode(&client), BusErrorMode::ErrorPassive);
}

#[test]
fn alone_on_the_bus_it_waits_and_comes_back() {
    let mut client = ImageClient::booted();
    let master = client.bench.master;
    client.bench.rig.world.remove_tap(master);
    client.wait_ms(3000);
    assert_ne!(mode(&client), BusErrorMode::BusOff);
    client.bench.master = client.bench.rig.world.add_tap("another master");
    client.wait_ms(100);
    assert_eq!(client.listen_ms(1), []);
    assert_eq!(client.read(0x1018, 1), 0x0100_0019);
    assert_eq!(client.receive_for(Duration::from_millis(10)), None);
}
