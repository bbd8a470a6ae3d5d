//! The LEDs in each light that they have (SPEC 2). Which state has which light the core's tests tell.

use super::client::ImageClient;
use super::hands::Shown;

/// ACTIVE with a set-point of 50 %.
const DRIVE: &str = "220: 0F 00 00 20";
/// ACTIVE with the set-point 0.
const NEUTRAL: &str = "220: 0F 00 00 00";

#[test]
fn green_while_it_regulates_and_flashing_in_power_save() {
    let mut client = ImageClient::booted();
    client.activate("220");
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
    assert_eq!(client.leds(), Shown::Yellow, "INIT");
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
