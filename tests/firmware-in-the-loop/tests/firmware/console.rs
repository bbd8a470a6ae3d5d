//! The words of the console (docs/board.md): what acts on the valve, what it is, and its power.

use firmware_in_the_loop::board::NUCLEO_F429ZI;
use firmware_in_the_loop::rig::ImageRig;
use protocol_core::controller::BitRate;
use protocol_core::device::Kind;
use protocol_core::frame::Frame;
use protocol_core::time::Duration;

use super::client::{ImageClient, SAVE, VALVE, download};

const NO_ERROR: &str = "0A0: 00 00 00 00 00 00 00 00";
/// Characters of a line.
const LONGEST_LINE: usize = 48;
const INTERNAL_ERROR: &str = "0A0: 00 10 01 01 00 00 00 00";
/// The claim of a new valve on ISOBUS.
const CLAIM: &str = "18EEFF80: 01 00 20 07 08 FF 02 20";

#[test]
fn each_word_of_a_valve_is_seen_in_the_status() {
    is_seen_in_the_status(
        ImageClient::booted(),
        "pvea-canopen",
        &[
            ("supply_mv", &["8500", "0", "100000", "24000"]),
            ("temperature_c", &["130", "-41", "1000", "-273", "25"]),
            ("spool", &["stuck", "slow", "drifting", "no-float", "ok"]),
            ("lever", &["4000", "-16384", "off"]),
        ],
    );
}

#[test]
fn each_word_of_an_angle_sensor_is_seen_in_the_status() {
    is_seen_in_the_status(
        ImageClient::sensor(),
        "hat1000",
        &[
            ("angle_cdeg", &["35999", "9000", "0"]),
            ("speed_rpm", &["2147483647", "-2147483648", "0"]),
            ("measuring_error", &["on", "off"]),
        ],
    );
}

/// The words of a kind, and those of all, are told as they were typed.
fn is_seen_in_the_status(mut client: ImageClient, kind: &str, own: &[(&str, &[&str])]) {
    let common: [(&str, &[&str]); 3] =
        [("internal_fault", &["on", "off"]), ("memory", &["write-fails", "ok"]), ("bus_off", &["on", "off"])];
    for (name, values) in own.iter().chain(&common) {
        for value in *values {
            assert_eq!(client.obeyed(&format!("{name} {value}")), Vec::<String>::new());
            assert_eq!(client.status_of(name), *value, "{name}");
        }
    }
    assert_eq!(client.status_of("kind"), kind);
    client.end_without_reset();
}

#[test]
fn a_word_of_another_kind_is_refused() {
    for (mut client, lines) in [
        (ImageClient::booted(), &["angle_cdeg 1", "speed_rpm 1", "measuring_error on"][..]),
        (ImageClient::sensor(), &["supply_mv 8500", "temperature_c 99", "spool stuck", "lever off"]),
    ] {
        let before = client.status();
        for line in lines {
            let refusal = client.console(line).expect_err(line);
            assert_eq!(refusal, "not a word of this kind of device: help lists all words");
            assert_eq!(client.status(), before, "{line:?}");
        }
        client.end_without_reset();
    }
}

#[test]
fn a_terminal_ends_lines_as_it_likes_and_takes_characters_back() {
    let mut client = ImageClient::booted();
    for (typed, answers) in [
        ("supply_mv 850\u{7F}\u{8}4500\r", "ok\r\n"),
        ("temperature_c 99\r\n", "ok\r\n"),
        ("lever 4000\nlever off\r\n", "ok\r\nok\r\n"),
    ] {
        client.connections().terminal.lock().typed.extend(typed.bytes());
        client.wait_ms(50);
        assert_eq!(client.printed(), answers, "{typed:?}");
    }
    for (name, value) in [("supply_mv", "84500"), ("temperature_c", "99"), ("lever", "off")] {
        assert_eq!(client.status_of(name), value, "{name}");
    }
}

#[test]
fn help_tells_all_words_of_the_kind_and_no_others() {
    for (mut client, other) in [(ImageClient::booted(), "angle_cdeg"), (ImageClient::sensor(), "supply_mv")] {
        let help = client.obeyed("help");
        let is_told = |word: &str| help.iter().any(|line| line.split(' ').next() == Some(word));
        let own = ["node_id", "bit_rate", "bus", "error_interrupts", "overruns", "dropped"];
        let status = client.status();
        let words = status.iter().map(|(name, _)| name.as_str()).filter(|name| !own.contains(name));
        for word in words.chain(["status", "blank", "power-cycle"]) {
            assert!(is_told(word), "{word} is missing in {help:?}");
        }
        assert!(!is_told(other), "{other} is none of its words");
        for kind in Kind::ALL {
            assert!(help.iter().any(|line| line.contains(kind.name())), "{kind} is missing");
        }
        client.end_without_reset();
    }
}

#[test]
fn what_it_does_not_know_changes_nothing() {
    let mut client = ImageClient::booted();
    let before = client.status();
    // As long as a line can be, and one character more: it is not taken for what it begins with.
    let longest = |value: &str| format!("supply_mv{}{value}", " ".repeat(LONGEST_LINE - "supply_mv24000".len()));
    assert_eq!(client.obeyed(&longest("24000")), Vec::<String>::new());
    for line in [
        "help me",
        "supply_mv",
        "supply_mv x",
        "supply_mv 1 2",
        "temperature_c 99999",
        "spool bent",
        "lever 16385",
        "internal_fault",
        "memory bad",
        "bus_off 1",
        "kind",
        "kind pvea",
        "status now",
        &"x".repeat(300),
        &longest("240001"),
    ] {
        let answer = client.console(line).expect_err(line);
        assert_eq!(answer, "invalid line: help lists all words");
        assert_eq!(client.status(), before, "{line:?}");
    }
    assert_eq!(client.read(0x1018, 1), 0x0100_0019);
    client.end_without_reset();
}

#[test]
fn what_acts_on_the_valve_shows_on_the_bus() {
    let mut client = ImageClient::booted();
    client.obeyed("supply_mv 8500");
    client.wait_ms(2100);
    client.expect("0A0: 12 34 05 01 00 00 00 00");
    client.obeyed("supply_mv 24000");
    client.expect(NO_ERROR);
    client.obeyed("temperature_c -41");
    client.expect("0A0: 01 83 09 01 00 00 00 00");
    client.obeyed("temperature_c 25");
    client.expect(NO_ERROR);
    client.obeyed("lever 8192");
    client.wait_ms(400);
    assert_eq!(client.read(0x6301, 1), 8192, "the lever moves the spool");
    client.obeyed("lever off");
    client.wait_ms(400);
    assert_eq!(client.read(0x6301, 1), 0, "and the springs return it");
}

#[test]
fn a_memory_that_fails_refuses_to_save_and_is_an_internal_error() {
    let mut client = ImageClient::booted();
    client.obeyed("memory write-fails");
    let refused = client.sdo(download(0x1010, 1, 4, SAVE));
    assert_eq!(refused, [0x80, 0x10, 0x10, 0x01, 0x00, 0x00, 0x06, 0x06], "0x06060000");
    client.expect(INTERNAL_ERROR);
    client.obeyed("memory ok");
    client.write(0x1010, 1, 4, SAVE);
    client.expect(NO_ERROR);
    assert_eq!(client.read(0x2024, 0), 1);
    client.end_without_reset();
}

#[test]
fn kept_bus_off_it_is_silent_until_it_may_recover() {
    let mut client = ImageClient::booted();
    // Somebody else acknowledges the request, or it would be repeated until the valve is back.
    client.rig.boards.world.add_gateway("listener");
    client.obeyed("bus_off on");
    assert_eq!(client.try_sdo([0x40, 0x18, 0x10, 1, 0, 0, 0, 0]), None);
    client.obeyed("bus_off off");
    client.expect("0A0: 40 81 11 01 00 00 00 00");
    client.expect(NO_ERROR);
    assert_eq!(client.read(0x1018, 1), 0x0100_0019);
    assert_eq!(client.read(0x2019, 0), 1);
}

/// As docs/board.md expects it of a board ("The first day on silicon"): the boot-up, which nobody acknowledged, is not in
/// a mailbox any more when the valve sends it again.
#[test]
fn kept_off_before_anybody_acknowledged_it_boots_once_and_reports_bus_off() {
    let mut client = ImageClient::started(ImageRig::with_device(&NUCLEO_F429ZI, BitRate::Kbit250, &VALVE));
    let master = client.rig.master;
    client.rig.boards.world.remove_client_port(master);
    client.wait_ms(500);
    client.obeyed("bus_off on");
    client.obeyed("bus_off off");
    client.rig.master = client.rig.boards.world.add_client_port("another node");
    let told: Vec<String> = client.listen_ms(100).iter().map(Frame::to_string).collect();
    assert_eq!(told, ["720: 00", NO_ERROR, "0A0: 40 81 11 01 00 00 00 00", NO_ERROR]);
    client.end_without_reset();
}

#[test]
fn let_go_it_takes_128_sequences_of_11_bits_to_recover() {
    for (mut client, bit_us) in [(ImageClient::booted(), 4), (ImageClient::sensor(), 2)] {
        client.obeyed("bus_off on");
        client.connections().terminal.lock().typed.extend(b"bus_off off");
        client.wait_ms(10);
        assert_eq!(client.bits_per_second(), None);
        client.connections().terminal.lock().typed.push_back(b'\n');
        let start = client.now_us();
        while client.bits_per_second().is_none() {
            assert!(client.now_us() < start + 100_000, "it does not come back");
            client.step();
        }
        let (took, recovery) = (client.now_us() - start, 128 * 11 * bit_us);
        // The board looks every millisecond.
        assert!((recovery..recovery + 1_200).contains(&took), "{took} us at {bit_us} us a bit");
        client.end_without_reset();
    }
}

#[test]
fn a_kind_that_cannot_be_stored_is_refused_and_nothing_starts_anew() {
    let mut client = ImageClient::booted();
    client.printed();
    client.connections().flash.lock().set_fails(true);
    client.type_line("kind pveo-canopen");
    client.wait_ms(300);
    assert_eq!(client.printed(), "the memory failed\r\n");
    assert_eq!(client.listen_ms(1), []);
    client.connections().flash.lock().set_fails(false);
    assert_eq!(client.status_of("kind"), "pvea-canopen");
    client.type_line("kind pveo-canopen");
    client.expect("720: 00");
    assert_eq!(client.status_of("kind"), "pveo-canopen");
}

#[test]
fn a_power_cycle_starts_it_as_power_would_and_loses_nothing_stored() {
    let mut client = ImageClient::booted();
    for (save, kept) in [(false, 0xFF), (true, 5)] {
        client.write(0x1800, 2, 1, 5);
        if save {
            client.write(0x1010, 1, 4, SAVE);
        }
        client.type_line("power-cycle");
        client.expect_boot();
        assert_eq!(client.read(0x1800, 2), kept, "saved: {save}");
        assert_eq!(client.read(0x2024, 0), 0, "it is not a fault");
        assert_eq!(client.listen_ms(700), []);
    }
}

#[test]
fn cut_off_again_while_it_recovers_it_stays_off() {
    let mut client = ImageClient::booted();
    client.obeyed("bus_off on");
    for line in ["bus_off off", "bus_off on"] {
        client.type_line(line);
    }
    client.wait_ms(100);
    assert_eq!(client.status_of("bus"), "bus-off");
}

/// A new kind erases a sector of the memory, while the console takes lines.
#[test]
fn a_line_that_comes_while_the_board_starts_is_answered() {
    for delay in [40, 120, 240] {
        let mut client = ImageClient::booted();
        client.type_line("kind pveo-canopen");
        client.wait_ms(delay);
        assert_eq!(client.status_of("kind"), "pveo-canopen", "after {delay} ms");
    }
}

#[test]
fn another_kind_is_a_new_device_and_back_again() {
    let mut client = ImageClient::booted();
    client.write(0x6053, 0, 4, u32::from_le_bytes(*b"MINE"));
    client.write(0x1010, 1, 4, SAVE);
    client.type_line("kind pvea-isobus");
    client.expect(CLAIM);
    assert_eq!(client.status_of("kind"), "pvea-isobus");
    client.aside.clear();
    client.rig.power_cycle();
    client.expect(CLAIM);
    client.wait_ms(300);
    client.aside.clear();
    client.type_line("kind pveo-canopen");
    loop {
        // It may send another message before it starts anew.
        let frame = client.receive().expect("a boot-up").to_string();
        if frame == "720: 00" {
            break;
        }
        assert!(frame.starts_with("0CFE10"), "{frame}");
    }
    client.expect(NO_ERROR);
    let name = client.sdo([0x40, 0x53, 0x60, 0, 0, 0, 0, 0]);
    assert_eq!(name, [0x41, 0x53, 0x60, 0, 10, 0, 0, 0], "the name of a new device has ten characters");
    assert_eq!(client.sdo([0x60, 0, 0, 0, 0, 0, 0, 0])[1..8], *b"PVEO-CI");
}

#[test]
fn a_new_device_has_nothing_of_the_one_before_and_keeps_what_it_is_told() {
    let mut client = ImageClient::booted();
    client.write(0x1028, 1, 4, 0xA1);
    client.write(0x1010, 1, 4, SAVE);
    client.type_line("kind pveo-canopen");
    client.expect_boot();
    for at in ["first", "second"] {
        assert_eq!(client.read(0x1028, 1), 0x8000_0000, "at its {at} start");
        client.rig.power_cycle();
        client.expect_boot();
    }
    client.write(0x1028, 1, 4, 0xA2);
    client.write(0x1010, 1, 4, SAVE);
    client.rig.power_cycle();
    client.expect_boot();
    assert_eq!(client.read(0x1028, 1), 0xA2);
    assert_eq!(client.status_of("kind"), "pveo-canopen");
}

#[test]
fn a_new_device_can_have_a_serial_number_of_its_own() {
    let mut client = ImageClient::booted();
    client.type_line("kind pvea-isobus 0x107");
    for _ in 0..2 {
        client.expect("18EEFF80: 07 01 20 07 08 FF 02 20");
        client.wait_ms(300);
        client.aside.clear();
        client.rig.power_cycle();
    }
}

#[test]
fn a_blank_one_waits_for_lss() {
    let mut client = ImageClient::booted();
    for _ in 0..2 {
        client.type_line("blank");
        assert_eq!(client.receive_for(Duration::from_millis(500)), None, "no boot-up");
        client.rig.power_cycle();
        assert_eq!(client.receive_for(Duration::from_millis(500)), None, "no boot-up, it stays blank");
    }
    assert_eq!(client.try_sdo([0x40, 0x18, 0x10, 1, 0, 0, 0, 0]), None);
    client.send("7E5: 04 01 00 00 00 00 00 00");
    client.exchange("7E5: 4C 00 00 00 00 00 00 00", "7E4: 50 00 00 00 00 00 00 00");
    client.exchange("7E5: 51 00 00 00 00 80 00 00", "7E4: 4F 00 00 00 00 00 00 00");
    client.exchange("7E5: 11 21 00 00 00 00 00 00", "7E4: 11 00 00 00 00 00 00 00");
    client.exchange("7E5: 17 00 00 00 00 00 00 00", "7E4: 17 00 00 00 00 00 00 00");
    client.exchange("7E5: 04 00 00 00 00 00 00 00", "721: 00");
    client.expect("0A1: 00 00 00 00 00 00 00 00");
    client.rig.power_cycle();
    client.expect("721: 00");
}
