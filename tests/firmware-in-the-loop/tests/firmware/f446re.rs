//! What differs on the NUCLEO-F446RE: one LED, and a processor that stands while its only flash bank is erased.

use firmware_in_the_loop::board::NUCLEO_F446RE;
use firmware_in_the_loop::content;
use firmware_in_the_loop::flash::Operation;
use firmware_in_the_loop::image::Image;
use firmware_in_the_loop::rig::ImageRig;
use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, since};

use super::budgets::{FLASH, KIB};
use super::client::{ImageClient, SAVE, VALVE, download, frame};

/// The typical erase of a sector of 16 KiB by words, and the longest one (DS10693), in milliseconds.
const ERASE_MS: u64 = 250;
const LONGEST_ERASE_MS: u64 = 500;
/// The highest frequency of the oscillator that the watchdog counts by (DS10693).
const FASTEST_LSI_HZ: u64 = 47_000;
/// How many frames a FIFO of the CAN controller holds.
const FIFO: usize = 3;
/// The cycle of the heartbeat in these tests, in milliseconds: one that falls behind by more than a cycle begins anew.
const HEARTBEAT_MS: u64 = 1000;
/// A step of the LED.
const STEP_MS: u64 = 111;

/// The valve with its heartbeat on. To save its parameters once more erases a sector.
pub fn about_to_erase() -> ImageClient {
    let mut client = ImageClient::about_to_erase(&NUCLEO_F446RE);
    client.write(0x1017, 0, 2, HEARTBEAT_MS as u32);
    client.wait_ms(20);
    client.aside.clear();
    client
}

/// Asks it to save, and goes on until a sector is being erased. Returns the erase, in the time of the world.
pub fn begin_erase(client: &mut ImageClient) -> (Instant, Instant) {
    client.rig.send(Frame::full(frame("620: 00").id(), download(0x1010, 1, 4, SAVE)));
    let board = client.rig.board;
    loop {
        let last = client.connections().flash.lock().journal().last().copied();
        if let Some(erase) = last.filter(Operation::is_erase) {
            let at = |nanos| client.rig.boards.instant(board, nanos);
            return (at(erase.from), at(erase.until));
        }
        client.step();
    }
}

/// Lets time pass to an instant; returns the frames that the valve has sent, each with the time of its end.
fn watch_until(client: &mut ImageClient, until: Instant) -> Vec<(u64, String)> {
    let mut frames: Vec<_> = client.aside.drain(..).map(|frame| (0, frame.to_string())).collect();
    while let Some(frame) = client.rig.receive(until) {
        frames.push((client.now_us(), frame.to_string()));
    }
    frames
}

#[test]
fn during_an_erase_nothing_is_sent_and_the_controller_holds_three_frames() {
    let mut client = about_to_erase();
    let (from, until) = begin_erase(&mut client);
    assert_eq!(since(until, from), Duration::from_millis(ERASE_MS));
    let before = client.machine().reached().instructions;
    // Each is acknowledged; of those that find a full FIFO the last one stays.
    for object in [0x1000_u16, 0x1001, 0x1008, 0x1009, 0x1018] {
        let [low, high] = object.to_le_bytes();
        client.send(&format!("620: 40 {low:02X} {high:02X} 00 00 00 00 00"));
    }
    let silent = watch_until(&mut client, Instant::from_micros(until.as_micros() - 1));
    assert_eq!(silent, [], "while the processor stands");
    assert_eq!(client.rig.boards.world.pending(client.rig.master), 0, "all were acknowledged");
    assert_eq!(client.machine().reached().instructions, before, "the processor stands");
    assert_ne!(client.connections().can.lock().can.lost(), [0, 0]);

    // A request takes the place of the one before: the save is not answered.
    let answers = client.listen_ms(20);
    let answers: Vec<String> = answers.iter().map(Frame::to_string).filter(|text| text.starts_with("5A0:")).collect();
    let objects: Vec<&str> = answers.iter().map(|text| &text[8..13]).collect();
    assert_eq!((objects.len(), objects), (FIFO, vec!["00 10", "01 10", "18 10"]));
    assert_eq!(client.status_of("overruns"), "1");
    client.end_without_reset();
}

#[test]
fn an_erase_costs_the_clock_no_time() {
    for slow in [false, true] {
        let mut client = about_to_erase();
        client.connections().flash.lock().set_slow(slow);
        let beat = |client: &mut ImageClient| {
            let until = Instant::from_micros(client.now_us() + HEARTBEAT_MS * 1100);
            let mut frames = watch_until(client, until).into_iter().rev();
            frames.find(|(_, text)| text.starts_with("720:")).expect("there is a heartbeat").0
        };
        let before = beat(&mut client);
        let (_, until) = begin_erase(&mut client);
        client.expect("5A0: 60 10 10 01 00 00 00 00");
        assert!(client.rig.now() > until, "the save is answered when it is done");
        let after = beat(&mut client);
        let cycles = (after - before + HEARTBEAT_MS * 500) / (HEARTBEAT_MS * 1000);
        let late = after.abs_diff(before + cycles * HEARTBEAT_MS * 1000);
        assert!(late < 1000, "after {cycles} cycles the heartbeat is {late} us off (slow: {slow})");
        client.end_without_reset();
    }
}

#[test]
fn the_longest_erase_is_shorter_than_the_watchdog_by_the_fastest_oscillator() {
    let mut client = about_to_erase();
    client.connections().flash.lock().set_slow(true);
    client.connections().oscillators.lock().watchdog = FASTEST_LSI_HZ;
    client.rig.power_cycle();
    client.wait_ms(20);
    client.aside.clear();
    client.write(0x1028, 1, 4, 0xA1);
    let (from, until) = begin_erase(&mut client);
    assert_eq!(since(until, from), Duration::from_millis(LONGEST_ERASE_MS));
    client.wait_ms(LONGEST_ERASE_MS + 100);
    client.rig.power_cycle();
    client.aside.clear();
    client.expect_boot();
    assert_eq!(client.read(0x1028, 1), 0xA1);
    client.end_without_reset();
}

#[test]
fn while_words_are_written_no_frame_is_lost() {
    let mut client = ImageClient::powered(ImageRig::with_memory(
        &NUCLEO_F446RE,
        BitRate::Kbit500,
        &content::stored_after(
            &VALVE,
            &["7E5: 04 01 00 00 00 00 00 00", "7E5: 13 00 02 00 00 00 00 00", "7E5: 17 00 00 00 00 00 00 00"]
                .map(frame),
        ),
    ));
    client.send("000: 01 00");
    client.rig.send(Frame::full(frame("620: 00").id(), download(0x1010, 1, 4, SAVE)));
    let before = client.connections().can.lock().can.came()[0];
    for number in 0..100 {
        client.send(&format!("220: 0F 00 {number:02X} 00"));
    }
    client.wait_ms(40);
    let came = client.connections().can.lock().can.came()[0] - before;
    assert!(came >= 100, "{came} frames");
    let (programs, erases) = client.connections().flash.lock().wear();
    assert!(programs > 20 && erases == 0, "{programs} words, {erases} erases");
    assert_eq!(client.connections().can.lock().can.lost(), [0, 0]);
    assert!(client.aside.contains(&frame("5A0: 60 10 10 01 00 00 00 00")), "{:?}", client.aside);
    client.end_without_reset();
}

#[test]
fn the_power_is_cut_while_a_sector_is_erased() {
    super::power_cut::cuts(&NUCLEO_F446RE, true, 5);
}

#[test]
fn the_button_is_pressed_when_it_is_low() {
    let mut client = ImageClient::booted_on(&NUCLEO_F446RE);
    client.wait_ms(200);
    assert_eq!(client.status_of("supply_mv"), "24000");
    client.press_button();
    assert_eq!(client.status_of("supply_mv"), "8500");
    client.end_without_reset();
}

/// How long the LED is lit and dark in turn within four seconds, in steps.
fn rhythm(client: &mut ImageClient) -> Vec<(bool, u64)> {
    let (port, pin) = NUCLEO_F446RE.leds[0];
    let mut levels: Vec<(bool, u64)> = Vec::new();
    for _ in 0..4000 {
        client.wait_ms(1);
        let high = client.machine().is_high(port, pin);
        match levels.last_mut() {
            Some((level, ms)) if *level == high => *ms += 1,
            _ => levels.push((high, 1)),
        }
    }
    // The first and the last are cut by the time of watching.
    let whole = levels.len().saturating_sub(1);
    let whole = levels.get(1..whole).unwrap_or_default();
    whole.iter().map(|(level, ms)| (*level, (ms + STEP_MS / 2) / STEP_MS)).collect()
}

/// Whether a rhythm consists of this, over and over.
fn repeats(rhythm: &[(bool, u64)], period: &[(bool, u64)]) -> bool {
    let turns = |start: usize| rhythm.iter().eq(period.iter().cycle().skip(start).take(rhythm.len()));
    rhythm.len() > period.len() && (0..period.len()).any(turns)
}

#[test]
fn one_led_shows_the_colours_by_its_rhythm() {
    let mut client = ImageClient::booted_on(&NUCLEO_F446RE);
    let mut shows = |line: &str, period: &[(bool, u64)], what: &str| {
        if !line.is_empty() {
            client.obeyed(line);
        }
        client.wait_ms(1000);
        let seen = rhythm(&mut client);
        assert!(repeats(&seen, period), "{what}: {seen:?}");
    };
    shows("", &[(true, 1), (false, 17)], "yellow: INIT");
    shows("temperature_c 130", &[(true, 1), (false, 1), (true, 1), (false, 6)], "red flashing: temperature");
    shows("internal_fault on", &[(true, 1), (false, 1)], "red: internal error");
    shows("kind pvea-isobus", &[(true, 3), (false, 3)], "green flashing: power save");
}

#[test]
fn the_image_is_as_small_as_the_other_boards() {
    let total = Image::of(&NUCLEO_F446RE).symbols().total();
    assert!((16 * KIB..=FLASH).contains(&total.flash), "{} bytes of flash", total.flash);
}
