//! A master on the bus of an emulated valve.

use std::collections::VecDeque;

use firmware_in_the_loop::board::{Board, NUCLEO_F429ZI};
use firmware_in_the_loop::content;
use firmware_in_the_loop::machine::{Machine, Reset};
use firmware_in_the_loop::part::Connections;
use firmware_in_the_loop::rig::{Device, ImageRig};
use protocol_core::controller::BitRate;
use protocol_core::device::{Kind, hat, pve};
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, after};

/// The valve of these tests.
pub const VALVE: Device = Device { kind: Kind::Pve(pve::Kind::PveaCanopen), node_id: 0x20, serial: None };
/// The valve of those on ISOBUS.
pub const ON_ISOBUS: Device = Device { kind: Kind::Pve(pve::Kind::PveaIsobus), node_id: 0x83, serial: None };
/// The angle sensor of these tests: at the valve's node ID, so that what speaks to the one speaks to the other.
pub const SENSOR: Device = Device { kind: Kind::Hat(hat::Kind::Hat1000), node_id: 0x20, serial: None };
/// How long an answer may take.
const PATIENCE: Duration = Duration::from_millis(1500);

/// The frame of a text in the manuals' notation.
pub fn frame(text: &str) -> Frame {
    text.parse().unwrap_or_else(|error| panic!("{text:?}: {error}"))
}

/// A master of an emulated valve.
pub struct ImageClient {
    /// What it is connected to.
    pub rig: ImageRig,
    /// Frames that came while it waited for another one.
    pub aside: VecDeque<Frame>,
}

impl ImageClient {
    /// The valve, booted at 250 kbit/s.
    pub fn booted() -> Self {
        Self::booted_on(&NUCLEO_F429ZI)
    }

    /// The valve on this board, booted at 250 kbit/s.
    pub fn booted_on(board: &'static Board) -> Self {
        Self::powered(ImageRig::with_device(board, BitRate::Kbit250, &VALVE))
    }

    /// The valve on ISOBUS, after the wait that follows its claim.
    pub fn on_isobus() -> Self {
        let rig = ImageRig::with_device(&NUCLEO_F429ZI, BitRate::Kbit250, &ON_ISOBUS);
        let mut client = Self::started(rig);
        client.expect("18EEFF83: 01 00 20 07 08 FF 02 20");
        client.wait_ms(260);
        client.aside.clear();
        client
    }

    /// The angle sensor, booted at 500 kbit/s.
    pub fn sensor() -> Self {
        let rig = ImageRig::with_device(&NUCLEO_F429ZI, BitRate::Kbit500, &SENSOR);
        let mut client = Self::started(rig);
        client.expect("720: 00");
        client
    }

    /// The valve with these bytes in its memory, booted at 250 kbit/s.
    pub fn with_memory(board: &'static Board, content: &[u8]) -> Self {
        Self::powered(ImageRig::with_memory(board, BitRate::Kbit250, content))
    }

    /// The valve on this board, booted; to save its parameters erases a sector of its memory.
    pub fn about_to_erase(board: &'static Board) -> Self {
        let saved = content::stored_after(&VALVE, &[frame("620: 23 10 10 01 73 61 76 65")]);
        Self::with_memory(board, &content::worn(&saved))
    }

    /// Brings the valve to ACTIVE by RPDOs with this identifier.
    pub fn activate(&mut self, rpdo: &str) {
        self.send("000: 01 00");
        for status in ["09", "0B", "0F"] {
            self.exchange(&format!("{rpdo}: 0F 00 00 00"), &format!("1A0: {status} 00 00 00"));
        }
    }

    /// What is connected to the board.
    pub fn connections(&self) -> &Connections {
        self.rig.boards.connections(self.rig.board)
    }

    /// Types a line at the console.
    pub fn type_line(&mut self, line: &str) {
        self.rig.boards.type_line(self.rig.board, line);
    }

    /// What the console has printed since this was last asked.
    pub fn printed(&mut self) -> String {
        self.rig.boards.printed(self.rig.board)
    }

    /// The bit rate of the board's controller while it is on the bus.
    pub fn bits_per_second(&self) -> Option<u64> {
        self.rig.boards.bits_per_second(self.rig.board)
    }

    /// The resets of the board but for those that came with the power.
    pub fn resets(&self) -> Vec<Reset> {
        self.rig.boards.resets(self.rig.board)
    }

    /// Goes on until all that the master has sent is out.
    pub fn finish_sending(&mut self) {
        while self.rig.boards.world.pending(self.rig.master) > 0 {
            self.step();
        }
    }

    /// The emulated board.
    pub fn machine(&self) -> &Machine {
        self.rig.boards.machine(self.rig.board).expect("it is under power")
    }

    /// Cuts the power and looks whether the part was ever reset; there was no reset unless a test wanted one.
    pub fn end_without_reset(mut self) {
        self.rig.boards.power(self.rig.board, false);
        assert_eq!(self.resets(), []);
    }

    /// Goes on until something happens, or a while.
    pub fn step(&mut self) {
        let limit = after(self.rig.now(), Duration::from_millis(10));
        self.rig.boards.step(limit);
    }
}

impl ImageClient {
    /// Switches the device on.
    pub fn started(rig: ImageRig) -> Self {
        let mut client = Self { rig, aside: VecDeque::new() };
        client.rig.power_cycle();
        client
    }

    /// Switches the valve on and takes its boot-up.
    pub fn powered(rig: ImageRig) -> Self {
        let mut client = Self::started(rig);
        client.expect_boot();
        client
    }

    /// Takes the boot-up of a valve without an error.
    pub fn expect_boot(&mut self) {
        self.expect("720: 00");
        self.expect("0A0: 00 00 00 00 00 00 00 00");
    }

    pub fn now_us(&self) -> u64 {
        self.rig.now().as_micros()
    }

    pub fn send(&mut self, text: &str) {
        self.rig.send(frame(text));
    }

    pub fn receive(&mut self) -> Option<Frame> {
        self.receive_for(PATIENCE)
    }

    pub fn receive_for(&mut self, time: Duration) -> Option<Frame> {
        self.aside.pop_front().or_else(|| self.rig.receive(after(self.rig.now(), time)))
    }

    pub fn expect(&mut self, text: &str) {
        let received = self.receive().map_or("nothing".to_owned(), |frame| frame.to_string());
        assert_eq!(received, text, "at {} us", self.now_us());
    }

    /// Sends a frame; the next one that comes must be this one.
    pub fn exchange(&mut self, request: &str, answer: &str) {
        self.send(request);
        self.expect(answer);
    }

    pub fn wait_ms(&mut self, ms: u64) {
        let end = after(self.rig.now(), Duration::from_millis(ms));
        while let Some(frame) = self.rig.receive(end) {
            self.aside.push_back(frame);
        }
    }

    /// All frames that come in so many milliseconds.
    pub fn listen_ms(&mut self, ms: u64) -> Vec<Frame> {
        let end = after(self.rig.now(), Duration::from_millis(ms));
        let mut frames: Vec<_> = self.aside.drain(..).collect();
        while let Some(frame) = self.rig.receive(end) {
            frames.push(frame);
        }
        frames
    }

    /// Sends an SDO request and takes the answer; what else comes is put aside.
    pub fn sdo(&mut self, request: [u8; 8]) -> [u8; 8] {
        self.try_sdo(request).expect("an SDO answer")
    }

    pub fn try_sdo(&mut self, request: [u8; 8]) -> Option<[u8; 8]> {
        self.rig.send(Frame::full(protocol_core::frame::standard(0x620).into(), request));
        let end = after(self.rig.now(), PATIENCE);
        loop {
            let frame = self.rig.receive(end)?;
            if frame.to_string().starts_with("5A0:") {
                return frame.eight().copied();
            }
            self.aside.push_back(frame);
        }
    }

    /// Reads an object of up to four bytes.
    pub fn read(&mut self, index: u16, sub: u8) -> u32 {
        let [low, high] = index.to_le_bytes();
        let answer = self.sdo([0x40, low, high, sub, 0, 0, 0, 0]);
        assert_eq!(answer[0] & 0xE2, 0x42, "{index:04X}:{sub:02X} answers {answer:02X?}");
        u32::from_le_bytes([answer[4], answer[5], answer[6], answer[7]])
    }

    /// Writes an object of `size` bytes.
    pub fn write(&mut self, index: u16, sub: u8, size: u8, value: u32) {
        let answer = self.sdo(download(index, sub, size, value));
        assert_eq!(answer[0], 0x60, "{index:04X}:{sub:02X} answers {answer:02X?}");
    }
}

/// An expedited download.
pub fn download(index: u16, sub: u8, size: u8, value: u32) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    let [a, b, c, d] = value.to_le_bytes();
    [0x23 | (4 - size) << 2, low, high, sub, a, b, c, d]
}

/// "save" in 0x1010.
pub const SAVE: u32 = u32::from_le_bytes(*b"save");
