//! The user button: each press injects the next fault and takes the last one away.

use super::client::ImageClient;

const NO_ERROR: &str = "0A0: 00 00 00 00 00 00 00 00";

/// What acts on the valve, as `status` tells it.
fn plant(client: &mut ImageClient) -> [String; 4] {
    ["supply_mv", "temperature_c", "spool", "internal_fault"].map(|name| client.status_of(name))
}

#[test]
fn each_press_is_the_next_fault_and_the_sixth_is_none() {
    let mut client = ImageClient::booted();
    let healthy = plant(&mut client);
    assert_eq!(healthy, ["24000", "25", "ok", "off"]);
    client.press_button();
    assert_eq!(plant(&mut client), ["8500", "25", "ok", "off"]);
    client.wait_ms(2000);
    client.expect("0A0: 12 34 05 01 00 00 00 00");
    client.press_button();
    assert_eq!(plant(&mut client), ["37000", "25", "ok", "off"]);
    client.expect(NO_ERROR);
    client.wait_ms(2000);
    client.expect("0A0: 11 34 05 01 00 00 00 00");
    client.press_button();
    assert_eq!(plant(&mut client), ["24000", "130", "ok", "off"]);
    client.expect(NO_ERROR);
    client.expect("0A0: 01 83 09 01 00 00 00 00");
    client.press_button();
    assert_eq!(plant(&mut client), ["24000", "25", "stuck", "off"]);
    client.expect(NO_ERROR);
    client.press_button();
    assert_eq!(plant(&mut client), ["24000", "25", "ok", "on"]);
    client.expect("0A0: 00 10 01 01 00 00 00 00");
    client.press_button();
    assert_eq!(plant(&mut client), healthy);
    client.expect(NO_ERROR);
    client.press_button();
    assert_eq!(plant(&mut client), ["8500", "25", "ok", "off"], "and over again");
}

#[test]
fn a_press_that_bounces_is_one() {
    let mut client = ImageClient::booted();
    for (pressed, ms) in
        [(true, 1), (false, 1), (true, 2), (false, 1), (true, 100), (false, 1), (true, 1), (false, 100)]
    {
        client.drive_button(pressed);
        client.wait_ms(ms);
    }
    assert_eq!(client.status_of("supply_mv"), "8500");
}

#[test]
fn what_is_shorter_than_three_looks_is_none_and_a_press_needs_no_line_to_be_seen() {
    let mut client = ImageClient::booted();
    for _ in 0..4 {
        for pressed in [true, false] {
            client.drive_button(pressed);
            client.wait_ms(15);
        }
    }
    assert_eq!(client.listen_ms(2500), [], "the supply is as it was");
    client.press_button();
    client.wait_ms(2000);
    client.expect("0A0: 12 34 05 01 00 00 00 00");
}

#[test]
fn one_that_is_held_is_one() {
    let mut client = ImageClient::booted();
    client.drive_button(true);
    client.wait_ms(1500);
    assert_eq!(client.status_of("supply_mv"), "8500");
    client.drive_button(false);
    client.wait_ms(100);
    assert_eq!(client.status_of("supply_mv"), "8500", "to let go is none");
}

#[test]
fn the_console_takes_away_what_the_button_brought() {
    let mut client = ImageClient::booted();
    client.press_button();
    client.obeyed("supply_mv 24000");
    assert_eq!(client.status_of("supply_mv"), "24000");
    client.wait_ms(2500);
    assert_eq!(client.listen_ms(1), []);
}
