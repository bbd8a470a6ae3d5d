//! What the emulator would let pass and silicon does not: how the processor is set up, and what it does at the edges of
//! the manual and of the errata sheet.

use firmware_in_the_loop::board::{NUCLEO_F429ZI, NUCLEO_F446RE};
use firmware_in_the_loop::broken::Break;
use firmware_in_the_loop::image::Image;
use firmware_in_the_loop::rig::ImageRig;
use protocol_core::controller::BitRate;
use protocol_core::frame::{Frame, standard};

use super::client::{ImageClient, SAVE, VALVE, download, frame};

/// Registers (RM0090, PM0214).
const RCC_CR: u64 = 0x4002_3800;
const RCC_CFGR: u64 = 0x4002_3808;
const FLASH_ACR: u64 = 0x4002_3C00;
const PWR_CR: u64 = 0x4000_7000;
const DBGMCU_APB1_FZ: u64 = 0xE004_2008;
const GPIOA: u64 = 0x4002_0000;
const GPIOB: u64 = 0x4002_0400;
const GPIOC: u64 = 0x4002_0800;
const GPIOD: u64 = 0x4002_0C00;
const GPIO_MODER: u64 = 0x00;
const GPIO_OTYPER: u64 = 0x04;
const GPIO_OSPEEDR: u64 = 0x08;
const GPIO_PUPDR: u64 = 0x0C;
const GPIO_ODR: u64 = 0x14;
const GPIO_AFRL: u64 = 0x20;
const NVIC_IPR: u64 = 0xE000_E400;
const VTOR: u64 = 0xE000_ED08;

/// The vectors of the bootloader in ROM.
const ROM: u32 = 0x1FFF_0000;

/// Interrupts (RM0090 table 63, RM0390 table 38), those of a line with one priority, the most urgent first.
const PRIORITIES: [&[(&str, u64)]; 4] = [
    &[("CAN1_TX", 19), ("CAN1_RX0", 20), ("CAN1_RX1", 21), ("CAN1_SCE", 22)],
    &[("TIM5: the clock", 50)],
    &[("UART5: the device's task", 53)],
    &[("UART4: console, LEDs, button", 52), ("FLASH", 4)],
];
/// The console: its UART, whose interrupt is above the console's task, and its DMA streams.
const CONSOLE_F429: Console = Console { uart: 39, streams: [12, 14] };
const CONSOLE_F446: Console = Console { uart: 38, streams: [16, 17] };

struct Console {
    uart: u64,
    streams: [u64; 2],
}

/// Where flags, read and write index of the log's channel lie in the control block of RTT.
const RTT_SIZE: u64 = 32;
const RTT_WRITE: u64 = 36;
const RTT_READ: u64 = 40;
const RTT_FLAGS: u64 = 44;
const ACCELERATOR: &str = "prefetch, instruction cache, data cache";

/// Whoever logs waits for room.
const BLOCK_IF_FULL: u32 = 2;

fn word(client: &ImageClient, address: u64) -> u32 {
    let bytes = client.machine().read(address..address + 4);
    u32::from_le_bytes(bytes.try_into().expect("four bytes"))
}

#[test]
fn the_clock_comes_from_the_st_link_and_the_flash_is_as_fast_as_it_can_be() {
    for board in [&NUCLEO_F429ZI, &NUCLEO_F446RE] {
        println!("{}", board.name);
        let client = ImageClient::booted_on(board);
        let register = |address| client.machine().register(address);
        assert_eq!(register(RCC_CR) >> 16 & 0b111, 0b111, "HSE is on, ready, and bypassed: no crystal is fitted");
        assert_eq!(register(RCC_CFGR) >> 2 & 0b11, 0b10, "the PLL is the system clock");
        assert_eq!(register(RCC_CFGR) >> 10 & 0b111, 0b101, "APB1 is a quarter of it");
        assert_eq!(register(FLASH_ACR) >> 8 & 0b111, 0b111, "{ACCELERATOR}");
        assert_eq!(register(FLASH_ACR) & 0xF, 5, "wait states at 160 MHz (RM0090 table 11, RM0390 table 5)");
        assert_eq!(register(DBGMCU_APB1_FZ) >> 12 & 1, 1, "the watchdog stands while a debugger halts the core");
    }
}

#[test]
fn what_was_written_leaves_the_flash_as_fast_as_it_was() {
    let mut client = ImageClient::about_to_erase(&NUCLEO_F429ZI);
    let instructions = |client: &ImageClient| client.machine().reached().instructions;
    let before = instructions(&client);
    client.write(0x1010, 1, 4, SAVE);
    let took = instructions(&client) - before;
    let journal = client.connections().flash.lock().journal().to_vec();
    let erases: Vec<_> = journal.iter().filter(|operation| operation.is_erase()).collect();
    let &[erase] = &erases[..] else { panic!("a sector is erased, not {}", erases.len()) };
    assert_eq!(erase.until - erase.from, 250_000_000, "by words (DS9405)");
    assert!(took < 20_000_000, "{took} instructions: the processor sleeps meanwhile");
    assert_eq!(client.machine().register(FLASH_ACR) >> 8 & 0b111, 0b111, "{ACCELERATOR}");
    client.end_without_reset();
}

#[test]
fn the_button_is_at_rest_without_the_boards_resistor() {
    for (board, pull) in [(&NUCLEO_F429ZI, 0b10), (&NUCLEO_F446RE, 0b01)] {
        let client = ImageClient::booted_on(board);
        let pulled = client.machine().register(GPIOC + GPIO_PUPDR) >> 26 & 0b11;
        assert_eq!(pulled, pull, "{}: PC13 is pulled to the level that it has while nobody presses", board.name);
    }
}

#[test]
fn the_console_is_quiet_without_an_st_link() {
    for (board, port, rx) in [(&NUCLEO_F429ZI, GPIOD, 9), (&NUCLEO_F446RE, GPIOA, 3)] {
        let client = ImageClient::booted_on(board);
        let two_bits = |register: u64| client.machine().register(port + register) >> (2 * rx) & 0b11;
        assert_eq!(two_bits(GPIO_MODER), 0b10, "{}: the pin is that of a peripheral", board.name);
        assert_eq!(two_bits(GPIO_PUPDR), 0b01, "{}: a pull-up", board.name);
    }
}

/// The bus is modelled from the registers of CAN1 on: nothing else would miss the pins.
#[test]
fn can1_is_at_the_pins_of_the_transceiver() {
    for (board, port, rx, tx) in [(&NUCLEO_F429ZI, GPIOD, 0, 1), (&NUCLEO_F446RE, GPIOB, 8, 9)] {
        println!("{}", board.name);
        let client = ImageClient::booted_on(board);
        let two_bits = |register: u64, pin: u64| client.machine().register(port + register) >> (2 * pin) & 0b11;
        for pin in [rx, tx] {
            assert_eq!(two_bits(GPIO_MODER, pin), 0b10, "pin {pin} is that of a peripheral");
            let functions = client.machine().register(port + GPIO_AFRL + pin / 8 * 4);
            assert_eq!(
                functions >> (pin % 8 * 4) & 0xF,
                9,
                "pin {pin} has the function CAN1 (DS9405 table 12, DS10693 table 11)"
            );
        }
        assert_eq!(two_bits(GPIO_PUPDR, rx), 0b01, "without a transceiver the bus reads recessive");
        assert_eq!(two_bits(GPIO_OSPEEDR, tx), 0b01, "medium speed: edges of 10 ns, fast enough for 1 Mbit/s");
        assert_eq!(client.machine().register(port + GPIO_OTYPER) >> tx & 1, 0, "push-pull");
    }
}

#[test]
fn interrupts_have_the_priorities_of_the_table() {
    for (board, console) in [(&NUCLEO_F429ZI, CONSOLE_F429), (&NUCLEO_F446RE, CONSOLE_F446)] {
        println!("{}", board.name);
        let mut client = ImageClient::booted_on(board);
        let core = client.connections().core.clone();
        (0..16).for_each(|word| core.watch(NVIC_IPR + 4 * word));
        client.wait_ms(10);
        let priority = |line: u64| core.get(NVIC_IPR + (line & !3)).expect("it is watched") >> (8 * (line & 3)) & 0xFF;
        let mut above = 0;
        for lines in PRIORITIES {
            let (_, first) = lines[0];
            for (name, line) in lines {
                assert_eq!(priority(*line), priority(first), "{name}");
            }
            assert!(priority(first) > above, "{lines:?}: {} is not below {above}", priority(first));
            above = priority(first);
        }
        for stream in console.streams {
            assert_eq!(priority(stream), above, "DMA for the console");
        }
        let [.., (_, device)] = PRIORITIES[2] else { panic!("the device's task is missing") };
        assert!((priority(*device) + 1..above).contains(&priority(console.uart)), "the console's UART");
    }
}

#[test]
fn the_pin_that_disturbs_early_silicon_is_held() {
    let client = ImageClient::booted();
    let register = |address| client.machine().register(address);
    let is = "early silicon reads bank 2 wrongly unless PA12 is (ES0206)";
    assert_eq!(register(GPIOA + GPIO_MODER) >> 24 & 0b11, 0b01, "{is} an output");
    assert_eq!(register(GPIOA + GPIO_OTYPER) >> 12 & 1, 0, "{is} push-pull");
    assert_eq!(register(GPIOA + GPIO_ODR) >> 12 & 1, 0, "{is} low");
    assert_eq!(register(GPIOA + GPIO_PUPDR) >> 24 & 0b11, 0b10, "the flash driver wants it pulled down");
}

#[test]
fn a_start_through_a_bootloader_uses_the_vectors_of_the_image() {
    for board in [&NUCLEO_F429ZI, &NUCLEO_F446RE] {
        let mut rig = ImageRig::with_device(board, BitRate::Kbit250, &VALVE);
        rig.power_cycle();
        let core = rig.boards.connections(rig.board).core.clone();
        core.watch(VTOR);
        core.write(VTOR, ROM);
        let mut client = ImageClient { rig, aside: Default::default() };
        client.expect("720: 00");
        assert_eq!(core.get(VTOR), Some(board.flash.start as u32), "{}", board.name);
        client.end_without_reset();
    }
}

#[test]
fn nothing_is_written_while_the_supply_is_too_low() {
    let mut client = ImageClient::booted();
    assert_eq!(client.machine().register(PWR_CR) >> 4 & 0b1111, 0b1101, "the detector is on, at 2.93 V");
    let operations = |client: &ImageClient| client.connections().flash.lock().journal().len();
    client.write(0x1028, 1, 4, 0xA1);
    let before = operations(&client);
    client.machine().supply(2850);
    assert_eq!(client.sdo(download(0x1010, 1, 4, SAVE))[0], 0x80, "an abort");
    assert_eq!(operations(&client), before);
    client.machine().supply(3300);
    client.write(0x1010, 1, 4, SAVE);
    client.rig.power_cycle();
    while client.receive() != Some(frame("720: 00")) {}
    client.aside.clear();
    assert_eq!(client.read(0x1028, 1), 0xA1);
    client.end_without_reset();
}

#[test]
fn errors_that_go_on_do_not_interrupt_again() {
    let mut client = ImageClient::booted();
    let interrupts = |client: &ImageClient| client.connections().can.lock().can.error_interrupts();
    let before = interrupts(&client);
    let master = client.rig.master;
    // Alone on the bus: the answer is tried again and again.
    client.rig.send(Frame::full(standard(0x620).into(), [0x40, 0x18, 0x10, 1, 0, 0, 0, 0]));
    client.finish_sending();
    client.rig.boards.world.remove_client_port(master);
    client.wait_ms(1000);
    assert_eq!(client.status_of("bus"), "error-passive");
    assert_eq!(interrupts(&client) - before, 1);
    assert_eq!(client.status_of("error_interrupts"), "1");
    client.rig.master = client.rig.boards.world.add_client_port("another master");
    client.wait_ms(100);
    client.aside.clear();
    // Error-active again, and it would be told of the next time.
    for _ in 0..20 {
        client.read(0x1018, 1);
    }
    assert_eq!(client.status_of("bus"), "error-active");
    client.rig.boards.world.inject(hal_sim::bus::DestroyNext::frames_of("board", 3));
    client.read(0x1018, 1);
    assert_eq!(client.status_of("error_interrupts"), "2");
    client.end_without_reset();
}

#[test]
fn a_log_that_nobody_reads_keeps_nobody_waiting() {
    let mut client = ImageClient::booted();
    let control = Image::of(&NUCLEO_F429ZI).symbols().address("_SEGGER_RTT").expect("there is a log");
    // As a debugger leaves it that has detached: the buffer is full, and who logs is to wait.
    client.machine().write(control + RTT_FLAGS, &BLOCK_IF_FULL.to_le_bytes());
    let next = (word(&client, control + RTT_WRITE) + 1) % word(&client, control + RTT_SIZE);
    client.machine().write(control + RTT_READ, &next.to_le_bytes());
    super::resets::break_and_wait(&mut client, Break::Panic, super::resets::AT_ONCE);
    client.expect("720: 00");
}
