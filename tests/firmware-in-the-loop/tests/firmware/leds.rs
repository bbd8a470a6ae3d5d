//! The LEDs in every state that they have a light for (SPEC 2).

use super::client::ImageClient;
use super::hands::Shown;

/// ACTIVE with a set-point of 50 %.
const DRIVE: &str = "220: 0F 00 00 20";
/// ACTIVE with the set-point 0.
const NEUTRAL: &str = "220: 0F 00 00 00";

/// Booted, started, and through the states to ACTIVE.
fn active() -> ImageClient {
    let mut client = ImageClient::booted();
    client.send("000: 01 00");
    for status in ["09", "0B", "0F"] {
        client.send(NEUTRAL);
        client.expect(&format!("1A0: {status} 00 00 00"));
    }
    client
}

#[test]
fn yellow_while_it_is_disabled() {
    let mut client = ImageClient::booted();
    assert_eq!(client.leds(), Shown::Yellow, "INIT");
    client.send("000: 01 00");
    for (word, state) in [("01", "DISABLED"), ("03", "HOLD")] {
        client.send(&format!("220: {word} 00 00 00"));
        assert_eq!(client.leds(), Shown::Yellow, "{state}");
    }
}

#[test]
fn yellow_in_hand_operation() {
    let mut client = active();
    client.write(0x6042, 0, 1, 2);
    assert_eq!(client.leds_while_sending(Some(DRIVE)), Shown::Yellow);
}

#[test]
fn green_while_it_regulates_and_flashing_in_power_save() {
    let mut client = active();
    assert_eq!(client.leds_while_sending(Some(DRIVE)), Shown::Green);
    for _ in 0..5 {
        client.send(NEUTRAL);
        client.wait_ms(100);
    }
    assert_eq!(client.leds_while_sending(Some(NEUTRAL)), Shown::GreenFlashing);
}

#[test]
fn red_for_an_internal_error_and_flashing_for_another_fault() {
    let mut client = ImageClient::booted();
    client.obeyed("temperature_c 130");
    client.wait_ms(600);
    assert_eq!(client.leds(), Shown::RedFlashing, "temperature");
    client.obeyed("internal_fault on");
    assert_eq!(client.leds(), Shown::Red, "internal error");
    client.obeyed("internal_fault off");
    assert_eq!(client.leds(), Shown::RedFlashing, "temperature again");
    client.obeyed("temperature_c 25");
    assert_eq!(client.leds(), Shown::RedFlashing, "FAULT_HOLD without a fault");
    client.send("000: 81 20");
    client.wait_ms(600);
    assert_eq!(client.leds(), Shown::Yellow, "INIT again");
}

#[test]
fn red_in_bus_off() {
    let mut client = ImageClient::booted();
    client.obeyed("bus_off on");
    assert_eq!(client.leds(), Shown::Red);
    client.obeyed("bus_off off");
    assert_eq!(client.leds(), Shown::RedFlashing, "FAULT_HOLD without a fault");
}

#[test]
fn yellow_without_a_node_id() {
    let mut client = ImageClient::booted();
    client.bench.rig.type_line(client.bench.board, "blank");
    client.wait_ms(300);
    assert_eq!(client.leds(), Shown::Yellow);
}

#[test]
fn on_isobus_green_for_a_set_point_and_yellow_by_hand_in_an_emergency_stop_and_without_an_address() {
    let mut client = ImageClient::on_isobus();
    assert_eq!(client.leds(), Shown::GreenFlashing, "blocked: power save");
    for (state, shown) in [("31", Shown::Green), ("3A", Shown::Yellow), ("31", Shown::Green), ("3E", Shown::Yellow)] {
        let command = format!("0CFE3327: 32 FF {state} FF FF FF FF FF");
        assert_eq!(client.leds_while_sending(Some(&command)), shown, "state {state}");
        // On in the cycle, for the time guard.
        client.wait_ms(50);
    }
    client.send("18EEFF83: 00 00 20 07 08 FF 02 20");
    assert_eq!(client.leds_while_sending(Some("18EAFF27: 00 EE 00")), Shown::Yellow, "cannot claim");
    assert!(client.aside.iter().any(|sent| sent.to_string().starts_with("18EEFFFE: ")), "{:?}", client.aside);
}
