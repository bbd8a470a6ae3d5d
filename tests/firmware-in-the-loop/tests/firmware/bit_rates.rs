//! All bit rates of SPEC 1, as the firmware sets the controller and as the bus measures them.

use firmware_in_the_loop::bench::ImageBench;
use firmware_in_the_loop::board::NUCLEO_F429ZI;
use firmware_in_the_loop::bxcan::BitTiming;
use firmware_in_the_loop::bxcan::registers::{BTR, MCR, TSR, mcr};
use hal_sim::bus::FrameBits;
use hal_sim::use_case::Bench;
use protocol_core::controller::BitRate;

use super::client::{Client, ImageClient, VALVE, frame};
use super::overtaking::fill;

#[test]
fn each_bit_rate_is_exact_and_samples_where_cia_says() {
    for rate in VALVE.kind.bit_rates().iter().copied() {
        let mut client = Client::powered(ImageBench::with_devices(&NUCLEO_F429ZI, BitRate::Kbit250, &VALVE, &[]));
        client.send("7E5: 04 01 00 00 00 00 00 00");
        client.send(&format!("7E5: 13 00 {:02X} 00 00 00 00 00", rate.table_index()));
        client.expect("7E4: 13 00 00 00 00 00 00 00");
        client.send("7E5: 17 00 00 00 00 00 00 00");
        client.expect("7E4: 17 00 00 00 00 00 00 00");
        client.wait_ms(20);
        client.bench.set_bit_rate(rate);
        client.bench.power_cycle();
        for text in ["720: 00", "0A0: 00 00 00 00 00 00 00 00"] {
            client.expect(text);
            let took = client.bench.rig.last_sent(client.bench.board).expect("it was sent").as_micros();
            let bits = FrameBits::of(&frame(text)).on_wire();
            let expected = u64::from(bits) * 1_000_000 / u64::from(rate.bits_per_second());
            assert!(took.abs_diff(expected) <= 1, "{rate:?}: {text} took {took} us instead of {expected} us");
        }

        let (rig, board) = (&client.bench.rig, client.bench.board);
        let shared = rig.connections(board).can.lock();
        let timing = BitTiming::of(shared.can.read(BTR));
        assert_eq!(timing.bits_per_second(shared.clock_hz), Some(rate.bits_per_second().into()));
        let sample_point = if rate == BitRate::Kbit800 { 900 } else { 875 };
        assert_eq!(timing.sample_point(), sample_point, "{rate:?}");
    }
}

#[test]
fn a_bit_rate_is_changed_at_run_time_with_both_delays() {
    let mut client = ImageClient::booted();
    client.send("000: 02 00");
    client.send("7E5: 04 01 00 00 00 00 00 00");
    client.send("7E5: 13 00 02 00 00 00 00 00");
    client.expect("7E4: 13 00 00 00 00 00 00 00");
    client.send("7E5: 15 32 00 00 00 00 00 00");
    let board = client.bench.board;
    let rate = |client: &ImageClient| client.bench.rig.bits_per_second(board);
    client.wait_ms(45);
    assert_eq!(rate(&client), Some(250_000));
    client.wait_ms(10);
    assert_eq!(rate(&client), Some(500_000));
    client.bench.set_bit_rate(BitRate::Kbit500);
    client.send("7E5: 5E 00 00 00 00 00 00 00");
    assert_eq!(client.receive_for(protocol_core::time::Duration::from_millis(30)), None, "silent for the second delay");
    client.wait_ms(30);
    client.send("7E5: 5E 00 00 00 00 00 00 00");
    client.expect("7E4: 5E 20 00 00 00 00 00 00");
}

#[test]
fn what_waits_is_dropped_when_the_bit_rate_changes() {
    let mut client = ImageClient::booted();
    let board = client.bench.board;
    client.send("7E5: 04 01 00 00 00 00 00 00");
    client.send("7E5: 13 00 02 00 00 00 00 00");
    client.send("7E5: 15 32 00 00 00 00 00 00");
    client.wait_ms(5);
    // Nobody acknowledges what is sent now.
    let master = client.bench.master;
    client.bench.rig.world.remove_tap(master);
    fill(&mut client, 0, "7FF:");
    let empty = |client: &ImageClient| client.bench.rig.connections(board).can.lock().can.read(TSR) >> 26 & 0b111;
    let start = client.now_us();
    while client.bench.rig.bits_per_second(board) != Some(500_000) {
        if client.bench.rig.bits_per_second(board) == Some(250_000) {
            assert_eq!(empty(&client), 0b110, "it waits");
        }
        client.step();
        assert!(client.now_us() < start + 60_000, "the bit rate has not changed");
    }
    assert_eq!(empty(&client), 0b111, "it is dropped");
}

/// The valves of this release run at three of them. The timings of the others are those of the firmware's table, on the
/// clock that the image has set up, and the bus measures what the controller makes of them.
#[test]
fn each_timing_of_the_firmwares_table_is_exact_on_the_boards_clock() {
    let mut client = ImageClient::booted();
    let board = client.bench.board;
    for rate in BitRate::ALL {
        set_timing(&mut client, rate);
        assert_eq!(client.bench.rig.bits_per_second(board), Some(rate.bits_per_second().into()));
        assert_eq!(client.read(0x1018, 1), 0x0100_0019, "{rate:?}");
        let took = client.bench.rig.last_sent(board).expect("it was sent").as_micros();
        let bits = FrameBits::of(&frame("5A0: 43 18 10 01 19 00 00 01")).on_wire();
        let expected = u64::from(bits) * 1_000_000 / u64::from(rate.bits_per_second());
        assert!(took.abs_diff(expected) <= 1, "{rate:?}: {took} us instead of {expected} us");
    }
}

/// Runs bus and controller at a bit rate, behind the firmware's back.
pub fn set_timing(client: &mut ImageClient, rate: BitRate) {
    {
        let mut shared = client.bench.rig.connections(client.bench.board).can.lock();
        let control = shared.can.read(MCR);
        shared.can.write(MCR, control | mcr::INRQ);
        shared.can.write(BTR, firmware::bit_timing::BitTiming::of(rate).register());
        shared.can.write(MCR, control);
    }
    client.bench.set_bit_rate(rate);
    client.wait_ms(10);
}
