//! The angle sensor on the board (SPEC 9): its shaft, by the words of the console; cyclic transmission; kind, LEDs and
//! button.

use hal_sim::bus::FrameBits;
use protocol_core::controller::BitRate;
use protocol_core::time::{Instant, since};

use super::client::{ImageClient, SAVE, download};
use super::hands::Shown;
use super::overtaking::{heard, listen};

/// So many positions are a turn.
const STEPS: i64 = 16_384;
/// How far from its instant a cyclic PDO may be requested, in microseconds.
const JITTER: i64 = 50;
/// How long a bit takes at 500 kbit/s, in microseconds.
const BIT_US: u64 = 2;
const CONTROLLER_ERROR: &str = "0A0: 00 FF 81 02 00 00 00 00";
const NO_ERROR: &str = "0A0: 00 00 00 00 00 00 00 00";

/// The sensor, operational, with its position every so many milliseconds, and the instant of the start.
fn cyclic(ms: u16) -> (ImageClient, Instant) {
    let mut client = ImageClient::sensor();
    client.write(0x1800, 5, 2, ms.into());
    client.write(0x1800, 1, 4, 0x1A0);
    let listener = listen(&mut client);
    client.send("000: 01 20");
    client.finish_sending();
    let (started, _) = heard(&mut client, listener).pop().expect("the start");
    (client, started)
}

/// The positions of the PDOs of so many milliseconds, each with the instant at which its frame began.
fn positions(client: &mut ImageClient, ms: u64) -> Vec<(Instant, i64)> {
    let listener = listen(client);
    client.listen_ms(ms);
    let frames = heard(client, listener).into_iter().filter(|(_, frame)| frame.to_string().starts_with("1A0:"));
    frames
        .map(|(end, frame)| {
            let [a, b, c, d] = *frame.data() else { panic!("{frame}: a position has four bytes") };
            let took = u64::from(FrameBits::of(&frame).on_wire()) * BIT_US;
            (Instant::from_micros(end.as_micros() - took), u32::from_le_bytes([a, b, c, d]).into())
        })
        .collect()
}

#[test]
fn a_pdo_a_millisecond_is_on_time() {
    let (mut client, started) = cyclic(1);
    let mut seen = Vec::new();
    // The console and the LEDs are busy meanwhile; they are below the device.
    for line in ["status", "help", "speed_rpm 100", "nonsense"] {
        client.type_line(line);
        seen.extend(positions(&mut client, 500));
    }
    let late: Vec<i64> = (1..)
        .zip(&seen)
        .map(|(number, (began, _))| began.as_micros() as i64 - (started.as_micros() as i64 + number * 1000))
        .collect();
    let (least, most) = (late.iter().min().expect("there are some"), late.iter().max().expect("there are some"));
    println!("{} PDOs, {least} to {most} us after their instant", seen.len());
    assert!((1_995..=2_001).contains(&seen.len()), "{} PDOs in 2 s", seen.len());
    assert!(*least >= -JITTER && *most <= JITTER, "{least} to {most} us after their instant");
    client.end_without_reset();
}

#[test]
fn a_shaft_turns_by_itself_and_stands_where_it_is_put() {
    let (mut client, _) = cyclic(10);
    for (line, steps_in_a_second) in [("speed_rpm 60", STEPS), ("speed_rpm -150", -STEPS * 5 / 2), ("speed_rpm 0", 0)] {
        client.obeyed(line);
        client.listen_ms(20);
        let seen = positions(&mut client, 1_500);
        assert!(seen.len() >= 149, "{line}: {} PDOs", seen.len());
        let (start, first) = seen[0];
        for (at, position) in seen {
            let turned = since(at, start).as_micros() as i64 * steps_in_a_second / 1_000_000;
            let apart = (position - first - turned).rem_euclid(STEPS);
            assert!(apart <= 4 || apart >= STEPS - 4, "{line}: {position} at {at} is {apart} steps too far");
        }
    }
    client.obeyed("angle_cdeg 9000");
    client.listen_ms(20);
    assert!(positions(&mut client, 100).iter().all(|(_, position)| *position == STEPS / 4));
    client.obeyed("speed_rpm 60");
    client.wait_ms(250);
    client.obeyed("speed_rpm 0");
    let told: i64 = client.status_of("angle_cdeg").parse().expect("a number");
    // A quarter of a turn, and the time that the console takes.
    assert!((18_000..19_000).contains(&told), "{told} 1/100 degree");
    assert_eq!(client.read(0x6004, 0), u32::try_from(told * STEPS / 36_000).expect("a position"));
}

#[test]
fn the_words_of_the_shaft_show_on_the_bus() {
    let mut client = ImageClient::sensor();
    client.obeyed("measuring_error on");
    assert_eq!(client.read(0x6503, 0), 1);
    assert_eq!(client.read(0x1001, 0), 0, "an alarm, no error");
    client.obeyed("measuring_error off");
    assert_eq!(client.read(0x6503, 0), 0);
    client.obeyed("internal_fault on");
    client.expect(CONTROLLER_ERROR);
    client.obeyed("internal_fault off");
    client.expect(NO_ERROR);
    client.obeyed("bus_off on");
    client.wait_ms(50);
    client.obeyed("bus_off off");
    client.expect("0A0: 40 81 11 04 00 00 00 00");
    client.expect(NO_ERROR);
    client.obeyed("memory write-fails");
    let refused = client.sdo(download(0x1010, 1, 4, SAVE));
    assert_eq!(refused, [0x80, 0x10, 0x10, 0x01, 0x00, 0x00, 0x06, 0x06], "0x06060000");
    client.obeyed("memory ok");
    client.write(0x1010, 1, 4, SAVE);
    assert_eq!(client.listen_ms(10), [], "a failed write is no error of the sensor");
    client.end_without_reset();
}

#[test]
fn a_valve_becomes_a_sensor_and_stays_one() {
    let mut client = ImageClient::booted();
    assert_eq!(client.obeyed("kind hat3000 77"), Vec::<String>::new());
    client.rig.set_bit_rate(BitRate::Kbit500);
    for _ in 0..2 {
        client.expect("701: 00");
        assert_eq!(client.status_of("kind"), "hat3000");
        assert_eq!(client.status_of("bit_rate"), "500000");
        for (request, answer) in [
            ("601: 40 08 10 00 00 00 00 00", "581: 41 08 10 00 08 00 00 00"),
            ("601: 60 00 00 00 00 00 00 00", "581: 00 48 41 54 20 33 30 30"),
            ("601: 70 00 00 00 00 00 00 00", "581: 1D 30 00 00 00 00 00 00"),
            ("601: 40 18 10 04 00 00 00 00", "581: 43 18 10 04 4D 00 00 00"),
        ] {
            client.exchange(request, answer);
        }
        client.rig.power_cycle();
    }
    client.expect("701: 00");
    client.type_line("blank");
    client.wait_ms(500);
    assert_eq!(client.status_of("node_id"), "none");
    assert_eq!(client.leds(), Shown::Yellow, "no node ID");
    assert_eq!(client.listen_ms(10), [], "no boot-up");
    client.send("7E5: 04 01 00 00 00 00 00 00");
    client.exchange("7E5: 5E 00 00 00 00 00 00 00", "7E4: 5E FF 00 00 00 00 00 00");
}

#[test]
fn the_leds_show_what_the_board_knows() {
    let mut client = ImageClient::sensor();
    assert_eq!(client.leds(), Shown::Green);
    for (word, shown) in [("measuring_error", Shown::RedFlashing), ("internal_fault", Shown::RedFlashing)] {
        client.obeyed(&format!("{word} on"));
        assert_eq!(client.leds(), shown, "{word}");
        client.obeyed(&format!("{word} off"));
    }
    client.obeyed("bus_off on");
    assert_eq!(client.leds(), Shown::Red, "bus-off");
    client.obeyed("internal_fault on");
    assert_eq!(client.leds(), Shown::Red, "bus-off goes first");
    client.obeyed("internal_fault off");
    client.obeyed("bus_off off");
    assert_eq!(client.leds(), Shown::Green);
}

#[test]
fn the_button_goes_through_the_faults_of_a_sensor() {
    let mut client = ImageClient::sensor();
    client.obeyed("angle_cdeg 4500");
    let faults = ["measuring_error", "internal_fault"];
    for expected in [["on", "off"], ["off", "on"], ["off", "off"], ["on", "off"]] {
        client.press_button();
        assert_eq!(faults.map(|name| client.status_of(name)), expected);
    }
    client.expect(CONTROLLER_ERROR);
    client.expect(NO_ERROR);
    assert_eq!(client.status_of("angle_cdeg"), "4500", "the rest stays");
}
