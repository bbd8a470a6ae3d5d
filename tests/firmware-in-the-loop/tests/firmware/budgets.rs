//! What the image takes of the processor: flash, RAM, stack, and instructions for a frame. Counted, not timed; printed
//! for who reads the log of a run.

use std::io::Write as _;

use firmware_in_the_loop::board::NUCLEO_F429ZI;
use firmware_in_the_loop::content;
use firmware_in_the_loop::image::Image;
use firmware_in_the_loop::rig::{BoardTarget, ImageRig};
use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;

use super::client::{ImageClient, SAVE, VALVE, download, frame};
use super::use_cases;

pub const KIB: u64 = 1024;
/// The image with all kinds, in flash.
pub const FLASH: u64 = 112 * KIB;
/// Variables and stack.
const RAM: u64 = 15 * KIB;
/// Instructions from the receive interrupt to sleep, for a frame that comes through the filters and is for nobody.
const FOR_NOBODY: u64 = 490;
/// The same for an SDO upload: the answer lies in a mailbox then.
const UPLOAD: u64 = 1410;
/// The same for the position of a shaft that turns, which is reckoned in 64 bits: by SDO, or by a TPDO that answers a
/// SYNC.
const POSITION: u64 = 1450;
/// The same for an RPDO that a TPDO answers.
const SET_POINT: u64 = 1560;
/// After so many steps a processor that is still awake will never sleep.
const STEPS: usize = 1000;
/// The most instructions for a frame that a service of the device takes, and that changes nothing.
const IN_VAIN: u64 = 1010;

/// Prints past the test's capture: whoever runs all tests is to see the figures.
pub fn print(line: &str) {
    // A log that cannot be written to is no failure of the image.
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}

/// Rounded, as docs/board.md has it.
pub fn kib(bytes: u64) -> String {
    let tenths = (bytes * 10 + KIB / 2) / KIB;
    format!("{}.{} KiB", tenths / 10, tenths % 10)
}

#[test]
fn flash_by_crate() {
    let symbols = Image::of(&NUCLEO_F429ZI).symbols();
    let mut table = format!("{:<28} {:>8} {:>8}\n", "crate", "flash", "RAM");
    for (name, size) in symbols.by_crate() {
        table += &format!("{name:<28} {:>8} {:>8}\n", size.flash, size.ram);
    }
    let total = symbols.total();
    let sum = symbols.by_crate().iter().map(|(_, size)| size.flash).sum::<u64>();
    print(&format!(
        "\n{table}{:<28} {:>8} {:>8}\nflash: {} of {}",
        "all",
        total.flash,
        total.ram,
        kib(total.flash),
        kib(FLASH)
    ));
    assert_eq!(sum, total.flash, "the table is not complete");
    // One without code or variables has lost its linker script.
    assert!((16 * KIB..=FLASH).contains(&total.flash), "{} bytes of flash", total.flash);
}

#[test]
fn ram_with_the_stack_at_its_deepest() {
    let symbols = Image::of(&NUCLEO_F429ZI).symbols();
    let saved = content::stored_after(&VALVE, &[frame("620: 23 10 10 01 73 61 76 65")]);
    let mut deepest = 0;
    // A new memory, one that stores with an erase, and one that makes no sense: the ways through the record store.
    let noise: Vec<u8> = (0..32 * KIB).map(|place| (place * 31 % 251) as u8).collect();
    for (name, content) in [("new", vec![0xFF; 32 * 1024]), ("worn", content::worn(&saved)), ("damaged", noise)] {
        let rig = ImageRig::with_memory(&NUCLEO_F429ZI, BitRate::Kbit250, &content);
        let mut client = ImageClient { rig, aside: Default::default() };
        client.rig.boards.watch_stack(client.rig.board);
        client.rig.power_cycle();
        heavy_mix(&mut client);
        deepest = deepest.max(print_stack(client.rig.boards.stack(client.rig.board), &format!("with a {name} memory")));
    }
    for name in use_cases::ALL {
        let scenario = use_cases::use_case(name);
        let mut rig = BoardTarget::new(&NUCLEO_F429ZI, &scenario);
        rig.watch_stack();
        rig.power_up();
        // Whether the valve does what it has to is for the use cases' own tests.
        let _ = scenario.play(&mut rig);
        deepest = deepest.max(print_stack(rig.stack(), &format!("in use case {name}")));
    }
    let ram = symbols.total().ram + deepest;
    print(&format!("RAM: {} variables, {} stack, together {} of {}", symbols.total().ram, deepest, kib(ram), kib(RAM)));
    assert!(ram <= RAM, "{ram} bytes of RAM");
}

fn print_stack(used: u64, when: &str) -> u64 {
    print(&format!("stack {when}: {used} bytes"));
    used
}

/// Everything at once: services, faults, console, storing.
fn heavy_mix(client: &mut ImageClient) {
    client.wait_ms(50);
    client.send("000: 01 00");
    for round in 0..30_u32 {
        let id = 0xA1 + round % 3;
        for text in ["620: 40 08 10 00 00 00 00 00", "620: 40 0A 10 00 00 00 00 00", "620: 60 00 00 00 00 00 00 00"] {
            client.send(text);
        }
        client.send(&format!("620: 23 28 10 01 {id:02X} 00 00 00"));
        for text in
            ["220: 0F 00 00 20", "080:", "1BC78820: 03 22 F1 8C", "7E5: 5A 00 00 00 00 00 00 00", "220: 0F 00 00 40"]
        {
            client.send(text);
        }
        let words =
            ["internal_fault on", "status", "internal_fault off", "nonsense", "supply_mv 8500", "supply_mv 24000"];
        client.rig.boards.type_line(client.rig.board, words[round as usize % words.len()]);
        if round % 10 == 5 {
            client.rig.send(Frame::full(frame("620: 00").id(), download(0x1010, 1, 4, SAVE)));
        }
        client.wait_ms(20);
    }
    client.press_button();
    client.send("000: 82 00");
    client.wait_ms(700);
}

/// How many instructions the processor executes for a frame, from its interrupt to sleep.
fn instructions(client: &mut ImageClient, text: &str) -> u64 {
    client.wait_ms(7);
    client.aside.clear();
    // What the device does by itself now and then is not the frame's: the least of some is without it.
    let counts = (0..9).map(|_| {
        client.send(text);
        while client.rig.boards.world.pending(client.rig.master) > 0 {
            client.step();
        }
        let before = client.machine().reached().instructions;
        let asleep = (0..STEPS).find_map(|_| {
            client.step();
            client.machine().reached().asleep
        });
        let asleep = asleep.expect("it goes to sleep");
        client.wait_ms(3);
        asleep - before
    });
    let counts: Vec<u64> = counts.collect();
    let least = *counts.iter().min().expect("there are some");
    print(&format!(
        "{text:<36} {least:>6} instructions (at the most {})",
        counts.iter().max().expect("there are some")
    ));
    least
}

fn operational() -> ImageClient {
    let mut client = ImageClient::booted();
    client.send("000: 01 00");
    for status in ["09", "0B", "0F"] {
        client.send("220: 0F 00 00 20");
        client.expect(&format!("1A0: {status} 00 00 00"));
    }
    client
}

#[test]
fn a_frame_for_nobody_costs_little() {
    // Not active: a valve that nobody commands would tell of its time guard meanwhile.
    let mut client = ImageClient::booted();
    client.send("000: 01 00");
    let mut measure = |text, limit, why| {
        let count = instructions(&mut client, text);
        assert!(count <= limit, "{why}: {count} instructions");
        assert_eq!(client.aside, [], "{why}");
    };
    measure("000: 01 21", FOR_NOBODY, "NMT for another node");
    for (text, why) in [
        ("080:", "a SYNC that no PDO waits for"),
        ("220: 0F", "an RPDO that is too short"),
        ("620: 40 18 10 01", "an SDO request that is too short"),
        ("7E5: 04 01 00 00 00 00 00 00", "LSS while operational"),
    ] {
        measure(text, IN_VAIN, why);
    }
}

#[test]
fn an_answer_costs_no_more_than_it_may() {
    let mut client = operational();
    for (text, answer, limit, why) in [
        ("620: 40 18 10 01 00 00 00 00", "5A0: 43 18 10 01 19 00 00 01", UPLOAD, "an SDO upload"),
        ("620: 40 41 60 00 00 00 00 00", "5A0: 4B 41 60 00 0F 00 00 00", UPLOAD, "an SDO upload of the status word"),
        ("220: 0F 00 00 20", "1A0: 0F", SET_POINT, "an RPDO and its TPDO"),
    ] {
        answered(&mut client, text, answer, limit, why);
    }
}

#[test]
fn an_answer_of_an_angle_sensor_costs_no_more_than_it_may() {
    let mut client = ImageClient::sensor();
    client.write(0x1800, 2, 1, 1);
    client.write(0x1800, 1, 4, 0x1A0);
    client.send("000: 01 20");
    client.obeyed("speed_rpm 100");
    for (text, answer, limit, why) in [
        ("000: 01 21", "", FOR_NOBODY, "NMT for another node"),
        ("620: 40 18 10 01 00 00 00 00", "5A0: 43 18 10 01 DA 00 00 00", UPLOAD, "an SDO upload"),
        ("620: 40 04 60 00 00 00 00 00", "5A0: 43 04 60 00", POSITION, "an SDO upload of the position"),
        ("080:", "1A0:", POSITION, "a SYNC and its TPDO"),
    ] {
        answered(&mut client, text, answer, limit, why);
    }
}

/// The answer to a frame costs no more than the limit; without an answer there is none.
fn answered(client: &mut ImageClient, text: &str, answer: &str, limit: u64, why: &str) {
    let count = instructions(client, text);
    assert!(count <= limit, "{why}: {count} instructions");
    assert!(client.aside.iter().all(|frame| frame.to_string().starts_with(answer)), "{why}: {:?}", client.aside);
    assert_eq!(client.aside.len(), if answer.is_empty() { 0 } else { 9 }, "{why}");
}
