//! A master on the bus of an emulated valve.

use std::collections::VecDeque;

use firmware_in_the_loop::bench::{Device, ImageBench};
use firmware_in_the_loop::board::{Board, NUCLEO_F429ZI};
use firmware_in_the_loop::machine::Machine;
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
    pub bench: ImageBench,
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
        Self::powered(ImageBench::with_device(board, BitRate::Kbit250, &VALVE))
    }

    /// The valve on ISOBUS, after the wait that follows its claim.
    pub fn on_isobus() -> Self {
        let bench = ImageBench::with_device(&NUCLEO_F429ZI, BitRate::Kbit250, &ON_ISOBUS);
        let mut client = Self { bench, aside: VecDeque::new() };
        client.bench.power_cycle();
        client.expect("18EEFF83: 01 00 20 07 08 FF 02 20");
        client.wait_ms(260);
        client.aside.clear();
        client
    }

    /// The angle sensor, booted at 500 kbit/s.
    pub fn sensor() -> Self {
        let bench = ImageBench::with_device(&NUCLEO_F429ZI, BitRate::Kbit500, &SENSOR);
        let mut client = Self { bench, aside: VecDeque::new() };
        client.bench.power_cycle();
        client.expect("720: 00");
        client
    }

    /// The valve with these bytes in its memory, booted at 250 kbit/s.
    pub fn with_memory(board: &'static Board, content: &[u8]) -> Self {
        Self::powered(ImageBench::with_memory(board, BitRate::Kbit250, content))
    }

    /// The emulated board.
    pub fn machine(&self) -> &Machine {
        self.bench.rig.machine(self.bench.board).expect("it is under power")
    }

    /// Cuts the power and looks whether the part was ever reset; there was no reset unless a test wanted one.
    pub fn end_without_reset(mut self) {
        let board = self.bench.board;
        self.bench.rig.power(board, false);
        assert_eq!(self.bench.rig.resets(board), []);
    }

    /// Goes on until something happens, or a while.
    pub fn step(&mut self) {
        let limit = after(self.bench.now(), Duration::from_millis(10));
        self.bench.rig.step(limit);
    }
}

impl ImageClient {
    /// Switches the valve on and takes its boot-up.
    pub fn powered(bench: ImageBench) -> Self {
        let mut client = Self { bench, aside: VecDeque::new() };
        client.bench.power_cycle();
        client.expect("720: 00");
        client.expect("0A0: 00 00 00 00 00 00 00 00");
        client
    }

    pub fn now_us(&self) -> u64 {
        self.bench.now().as_micros()
    }

    pub fn send(&mut self, text: &str) {
        self.bench.send(frame(text));
    }

    pub fn receive(&mut self) -> Option<Frame> {
        self.receive_for(PATIENCE)
    }

    pub fn receive_for(&mut self, time: Duration) -> Option<Frame> {
        self.aside.pop_front().or_else(|| self.bench.receive(after(self.bench.now(), time)))
    }

    pub fn expect(&mut self, text: &str) {
        let received = self.receive().map_or("nothing".to_owned(), |frame| frame.to_string());
        assert_eq!(received, text, "at {} us", self.now_us());
    }

    pub fn wait_ms(&mut self, ms: u64) {
        let end = after(self.bench.now(), Duration::from_millis(ms));
        while let Some(frame) = self.bench.receive(end) {
            self.aside.push_back(frame);
        }
    }

    /// All frames that come in so many milliseconds.
    pub fn listen_ms(&mut self, ms: u64) -> Vec<Frame> {
        let end = after(self.bench.now(), Duration::from_millis(ms));
        let mut frames: Vec<_> = self.aside.drain(..).collect();
        while let Some(frame) = self.bench.receive(end) {
            frames.push(frame);
        }
        frames
    }

    /// Sends an SDO request and takes the answer; what else comes is put aside.
    pub fn sdo(&mut self, request: [u8; 8]) -> [u8; 8] {
        self.try_sdo(request).expect("an SDO answer")
    }

    pub fn try_sdo(&mut self, request: [u8; 8]) -> Option<[u8; 8]> {
        self.bench.send(Frame::full(protocol_core::frame::standard(0x620).into(), request));
        let end = after(self.bench.now(), PATIENCE);
        loop {
            let frame = self.bench.receive(end)?;
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
