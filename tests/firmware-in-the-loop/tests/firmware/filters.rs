//! The hardware filters: what is for nobody costs the processor nothing, and what the device listens to gets through,
//! also after it was told to listen to something else.

use super::client::{ImageClient, frame};

/// What a valve on CANopen does not listen to, whatever it is set to here: PDOs, SDO, emergencies, heartbeats of
/// others, answers of LSS, its own identifiers, extended frames of other protocols.
const FOR_NOBODY: [&str; 23] = [
    "001: 01",
    "0A0: 00 00 00 00 00 00 00 00",
    "100: 00",
    "181: 00 00",
    "1A0: 0F 00",
    "224: 0F 00 00 00",
    "260: 0F 00 00 00",
    "5A0: 43 18 10 01 00 00 00 00",
    "624: 40 18 10 01 00 00 00 00",
    "630: 40 18 10 01 00 00 00 00",
    "720: 05",
    "7E4: 50 00 00 00 00 00 00 00",
    "7FF: FF",
    "18FF1234: FF FF FF FF",
    "18EAFF27: 00 EE 00",
    "1BC78823: 03 22 10 01",
    // Extended identifiers that begin as standard ones which it listens to, and the other way round.
    "00000000: 01 00",
    "02000000: 00",
    "08800000: 0F 00 00 00",
    "18800000: 40 18 10 01 00 00 00 00",
    "1F940000: 04 01 00 00 00 00 00 00",
    "6F0: 03 22 10 01",
    "6F1: 03 22 10 01",
];

/// How many messages the filters have let through.
fn came(client: &ImageClient) -> u64 {
    client.connections().can.lock().can.came().iter().sum()
}

/// How many of these frames the filters let through; answers are put aside.
fn pass(client: &mut ImageClient, frames: &[&str]) -> u64 {
    client.wait_ms(2);
    let before = came(client);
    for text in frames {
        client.send(text);
        client.wait_ms(2);
    }
    came(client) - before
}

/// Those of the frames that get through, each tried by itself.
fn through<'a>(client: &mut ImageClient, frames: &[&'a str]) -> Vec<&'a str> {
    frames.iter().copied().filter(|text| pass(client, &[*text]) != 0).collect()
}

#[test]
fn what_is_for_nobody_does_not_reach_the_processor() {
    let mut client = ImageClient::booted();
    assert_eq!(through(&mut client, &FOR_NOBODY), Vec::<&str>::new());
    client.send("000: 01 00");
    assert_eq!(through(&mut client, &FOR_NOBODY), Vec::<&str>::new(), "operational");
    let instructions = |client: &mut ImageClient, frames: &[&str]| {
        let before = client.machine().reached().instructions;
        let end = client.now_us() + 200_000;
        frames.iter().for_each(|text| client.send(text));
        client.wait_ms((end - client.now_us()) / 1000);
        client.machine().reached().instructions - before
    };
    client.aside.clear();
    let idle = instructions(&mut client, &[]);
    let crowded = instructions(&mut client, &FOR_NOBODY.repeat(10));
    // What the device does by itself falls into the one time or the other.
    assert!(crowded.abs_diff(idle) <= 3000, "{crowded} instructions in a crowd, {idle} alone");
}

#[test]
fn what_the_device_listens_to_gets_through() {
    let mut client = ImageClient::booted();
    client.send("000: 01 00");
    for heard in
        ["000: 01 00", "080:", "220: 00 00 00 00", "620: 40 00 10 00 00 00 00 00", "7E5: 04 00 00 00 00 00 00 00"]
    {
        assert_eq!(pass(&mut client, &[heard]), 1, "{heard}");
    }
    for tool in ["1BC78820: 03 22 10 01", "1BC00020: 03 22 10 01", "1BFFF820: 03 22 10 01"] {
        assert_eq!(pass(&mut client, &[tool]), 1, "{tool}: UDS from any source");
    }
    assert!(client.aside.iter().filter(|answer| answer.to_string().contains(": 04 62 10 01 20")).count() == 3);
}

#[test]
fn an_rpdo_that_was_moved_is_heard_where_it_is() {
    let mut client = ImageClient::booted();
    client.send("000: 01 00");
    client.write(0x1400, 1, 4, 0x8000_0220);
    assert_eq!(pass(&mut client, &["220: 00 00 00 00"]), 0, "it is off");
    client.write(0x1400, 1, 4, 0x8000_0224);
    client.write(0x1400, 1, 4, 0x224);
    assert_eq!(pass(&mut client, &["220: 00 00 00 00"]), 0);
    client.exchange("224: 00 00 00 00", "1A0: 08 00 00 00");
    client.write(0x1005, 0, 4, 0x90);
    client.write(0x1800, 2, 1, 1);
    assert_eq!(pass(&mut client, &["080:"]), 0);
    client.exchange("090:", "1A0: 08 00 00 00");
}

#[test]
fn an_emergency_stop_producer_is_heard_when_it_is_set_and_while_it_is_on() {
    let mut client = ImageClient::booted();
    let emergency = "0A1: 00 10 01 00 00 00 00 00";
    assert_eq!(pass(&mut client, &[emergency]), 0);
    client.write(0x1028, 1, 4, 0xA1);
    client.activate("220");
    client.send(emergency);
    client.exchange("220: 00 00 00 00", "1A0: 03 00 00 00");
    client.write(0x1028, 1, 4, 0x8000_00A1);
    assert_eq!(pass(&mut client, &[emergency]), 0);
}

#[test]
fn a_new_node_id_is_heard_and_the_old_one_no_longer() {
    let mut client = ImageClient::booted();
    client.send("7E5: 04 01 00 00 00 00 00 00");
    client.exchange("7E5: 11 24 00 00 00 00 00 00", "7E4: 11 00 00 00 00 00 00 00");
    client.exchange("7E5: 04 00 00 00 00 00 00 00", "724: 00");
    client.expect("0A4: 00 00 00 00 00 00 00 00");
    client.send("000: 01 00");
    let old = ["220: 00 00 00 00", "620: 40 18 10 01 00 00 00 00", "1BC78820: 03 22 10 01"];
    assert_eq!(through(&mut client, &old), Vec::<&str>::new());
    client.exchange("224: 00 00 00 00", "1A4: 08 00 00 00");
    client.exchange("624: 40 18 10 01 00 00 00 00", "5A4: 43 18 10 01 19 00 00 01");
    client.exchange("1BC78824: 03 22 10 01", "1BC120F1: 04 62 10 01 20");
}

#[test]
fn without_a_node_id_it_hears_lss_alone() {
    let mut client = ImageClient::booted();
    client.type_line("blank");
    client.wait_ms(600);
    client.aside.clear();
    let others = ["000: 01 00", "080:", "220: 00 00 00 00", "620: 40 18 10 01 00 00 00 00", "1BC78820: 03 22 10 01"];
    assert_eq!(through(&mut client, &others), Vec::<&str>::new());
    assert_eq!(pass(&mut client, &["7E5: 04 01 00 00 00 00 00 00"]), 1);
}

#[test]
fn filters_are_changed_without_losing_a_frame() {
    let mut client = ImageClient::booted();
    client.send("000: 01 00");
    client.wait_ms(5);
    let gaps = |client: &ImageClient| client.connections().can.lock().can.filter_gaps();
    let before = gaps(&client);
    let heard = came(&client);
    // Each of these writes changes what is listened to; the frames go out back to back.
    for round in 0..20_u32 {
        let id = 0xA1 + round % 3;
        client.send(&format!("620: 23 28 10 01 {id:02X} 00 00 00"));
        for _ in 0..4 {
            client.send("220: 00 00 00 00");
        }
    }
    let frames = client.listen_ms(150);
    let count = |start: &str| frames.iter().filter(|frame| frame.to_string().starts_with(start)).count();
    assert_eq!(count("5A0: 60 28 10 01"), 20);
    assert_eq!(came(&client) - heard, 20 + 80, "requests and RPDOs");
    // An instant is enough to lose a frame, and hard to hit: no filter that stays the same may be off at all.
    assert_eq!(gaps(&client), before, "filters were off that are the same afterwards");
}

#[test]
fn on_isobus_what_is_for_nobody_does_not_reach_the_processor() {
    let mut client = ImageClient::on_isobus();
    let for_nobody = [
        "0CFE3427: 32 FF 31 FF FF FF FF FF",
        "0CFE1327: 7D 7D 30 FF FF FF FF FF",
        "18EA8427: 00 EE 00",
        "18EEFF27: 05 00 20 07 08 FF 02 20",
        "18FECA27: 00 FF 00 00 00 00 FF FF",
        "0CF00400: FF FF FF FF FF FF FF FF",
        "18FEF100: FF FF FF FF FF FF FF FF",
        "1CEC8427: 20 09 00 02 FF D8 FE 00",
        "1BC78884: 03 22 10 01",
        "000: 01 00",
        "620: 40 18 10 01 00 00 00 00",
        "7E5: 04 01 00 00 00 00 00 00",
    ];
    assert_eq!(through(&mut client, &for_nobody), Vec::<&str>::new());
}

#[test]
fn on_isobus_what_the_device_listens_to_gets_through() {
    let mut client = ImageClient::on_isobus();
    for heard in [
        "0CFE3327: 00 FF 30 FF FF FF FF FF",
        "0CFE3301: 00 FF 30 FF FF FF FF FF",
        "18EA8327: CA FE 00",
        "18EAFF27: 00 EE 00",
        "18EEFF83: 02 00 20 07 08 FF 02 20",
        "1CECFF27: 20 09 00 02 FF D8 FE 00",
        "1CEBFF27: 01 01 00 20 07 08 FF 02",
        "1BC78883: 03 22 10 01",
        "1BC00083: 03 22 10 01",
    ] {
        assert_eq!(pass(&mut client, &[heard]), 1, "{heard}");
    }
}

#[test]
fn on_isobus_a_commanded_address_moves_them() {
    let mut client = ImageClient::on_isobus();
    for text in
        ["1CECFF27: 20 09 00 02 FF D8 FE 00", "1CEBFF27: 01 01 00 20 07 08 FF 02", "1CEBFF27: 02 20 85 FF FF FF FF FF"]
    {
        client.send(text);
        client.wait_ms(60);
    }
    let claimed = client.aside.iter().any(|sent| *sent == frame("18EEFF85: 01 00 20 07 08 FF 02 20"));
    assert!(claimed, "{:?}", client.aside);
    client.wait_ms(300);
    let old = ["0CFE3327: 00 FF 30 FF FF FF FF FF", "18EA8327: CA FE 00", "1BC78883: 03 22 10 01"];
    assert_eq!(through(&mut client, &old), Vec::<&str>::new());
    let new = ["0CFE3527: 00 FF 30 FF FF FF FF FF", "18EA8527: CA FE 00", "1BC78885: 03 22 10 01"];
    assert_eq!(through(&mut client, &new), new);
}
