//! All bit rates of SPEC 1, as the firmware sets the controller and as the bus measures them.

use firmware_in_the_loop::board::NUCLEO_F429ZI;
use firmware_in_the_loop::bxcan::BitTiming;
use firmware_in_the_loop::bxcan::registers::{BTR, TSR};
use firmware_in_the_loop::flash::Operation;
use hal_sim::WireEvent;
use hal_sim::bus::FrameBits;
use protocol_core::controller::BitRate;
use protocol_core::time::{Duration, Instant, since};

use super::client::{ImageClient, SAVE, SENSOR, VALVE, frame};
use super::overtaking::{fill, heard, listen};

/// The cycle of the heartbeat where one is watched.
const HEARTBEAT_MS: u64 = 20;
/// Much shorter than a frame at 20 kbit/s.
const SOON: Duration = Duration::from_micros(100);

#[test]
fn each_bit_rate_of_a_valve_is_exact_and_samples_where_cia_says() {
    for rate in VALVE.kind.bit_rates().iter().copied() {
        let mut client = ImageClient::booted();
        configure_by_lss(&mut client, rate);
        for text in ["720: 00", "0A0: 00 00 00 00 00 00 00 00"] {
            client.expect(text);
            assert_exact(&client, rate, text);
        }
    }
}

#[test]
fn each_bit_rate_of_an_angle_sensor_is_exact_and_samples_where_cia_says() {
    assert_eq!(SENSOR.kind.bit_rates().len(), BitRate::ALL.len());
    for rate in BitRate::ALL {
        let mut client = ImageClient::sensor();
        configure_by_lss(&mut client, rate);
        client.expect("720: 00");
        assert_exact(&client, rate, "720: 00");
        assert_eq!(client.read(0x1018, 1), 0xDA, "{rate:?}");
        assert_exact(&client, rate, "5A0: 43 18 10 01 DA 00 00 00");
        client.end_without_reset();
    }
}

/// From one to the next, without a power cycle: object 0x2002, stored by 0x1010:4, is in force after reset node.
#[test]
fn an_angle_sensor_goes_through_all_bit_rates_by_its_parameters() {
    let mut client = ImageClient::sensor();
    assert_eq!(client.bits_per_second(), Some(500_000), "that of a new memory");
    for rate in BitRate::ALL {
        client.write(0x2002, 2, 1, rate.table_index().into());
        client.write(0x1010, 4, 4, SAVE);
        client.send("000: 81 20");
        let start = client.now_us();
        while client.bits_per_second() != Some(rate.bits_per_second().into())
            || client.rig.boards.world.pending(client.rig.master) > 0
        {
            client.step();
            assert!(client.now_us() < start + 100_000, "{rate:?} is not in force");
        }
        client.rig.set_bit_rate(rate);
        client.aside.clear();
        // The boot-up may have met the old bit rate of the bus: what counts is that the sensor answers at the new one.
        client.wait_ms(100);
        assert_eq!(client.read(0x2002, 1), u32::from(rate.table_index()), "{rate:?}");
        assert_exact(&client, rate, &format!("5A0: 4F 02 20 01 {:02X} 00 00 00", rate.table_index()));
    }
}

/// Sets a bit rate by LSS, for whatever comes next.
fn set_by_lss(client: &mut ImageClient, rate: BitRate) {
    client.send("7E5: 04 01 00 00 00 00 00 00");
    client.exchange(&format!("7E5: 13 00 {:02X} 00 00 00 00 00", rate.table_index()), "7E4: 13 00 00 00 00 00 00 00");
}

/// Switches to a bit rate by LSS, with delays of 50 ms.
fn switch_by_lss(client: &mut ImageClient, rate: BitRate) {
    set_by_lss(client, rate);
    client.send("7E5: 15 32 00 00 00 00 00 00");
}

/// Stores a bit rate by LSS, and switches the device off and on on a bus that has it.
fn configure_by_lss(client: &mut ImageClient, rate: BitRate) {
    set_by_lss(client, rate);
    client.exchange("7E5: 17 00 00 00 00 00 00 00", "7E4: 17 00 00 00 00 00 00 00");
    client.wait_ms(20);
    client.rig.set_bit_rate(rate);
    client.rig.power_cycle();
}

/// The frame that the board has sent last took as long as its bits do, and the controller samples where it should.
fn assert_exact(client: &ImageClient, rate: BitRate, text: &str) {
    let (boards, board) = (&client.rig.boards, client.rig.board);
    let took = boards.last_sent(board).expect("it was sent").as_micros();
    let bits = FrameBits::of(&frame(text)).on_wire();
    let expected = u64::from(bits) * 1_000_000 / u64::from(rate.bits_per_second());
    assert!(took.abs_diff(expected) <= 1, "{rate:?}: {text} took {took} us instead of {expected} us");
    let shared = boards.connections(board).can.lock();
    let timing = BitTiming::of(shared.can.read(BTR));
    assert_eq!(timing.bits_per_second(shared.clock_hz), Some(rate.bits_per_second().into()));
    let sample_point = if rate == BitRate::Kbit800 { 900 } else { 875 };
    assert_eq!(timing.sample_point(), sample_point, "{rate:?}");
    // No more than there are behind the sample point.
    let jump_width = if rate.bits_per_second() <= 500_000 { 2 } else { 1 };
    assert_eq!(timing.jump_width, jump_width, "{rate:?}");
}

#[test]
fn a_bit_rate_is_changed_at_run_time_with_both_delays() {
    let mut client = ImageClient::booted();
    client.send("000: 02 00");
    switch_by_lss(&mut client, BitRate::Kbit500);
    let rate = |client: &ImageClient| client.bits_per_second();
    client.wait_ms(45);
    assert_eq!(rate(&client), Some(250_000));
    client.wait_ms(10);
    assert_eq!(rate(&client), Some(500_000));
    client.rig.set_bit_rate(BitRate::Kbit500);
    client.send("7E5: 5E 00 00 00 00 00 00 00");
    assert_eq!(client.receive_for(Duration::from_millis(30)), None, "silent for the second delay");
    client.wait_ms(30);
    client.exchange("7E5: 5E 00 00 00 00 00 00 00", "7E4: 5E 20 00 00 00 00 00 00");
}

#[test]
fn what_waits_is_dropped_when_the_bit_rate_changes() {
    let mut client = ImageClient::booted();
    switch_by_lss(&mut client, BitRate::Kbit500);
    client.wait_ms(5);
    // Nobody acknowledges what is sent now.
    let master = client.rig.master;
    client.rig.boards.world.remove_client_port(master);
    fill(&mut client, 0, "7FF:");
    let empty = |client: &ImageClient| client.connections().can.lock().can.read(TSR) >> 26 & 0b111;
    let start = client.now_us();
    while client.bits_per_second() != Some(500_000) {
        if client.bits_per_second() == Some(250_000) {
            assert_eq!(empty(&client), 0b110, "it waits");
        }
        client.step();
        assert!(client.now_us() < start + 60_000, "the bit rate has not changed");
    }
    assert_eq!(empty(&client), 0b111, "it is dropped");
}

/// The sensor at 20 kbit/s, where a frame takes milliseconds, told to go to another bit rate; and when it does that, in us.
fn about_to_switch() -> (ImageClient, u64) {
    let mut client = ImageClient::sensor();
    configure_by_lss(&mut client, BitRate::Kbit20);
    client.expect("720: 00");
    client.write(0x1017, 0, 2, HEARTBEAT_MS as u32);
    client.send("7E5: 04 01 00 00 00 00 00 00");
    client.send("7E5: 13 00 04 00 00 00 00 00");
    while client.receive() != Some(frame("7E4: 13 00 00 00 00 00 00 00")) {}
    client.send("7E5: 15 32 00 00 00 00 00 00");
    client.finish_sending();
    let switch = client.now_us() + 50_000;
    assert_eq!(client.bits_per_second(), Some(20_000));
    (client, switch)
}

/// Lets time pass until the controller has left its bit rate.
fn left(client: &mut ImageClient) -> u64 {
    let start = client.now_us();
    while client.bits_per_second() == Some(20_000) {
        client.step();
        assert!(client.now_us() < start + 200_000, "the bit rate has not changed");
    }
    client.now_us()
}

#[test]
fn the_frame_on_the_wire_ends_before_the_bit_rate_changes() {
    let (mut client, switch) = about_to_switch();
    client.rig.boards.run_until(Instant::from_micros(switch - 1000));
    client.send("7FF: 55 55 55 55 55 55 55 55");
    client.rig.boards.run_until(Instant::from_micros(switch + 3000));
    assert!(client.rig.boards.world.pending(client.rig.master) > 0, "the frame is on the wire");
    left(&mut client);
    assert_eq!(client.rig.boards.world.pending(client.rig.master), 0, "it was acknowledged");
    // What is due next is on time, though the task has waited for something else meanwhile.
    client.rig.set_bit_rate(BitRate::Kbit125);
    client.aside.clear();
    client.expect("720: 7F");
    let late = client.now_us() - switch;
    assert!((50_000..50_000 + 1_000 * HEARTBEAT_MS + 2_000).contains(&late), "{late} us after the bit rate changed");
    client.end_without_reset();
}

#[test]
fn on_a_bus_where_no_frame_ever_ends_the_bit_rate_changes_all_the_same() {
    let (mut client, switch) = about_to_switch();
    client.rig.boards.run_until(Instant::from_micros(switch - 1000));
    client.connections().can.lock().can.hear(WireEvent::Begins { own: false });
    let late = left(&mut client) - switch;
    assert!((20_000..30_000).contains(&late), "{late} us after its instant");
    client.rig.set_bit_rate(BitRate::Kbit125);
    client.wait_ms(100);
    assert_eq!(client.bits_per_second(), Some(125_000));
    client.send("7E5: 5E 00 00 00 00 00 00 00");
    client.aside.clear();
    while client.receive() != Some(frame("7E4: 5E 20 00 00 00 00 00 00")) {}
    client.end_without_reset();
}

/// Holds the bus dominant, as a transceiver without supply does, or releases it.
fn hold_dominant(client: &ImageClient, held: bool) {
    let mut shared = client.connections().can.lock();
    shared.can.hold_dominant(held);
    shared.changed = true;
}

#[test]
fn on_a_bus_that_is_held_dominant_the_bit_rate_changes_when_it_is_released() {
    let (mut client, switch) = about_to_switch();
    client.rig.boards.run_until(Instant::from_micros(switch - 1000));
    hold_dominant(&client, true);
    // Longer than the watchdog's time.
    client.rig.boards.run_until(Instant::from_micros(switch + 2_000_000));
    assert_eq!(client.status_of("bit_rate"), "125000");
    assert_ne!(client.bits_per_second(), Some(125_000));
    hold_dominant(&client, false);
    client.rig.set_bit_rate(BitRate::Kbit125);
    client.wait_ms(200);
    assert_eq!(client.bits_per_second(), Some(125_000));
    client.aside.clear();
    client.expect("720: 7F");
    client.end_without_reset();
}

#[test]
fn a_controller_that_is_kept_bus_off_on_a_bus_that_is_held_dominant_comes_back_when_it_is_released() {
    let mut client = ImageClient::booted();
    client.wait_ms(50);
    hold_dominant(&client, true);
    client.obeyed("bus_off on");
    client.obeyed("bus_off off");
    client.wait_ms(1000);
    assert_eq!(client.status_of("bus"), "bus-off");
    hold_dominant(&client, false);
    client.wait_ms(50);
    assert_eq!(client.status_of("bus"), "error-active");
    client.aside.clear();
    assert_eq!(client.read(0x1018, 1), 0x0100_0019);
    client.end_without_reset();
}

#[test]
fn the_console_says_that_it_is_off_the_bus_when_it_is() {
    let (mut client, _) = about_to_switch();
    client.connections().terminal.lock().typed.extend(b"bus_off on");
    client.wait_ms(5);
    client.printed();
    client.send("7FF: 55 55 55 55 55 55 55 55");
    client.connections().terminal.lock().typed.push_back(b'\n');
    let mut said = String::new();
    while said.is_empty() {
        client.rig.boards.run_for(SOON);
        said = client.printed();
    }
    assert_eq!(client.rig.boards.world.pending(client.rig.master), 0, "the frame on the wire has ended");
    assert_eq!(client.bits_per_second(), None);
}

/// The valve saves its parameters, and the erase in that ends while its controller waits for the end of a frame to leave
/// the bus, in vain; a line has perhaps asked the memory for something more.
fn save_while_the_bus_is_left(line: Option<&str>) -> ImageClient {
    let mut client = ImageClient::about_to_erase(&NUCLEO_F429ZI);
    let board = client.rig.board;
    set_by_lss(&mut client, BitRate::Kbit500);
    client.send("620: 23 10 10 01 73 61 76 65");
    let until = loop {
        let last = client.connections().flash.lock().journal().last().copied();
        if let Some(erase) = last.filter(Operation::is_erase) {
            break client.rig.boards.instant(board, erase.until).as_micros();
        }
        client.step();
    };
    client.printed();
    line.into_iter().for_each(|line| client.type_line(line));
    client.rig.boards.run_until(Instant::from_micros(until - 58_000));
    client.send("7E5: 15 32 00 00 00 00 00 00");
    client.rig.boards.run_until(Instant::from_micros(until - 10_000));
    client.connections().can.lock().can.hear(WireEvent::Begins { own: false });
    client.rig.boards.run_until(Instant::from_micros(until + 4_000));
    if line.is_none() {
        // Comes after the end of the store.
        client.type_line("lever off");
    }
    client.rig.boards.run_until(Instant::from_micros(until + 8_000));
    assert_eq!(client.bits_per_second(), Some(250_000), "it waits for the end of the frame");
    client.rig.boards.run_until(Instant::from_micros(until + 20_000));
    assert_ne!(client.bits_per_second(), Some(250_000));
    client.rig.set_bit_rate(BitRate::Kbit500);
    client
}

#[test]
fn a_store_that_ends_while_the_bus_is_left_is_noticed() {
    let mut client = save_while_the_bus_is_left(None);
    client.wait_ms(100);
    assert_eq!(client.printed(), "ok\r\n");
    client.write(0x1010, 1, 4, SAVE);
    client.end_without_reset();
}

#[test]
fn two_stores_that_end_while_the_bus_is_left_are_both_noticed() {
    let mut client = save_while_the_bus_is_left(Some("blank"));
    client.wait_ms(700);
    assert_eq!(client.printed(), "ok\r\n");
    assert_eq!(client.status_of("node_id"), "none");
}

#[test]
fn a_bit_rate_that_changes_while_the_valve_is_kept_bus_off_is_that_of_the_way_back() {
    let mut client = ImageClient::booted();
    switch_by_lss(&mut client, BitRate::Kbit500);
    client.wait_ms(5);
    client.obeyed("bus_off on");
    client.wait_ms(100);
    assert_eq!(client.bits_per_second(), None);
    client.obeyed("bus_off off");
    client.wait_ms(10);
    assert_eq!(client.bits_per_second(), Some(500_000));
    assert_eq!(client.status_of("bit_rate"), "500000");
}

/// The restart makes the controller leave the bus, which waits for the request on the wire: the heartbeat that the request
/// starts counts from the end of the request, not from the restart.
#[test]
fn a_request_that_the_controller_waits_for_before_it_leaves_has_its_own_time() {
    let mut client = ImageClient::booted();
    let listener = listen(&mut client);
    let request = "620: 2B 17 10 00 0A 00 00 00";
    client.send("000: 82 20");
    // The memory is read first; the request is on the wire when that is done.
    for _ in 0..3 {
        client.send("7FF: 00 00 00 00 00 00 00 00");
    }
    client.send(request);
    client.listen_ms(40);
    let seen = heard(&mut client, listener);
    let ends = |text| seen.iter().filter(move |(_, sent)| *sent == frame(text)).map(|(at, _)| *at);
    let request = ends(request).next().expect("the request is on the wire");
    // The first heartbeat tells the new state at once.
    let heartbeat = ends("720: 7F").nth(1).expect("there is a heartbeat");
    let length = FrameBits::of(&frame("720: 7F")).on_wire() * 1_000_000 / BitRate::Kbit250.bits_per_second();
    let cycle = since(heartbeat, request).as_micros() - u64::from(length);
    assert!((10_000..10_100).contains(&cycle), "{cycle} us from the request to the second heartbeat: {seen:?}");
    client.end_without_reset();
}
