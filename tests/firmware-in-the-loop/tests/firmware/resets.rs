//! What goes wrong in the image ends in a reset, and the next start raises the internal error (SPEC 2).

use firmware_in_the_loop::board::{NUCLEO_F429ZI, NUCLEO_F446RE};
use firmware_in_the_loop::broken::Break;
use firmware_in_the_loop::image::Image;
use firmware_in_the_loop::part::Connections;
use firmware_in_the_loop::rig::ImageRig;
use protocol_core::controller::BitRate;
use protocol_core::time::{Duration, after};

use super::client::{ImageClient, SAVE, VALVE, frame};

/// What the device's task calls for an SDO request, and nobody else: each after what it is inlined into, should it be.
pub const HANDLES_SDO: [&str; 4] = [
    "SdoServer<D>::handle",
    "Node<P>>::serve_sdo",
    "canopen::node::Node<P>::answer_sdo",
    "CanopenValve as protocol_core::device::runtime::Application>::handle",
];
/// The watchdog's time, with some room.
const WATCHDOG: Duration = Duration::from_millis(2500);
/// A panic resets by itself: long before the watchdog does.
pub const AT_ONCE: Duration = Duration::from_millis(20);

/// What writes a record, and nobody but the memory's task calls.
const STORES: [&str; 1] = ["nvm::store::Records<F>::write"];
/// What the memory's task calls as the board starts, and whenever it looks for what is stored.
const SCANS: [&str; 1] = ["nvm::log::Log<F>::scan"];
/// The log's output, called when the log is taken.
const WRITES_LOG: [&str; 1] = ["defmt_rtt::channel::Channel::write_all"];
/// What the handler runs that polls the device's task.
const POLLS_DEVICE: [&str; 1] = ["UART5"];
/// The longest that the memory may take, and the watchdog's time.
const HANGING_MEMORY: std::ops::Range<u64> = 3_000_000..4_500_000;

const NO_ERROR: &str = "0A0: 00 00 00 00 00 00 00 00";

/// The device's task is broken as it handles an SDO request: waits for the reset, at most so long, and mends it.
pub fn break_and_wait(client: &mut ImageClient, how: Break, patience: Duration) -> Duration {
    break_there_and_wait(client, how, &HANDLES_SDO, "620: 40 18 10 01 00 00 00 00", patience)
}

/// One of these functions is broken, and a frame is sent: waits for the reset, at most so long, and mends it.
fn break_there_and_wait(
    client: &mut ImageClient,
    how: Break,
    names: &[&str],
    text: &str,
    patience: Duration,
) -> Duration {
    let mended = how.apply(client.machine(), names);
    client.send(text);
    let took = wait_for_reset(client, patience);
    mended.mend(client.machine());
    took
}

/// Waits for a reset, at most so long, while frames for the device go on coming.
fn wait_for_reset(client: &mut ImageClient, patience: Duration) -> Duration {
    let before = client.machine().reached().resets;
    let start = client.rig.now();
    while client.machine().reached().resets == before {
        assert!(client.rig.now() < after(start, patience), "no reset within {patience}");
        if client.rig.boards.world.pending(client.rig.master) == 0 {
            client.send("080:");
        }
        client.step();
    }
    Duration::from_micros(client.now_us() - start.as_micros())
}

/// Boot-up, and then the internal error, for the `count`th time; it is gone as soon as it was told.
fn expect_internal_error(client: &mut ImageClient, count: u8) {
    client.expect_boot();
    client.expect(&format!("0A0: 00 10 01 {count:02X} 00 00 00 00"));
    client.expect(NO_ERROR);
    assert_eq!(client.read(0x1003, 1), 0x1000 | u32::from(count) << 16, "the history");
    assert_eq!(client.read(0x2024, 0), u32::from(count), "the counter");
    assert_eq!(client.read(0x1001, 0), 0);
}

/// A device's task that is broken so resets the processor by this cause, on each board; twice, and the valve works
/// after each.
fn resets_by(how: Break, patience: Duration, cause: &str) {
    for board in [&NUCLEO_F429ZI, &NUCLEO_F446RE] {
        let mut client = ImageClient::booted_on(board);
        client.wait_ms(200);
        for count in 1..=2 {
            let took = break_and_wait(&mut client, how, patience);
            println!("{}, {how:?}: reset after {took}", board.name);
            expect_internal_error(&mut client, count);
            assert_eq!(client.read(0x1018, 1), 0x0100_0019, "it works");
            // Meanwhile the counter is stored.
            client.wait_ms(11_000);
            assert_eq!(client.listen_ms(1), []);
        }
        let resets = client.resets();
        assert!(resets.len() == 2 && resets.iter().all(|reset| reset.cause.contains(cause)), "{resets:?}");
        client.rig.power_cycle();
        client.expect_boot();
        assert_eq!(client.listen_ms(100), [], "power that comes is no internal error");
        assert_eq!(client.read(0x2024, 0), 2, "but its counter was kept");
    }
}

#[test]
fn a_device_task_that_hangs_is_ended_by_the_watchdog() {
    resets_by(Break::Hang, WATCHDOG, "IWDG");
}

#[test]
fn a_panic_resets_at_once() {
    resets_by(Break::Panic, AT_ONCE, "Core");
}

#[test]
fn a_fault_of_the_processor_resets() {
    let mut client = ImageClient::booted();
    break_and_wait(&mut client, Break::Fault, WATCHDOG);
    expect_internal_error(&mut client, 1);
}

/// The log is taken, and cannot be taken once more.
#[test]
fn a_fault_inside_a_call_of_the_log_resets_at_once() {
    let mut client = ImageClient::booted();
    let log = Break::Fault.apply(client.machine(), &WRITES_LOG);
    break_and_wait(&mut client, Break::Panic, AT_ONCE);
    log.mend(client.machine());
    expect_internal_error(&mut client, 1);
    let resets = client.resets();
    assert!(resets.iter().all(|reset| reset.cause.contains("Core")), "{resets:?}");
}

/// A board that is switched on and waits for something in vain is reset by the watchdog, and starts when that is there.
fn starts_after_a_wait(mend: impl Fn(&Connections), damage: impl Fn(&Connections)) {
    for board in [&NUCLEO_F429ZI, &NUCLEO_F446RE] {
        let rig = ImageRig::with_device(board, BitRate::Kbit250, &VALVE);
        let mut client = ImageClient { rig, aside: Default::default() };
        damage(client.connections());
        client.rig.power_cycle();
        while client.machine().reached().resets == 0 {
            assert!(client.now_us() < WATCHDOG.as_micros(), "{}: no reset", board.name);
            client.step();
        }
        mend(client.connections());
        while client.receive() != Some(frame("0A0: 00 10 01 01 00 00 00 00")) {}
        assert_eq!(client.read(0x1018, 1), 0x0100_0019);
        let resets = client.resets();
        assert!(resets.iter().all(|reset| reset.cause.contains("IWDG")), "{resets:?}");
    }
}

#[test]
fn a_start_without_the_st_links_clock_is_tried_again() {
    let clock = |rate| move |wires: &Connections| wires.oscillators.lock().external = rate;
    starts_after_a_wait(clock(Some(8_000_000)), clock(None));
}

#[test]
fn a_start_on_a_bus_that_is_held_dominant_is_tried_again() {
    let hold = |held| move |wires: &Connections| wires.can.lock().can.hold_dominant(held);
    starts_after_a_wait(hold(false), hold(true));
}

#[test]
fn a_reset_in_the_middle_of_an_erase_loses_nothing() {
    let mut client = ImageClient::about_to_erase(&NUCLEO_F429ZI);
    client.write(0x1028, 1, 4, 0xA1);
    client.send("620: 23 10 10 01 73 61 76 65");
    while client.connections().flash.lock().journal().last().is_none_or(|last| !last.is_erase()) {
        client.step();
    }
    break_and_wait(&mut client, Break::Panic, AT_ONCE);
    expect_internal_error(&mut client, 1);
    let kept = client.read(0x1028, 1);
    assert!(kept == 0xA1 || kept == 0x8000_0000, "{kept:#x}");
    client.write(0x1028, 1, 4, 0xA2);
    client.write(0x1010, 1, 4, SAVE);
    client.rig.power_cycle();
    client.expect_boot();
    assert_eq!(client.read(0x1028, 1), 0xA2);
}

#[test]
fn a_memory_that_hangs_is_ended_by_the_watchdog() {
    let mut client = ImageClient::booted();
    client.wait_ms(200);
    let patience = Duration::from_micros(HANGING_MEMORY.end);
    let took = break_there_and_wait(&mut client, Break::Hang, &STORES, "620: 23 10 10 01 73 61 76 65", patience);
    assert!(HANGING_MEMORY.contains(&took.as_micros()), "{took}");
    expect_internal_error(&mut client, 1);
    client.write(0x1010, 1, 4, SAVE);
    let resets = client.resets();
    assert!(resets.len() == 1 && resets[0].cause.contains("IWDG"), "{resets:?}");
}

#[test]
fn a_memory_that_hangs_is_given_no_more_time_by_another_request() {
    let mut client = ImageClient::booted();
    client.wait_ms(200);
    let hanging = Break::Hang.apply(client.machine(), &STORES);
    client.send("620: 23 10 10 01 73 61 76 65");
    client.wait_ms(2000);
    client.type_line("blank");
    let took = wait_for_reset(&mut client, Duration::from_micros(HANGING_MEMORY.end - 2_000_000));
    assert!(took.as_micros() + 2_000_000 >= HANGING_MEMORY.start, "{took}");
    hanging.mend(client.machine());
    expect_internal_error(&mut client, 1);
}

#[test]
fn an_erase_that_never_ends_is_ended_by_the_watchdog() {
    let mut client = ImageClient::about_to_erase(&NUCLEO_F429ZI);
    client.wait_ms(200);
    client.connections().flash.lock().set_stuck(true);
    client.send("620: 23 10 10 01 73 61 76 65");
    let took = wait_for_reset(&mut client, Duration::from_micros(HANGING_MEMORY.end));
    assert!(HANGING_MEMORY.contains(&took.as_micros()), "{took}");
    client.connections().flash.lock().set_stuck(false);
    expect_internal_error(&mut client, 1);
    client.write(0x1010, 1, 4, SAVE);
}

#[test]
fn a_memory_that_hangs_at_the_start_is_ended_by_the_watchdog() {
    let mut client = ImageClient::booted();
    client.wait_ms(200);
    let hanging = Break::Hang.apply(client.machine(), &SCANS);
    client.type_line("power-cycle");
    wait_for_reset(&mut client, AT_ONCE);
    let took = wait_for_reset(&mut client, Duration::from_micros(HANGING_MEMORY.end));
    assert!(HANGING_MEMORY.contains(&took.as_micros()), "{took}");
    hanging.mend(client.machine());
    expect_internal_error(&mut client, 1);
    let resets = client.resets();
    assert!(resets.last().is_some_and(|last| last.cause.contains("IWDG")), "{resets:?}");
}

/// Two erases that take the longest time are longer than the watchdog's.
#[test]
fn a_start_that_erases_all_is_not_ended_by_the_watchdog() {
    let noise: Vec<u8> = (0..32 * 1024).map(|place| (place * 31 % 251) as u8).collect();
    let rig = ImageRig::with_memory(&NUCLEO_F429ZI, BitRate::Kbit250, &noise);
    let mut client = ImageClient { rig, aside: Default::default() };
    client.connections().flash.lock().set_slow(true);
    client.rig.power_cycle();
    let booted = client.receive_for(Duration::from_secs(4)).map(|frame| frame.to_string());
    assert_eq!(booted.as_deref(), Some("720: 00"));
    let erases = client.connections().flash.lock().wear().1;
    assert!(erases >= 2 && client.now_us() > 1_000_000, "{erases} erases, {} us", client.now_us());
    // That all was lost is told, once: the next start finds a memory.
    client.expect(NO_ERROR);
    client.expect("0A0: 00 10 01 01 00 00 00 00");
    client.wait_ms(1000);
    client.rig.power_cycle();
    client.aside.clear();
    client.expect_boot();
    assert_eq!(client.listen_ms(200), []);
    assert_eq!(client.read(0x2024, 0), 1);
    client.end_without_reset();
}

#[test]
fn a_device_task_that_is_not_woken_is_ended_by_the_watchdog_though_all_others_run() {
    let mut client = ImageClient::booted();
    break_there_and_wait(&mut client, Break::Return, &POLLS_DEVICE, "080:", WATCHDOG);
    expect_internal_error(&mut client, 1);
}

#[test]
fn a_reset_that_was_wanted_is_none_of_the_watchdogs_before_it() {
    for how in [Break::Hang, Break::Panic] {
        let mut client = ImageClient::booted();
        break_and_wait(&mut client, how, WATCHDOG);
        expect_internal_error(&mut client, 1);
        client.wait_ms(200);
        client.obeyed("power-cycle");
        client.expect_boot();
        assert_eq!(client.listen_ms(200), [], "{how:?}");
    }
}

#[test]
fn power_that_comes_with_the_mark_of_a_panic_in_the_noise_is_no_internal_error() {
    let mut client = ImageClient::booted();
    let marker = Image::of(&NUCLEO_F429ZI).symbols().address("firmware::board::reset::MARKER").expect("a marker");
    let board = client.rig.board;
    client.rig.boards.power(board, false);
    client.rig.boards.power(board, true);
    client.machine().write(marker, b"INAP");
    client.expect_boot();
    assert_eq!(client.listen_ms(200), []);
    client.end_without_reset();
}
