//! The smallest firmware (`firmware/examples/minimal.rs`): it works, and fits a small processor. Frames come and go
//! through the words of RAM that stand for the registers of its CAN controller.

use firmware_in_the_loop::image::Image;
use firmware_in_the_loop::machine::Machine;
use firmware_in_the_loop::part::Connections;
use firmware_in_the_loop::stack;
use protocol_core::frame::{Frame, extended, standard};

use super::budgets::{KIB, kib, print};
use super::client::frame;

/// Code and constants, in the profile for it.
const FLASH: u64 = 28 * KIB;
/// Variables.
const RAM: u64 = 1638;
/// The stack at its deepest.
const STACK: u64 = 2048;
/// A period of the firmware's loop, in nanoseconds: 16,000 cycles of a processor that runs at 160 MHz here.
const TICK: u64 = 100_000;
/// The number of periods that an answer may take.
const PATIENCE: u32 = 3000;

/// What a mailbox's first word says: a frame is in it, and its identifier is an extended one.
const FULL: u32 = 1 << 31;
const EXTENDED: u32 = 1 << 29;
/// The length of a mailbox: identifier, length, data.
const MAILBOX: u64 = 16;

/// The firmware, and the bus behind its registers.
struct Bus {
    machine: Machine,
    registers: u64,
}

impl Bus {
    fn of(image: &'static Image) -> Self {
        let machine = Machine::power_on(image, Connections::default());
        stack::paint(&machine);
        let registers = image.symbols().address("minimal::image::REGISTERS").expect("the registers");
        let mut bus = Self { machine, registers };
        // RAM holds noise before.
        bus.tick();
        bus
    }

    fn words<const N: usize>(&self, address: u64) -> [u32; N] {
        let bytes = self.machine.read(address..address + 4 * N as u64);
        std::array::from_fn(|word| u32::from_le_bytes(bytes[4 * word..][..4].try_into().expect("four bytes")))
    }

    fn bit_rate(&self) -> u32 {
        let [bit_rate] = self.words(self.registers + 2 * MAILBOX);
        bit_rate
    }

    fn tick(&mut self) {
        self.machine.start(self.machine.reached().at + TICK);
        self.machine.wait();
    }

    /// Puts a frame into the mailbox of the received ones, and lets the firmware take it.
    fn send(&mut self, text: &str) {
        let frame = frame(text);
        let head = [(frame.key() | FULL).to_le_bytes(), u32::from(frame.len()).to_le_bytes()];
        self.machine.write(self.registers, &[head.as_flattened(), frame.bytes()].concat());
        self.tick();
    }

    /// Takes the frame that the firmware sends next.
    fn receive(&mut self) -> Option<Frame> {
        let mailbox = self.registers + MAILBOX;
        for _ in 0..PATIENCE {
            let [key, len, low, high] = self.words(mailbox);
            if key & FULL != 0 {
                self.machine.write(mailbox, &[0; 4]);
                let id = if key & EXTENDED == 0 { standard(key as u16).into() } else { extended(key).into() };
                let data = [low.to_le_bytes(), high.to_le_bytes()];
                return Frame::of(id, &data.as_flattened()[..len as usize]);
            }
            self.tick();
        }
        None
    }

    #[track_caller]
    fn expect(&mut self, text: &str) {
        let received = self.receive().map_or("nothing".to_owned(), |frame| frame.to_string());
        assert_eq!(received, text);
    }

    #[track_caller]
    fn ask(&mut self, request: &str, answer: &str) {
        self.send(request);
        self.expect(answer);
    }

    #[track_caller]
    fn expect_boot(&mut self) {
        self.expect("720: 00");
        self.expect("0A0: 00 00 00 00 00 00 00 00");
    }

    fn stack(&self) -> u64 {
        assert_eq!(self.machine.summary().resets, []);
        stack::used(&self.machine)
    }
}

/// Start, SDO in segments, "save", "load", PDOs, faults, UDS, LSS, both resets. Returns the stack that it took.
fn all_services(image: &'static Image) -> u64 {
    let mut bus = Bus::of(image);
    bus.expect_boot();
    assert_eq!(bus.bit_rate(), 250_000);

    bus.ask("620: 40 18 10 01 00 00 00 00", "5A0: 43 18 10 01 19 00 00 01");
    bus.ask("620: 40 0A 10 00 00 00 00 00", "5A0: 41 0A 10 00 2F 00 00 00");
    bus.ask("620: 60 00 00 00 00 00 00 00", "5A0: 00 41 50 50 2D 5F 53 36");
    bus.ask("620: 21 53 60 00 09 00 00 00", "5A0: 60 53 60 00 00 00 00 00");
    bus.ask("620: 00 62 6F 6F 6D 20 6C 69", "5A0: 20 00 00 00 00 00 00 00");
    bus.ask("620: 1B 66 74 00 00 00 00 00", "5A0: 30 00 00 00 00 00 00 00");
    bus.ask("620: 23 10 10 01 73 61 76 65", "5A0: 60 10 10 01 00 00 00 00");
    bus.ask("620: 23 11 10 01 6C 6F 61 64", "5A0: 60 11 10 01 00 00 00 00");

    bus.send("000: 01 20");
    for status in ["09", "0B", "0F"] {
        bus.ask("220: 0F 00 00 20", &format!("1A0: {status} 00 00 00"));
    }
    // The set-points fail to come.
    bus.expect("0A0: 03 80 91 01 00 00 00 00");
    bus.ask("1BC78820: 03 22 F1 8C", "1BC100F1: 07 62 F1 8C 5B 2E 01 00");

    bus.send("000: 02 20");
    bus.send("7E5: 04 01 00 00 00 00 00 00");
    bus.ask("7E5: 13 00 02 00 00 00 00 00", "7E4: 13 00 00 00 00 00 00 00");
    bus.ask("7E5: 17 00 00 00 00 00 00 00", "7E4: 17 00 00 00 00 00 00 00");
    bus.send("7E5: 15 0A 00 00 00 00 00 00");
    while bus.bit_rate() != 500_000 {
        bus.tick();
    }
    bus.send("000: 82 20");
    bus.expect("720: 00");
    bus.expect("0A0: 00 00 00 00 00 00 00 00");
    bus.expect("0A0: 03 80 91 01 00 00 00 00");
    bus.send("000: 81 20");
    bus.expect_boot();
    // Its memory is empty.
    assert_eq!(bus.bit_rate(), 250_000);
    bus.stack()
}

#[test]
fn the_smallest_firmware_serves_all_and_fits_a_small_processor() {
    let measure = |profile| {
        let image = Image::example(profile, "minimal");
        let (size, stack) = (image.symbols().total(), all_services(image));
        print(&format!(
            "minimal, {profile}: flash {} ({}), RAM {}, stack {stack} bytes",
            size.flash,
            kib(size.flash),
            size.ram
        ));
        (size, stack)
    };
    measure("firmware");
    let (size, stack) = measure("firmware-minimal");
    assert!(size.flash <= FLASH && size.ram <= RAM && stack <= STACK, "{size:?}, stack {stack}");
}
