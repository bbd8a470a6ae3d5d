//! Random traffic, legal and hostile, for each kind of device.

use fastrand::Rng;
use firmware_in_the_loop::rig::Device;
use hal_sim::world::Change;
use protocol_core::actuator::SpoolFault;
use protocol_core::device::{Kind, Protocol};
use protocol_core::frame::{Frame, Id, extended, standard};

use super::super::client::{download, frame};

/// A step of the traffic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// The master sends a frame after those that it has given to the bus before.
    Send(Frame),
    /// So many microseconds pass.
    Pass(u64),
    /// A line is typed at the console.
    Type(Change),
    /// The power is cut, and comes back.
    PowerCycle,
}

const VALVE_OBJECTS: &[u16] = &[
    0x1000, 0x1001, 0x1003, 0x1005, 0x1008, 0x100A, 0x1010, 0x1011, 0x1014, 0x1017, 0x1018, 0x1028, 0x1400, 0x1600,
    0x1800, 0x1A00, 0x2001, 0x201D, 0x3300, 0x3303, 0x6040, 0x6041, 0x6042, 0x6052, 0x605F, 0x6300, 0x6301,
];
const SENSOR_OBJECTS: &[u16] = &[
    0x1000, 0x1001, 0x1003, 0x1005, 0x1008, 0x1010, 0x1011, 0x1014, 0x1017, 0x1018, 0x1029, 0x1800, 0x1A00, 0x1F80,
    0x2001, 0x2002, 0x6003, 0x6004, 0x6503, 0x6509,
];
/// What a TPDO may map, with a dummy of a valve.
const VALVE_MAPPABLE: &[u32] = &[0x60410010, 0x33010008, 0x33020008, 0x33040010, 0x63010110, 0x00050008];
const SENSOR_MAPPABLE: &[u32] = &[0x10010008, 0x10020020, 0x60040020, 0x65030010];
const VALUES: &[u32] = &[
    0,
    1,
    2,
    3,
    7,
    0x0C,
    0x0F,
    20,
    50,
    240,
    0xFF,
    0x4000,
    0xC000,
    0x7FFF,
    0x80,
    0x81,
    0xA1,
    0x1A0,
    0x220,
    0x800001A0,
    0x80000220,
    0x60400010,
    0x60410010,
    0x63000110,
    0x63010110,
    0x60040020,
    0x00010001,
    0x00070020,
    0x65766173,
    0x6461_6F6C,
];
const COMMANDS: &[u8] =
    &[0x40, 0x40, 0x40, 0x22, 0x23, 0x27, 0x2B, 0x2F, 0x21, 0x20, 0x60, 0x70, 0x00, 0x10, 0x0B, 0x1D, 0x80, 0xA0, 0xC0];
const LSS: &[u8] = &[0x04, 0x11, 0x13, 0x17, 0x40, 0x41, 0x42, 0x43, 0x46, 0x4B, 0x4C, 0x51, 0x5A, 0x5E];
const LSS_FIRST: &[[u8; 2]] = &[[0, 0], [1, 0], [1, 0], [0x20, 0], [0x21, 0], [0xFF, 0], [0, 2], [0, 3]];
const UDS: &[[u8; 8]] = &[
    [0x03, 0x22, 0x10, 0x01, 0, 0, 0, 0],
    [0x03, 0x22, 0xF1, 0x8C, 0, 0, 0, 0],
    [0x03, 0x22, 0xF0, 0x10, 0, 0, 0, 0],
    [0x04, 0x2E, 0x10, 0x01, 0x83, 0, 0, 0],
    [0x02, 0x10, 0x03, 0, 0, 0, 0, 0],
];
/// Messages of the transport protocol, to all and to the valve; the first, fourth and fifth are one commanded address.
const TRANSPORT: &[(u32, [u8; 8])] = &[
    (0x1CECFF00, [0x20, 9, 0, 2, 0xFF, 0xD8, 0xFE, 0]),
    (0x1CECFF00, [0x20, 18, 0, 3, 0xFF, 0xCB, 0xFE, 0]),
    (0x1CECFF00, [0xFF, 1, 0xFF, 0xFF, 0xFF, 0xD8, 0xFE, 0]),
    (0x1CEBFF00, [1, 0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02]),
    (0x1CEBFF00, [2, 0x20, 0x83, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]),
    (0x1CEBFF00, [2, 0x20, 0x90, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]),
    (0x1CEB8300, [1, 0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02]),
    (0x1CEC8300, [0x10, 9, 0, 2, 0xFF, 0xD8, 0xFE, 0]),
];
/// A frame that is more urgent than all of a device but NMT.
const URGENT: &str = "001: 00 00 00 00 00 00 00 00";
/// A frame that is less urgent than all.
const IDLE: &str = "1FFFFFFF: 00 00 00 00 00 00 00 00";

/// Returns the steps of so many batches.
pub fn steps(device: &Device, batches: usize, random: &mut Rng) -> Vec<Step> {
    let Device { kind, node_id: node, .. } = *device;
    let mut traffic = Traffic { kind, node, random, steps: vec![Step::Pass(1000)], turns: false };
    if traffic.is_isobus() {
        // An address is claimed for 250 ms.
        traffic.pass(300_000);
    }
    for _ in 0..batches {
        traffic.batch();
        let most = traffic.pick(&[1, 100, 1000, 1000, 5000, 20_000, 60_000]);
        traffic.pass_up_to(most);
    }
    traffic.steps
}

struct Traffic<'a> {
    kind: Kind,
    /// The node ID that most frames are for.
    node: u8,
    random: &'a mut Rng,
    steps: Vec<Step>,
    /// The shaft turns: a preset would keep the microsecond at which it came.
    turns: bool,
}

impl Traffic<'_> {
    const fn is_valve(&self) -> bool {
        matches!(self.kind, Kind::Pve(_))
    }

    fn is_isobus(&self) -> bool {
        self.kind.protocol() == Protocol::Isobus
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.random.usize(..from.len())]
    }

    fn one_in(&mut self, n: u32) -> bool {
        self.random.u32(..n) == 0
    }

    /// Does something so many times, up to a number.
    fn repeat(&mut self, most: u32, act: impl Fn(&mut Self)) {
        (0..self.random.u32(1..=most)).for_each(|_| act(self));
    }

    fn pass(&mut self, micros: u64) {
        self.steps.push(Step::Pass(micros));
    }

    fn pass_up_to(&mut self, micros: u64) {
        let micros = self.random.u64(..=micros);
        self.pass(micros);
    }

    /// Sends a frame; seldom with another length, or as a remote frame.
    fn send(&mut self, id: impl Into<Id>, len: u8, data: [u8; 8]) {
        let len = if self.one_in(25) { self.random.u8(..=8) } else { len };
        let frame = if self.one_in(50) { Frame::remote(id.into(), len) } else { Frame::with_len(id.into(), data, len) };
        self.steps.push(Step::Send(frame));
    }

    fn send_text(&mut self, text: &str) {
        self.steps.push(Step::Send(frame(text)));
    }

    fn batch(&mut self) {
        if self.one_in(60) {
            self.steps.push(Step::PowerCycle);
            self.turns = false;
        } else if self.one_in(12) {
            self.plant();
        } else if self.one_in(12) {
            self.repeat(5, Self::flood);
        } else if self.one_in(12) {
            self.displace();
        } else {
            self.request();
        }
    }

    fn request(&mut self) {
        if self.is_isobus() { self.isobus() } else { self.canopen() }
    }

    /// Requests on a full bus.
    fn flood(&mut self) {
        let other = self.pick(&[URGENT, IDLE]);
        (0..self.random.u32(..5)).for_each(|_| self.send_text(other));
        self.request();
    }

    /// Answers that have to wait, each more urgent than the one before: more than there are mailboxes.
    fn displace(&mut self) {
        let node = self.node;
        let requests = if self.is_isobus() {
            [
                "1CEC8327: 10 09 00 02 FF D8 FE 00",
                "18EA8327: CB FE 00",
                "18EA8327: CA FE 00",
                "18EA8327: 00 EE 00",
                "18EA8327: CC FE 00",
            ]
            .map(str::to_owned)
        } else {
            let tpdo =
                if self.is_valve() { format!("{:03X}: 00 00 00 00", 0x200 + u16::from(node)) } else { "080:".into() };
            self.send_text(&format!("000: 01 {node:02X}"));
            self.write(0x1017, 0, 2, 10);
            self.write(0x1800, 2, 1, if self.is_valve() { 0xFF } else { 1 });
            self.map(&[]);
            self.pass(8000);
            // The heartbeat comes meanwhile.
            (0..40).for_each(|_| self.send_text(URGENT));
            let sdo = format!("{:03X}: 40 00 10 00 00 00 00 00", 0x600 + u16::from(node));
            [sdo.clone(), sdo, tpdo.clone(), tpdo, URGENT.to_owned()]
        };
        for request in requests {
            self.send_text(&request);
            (0..self.random.u32(..3)).for_each(|_| self.send_text(URGENT));
        }
        if !self.is_isobus() {
            (0..20).for_each(|_| self.send_text(URGENT));
            // An EMCY.
            self.pass(10_000);
            let fault = self.random.bool();
            self.set_plant(Change::InternalFault(fault));
        }
    }

    fn plant(&mut self) {
        let switch = self.random.bool();
        let spool = [SpoolFault::None, SpoolFault::Stuck, SpoolFault::Slow, SpoolFault::Drifting, SpoolFault::NoFloat];
        let plant = match (self.random.u32(..8), self.is_valve()) {
            (0, _) => Change::InternalFault(switch),
            (1, _) => Change::MemoryFails(switch && self.one_in(2)),
            (2 | 3, true) => Change::SupplyMv(self.pick(&[24_000, 24_000, 8_999, 9_000, 36_000, 36_001, 0])),
            (4, true) => Change::TemperatureC(self.pick(&[25, 25, -41, -40, 120, 121])),
            (5, true) => Change::Spool(if switch { SpoolFault::None } else { self.pick(&spool) }),
            (_, true) => Change::Lever(self.pick(&[None, None, Some(4000), Some(-16384)])),
            (2 | 3, false) => Change::AngleCdeg(self.random.u32(..36_000)),
            (4, false) => Change::MeasuringError(switch),
            (_, false) => {
                let speed = self.pick(&[0, 0, 0, 1, -60, 3000]);
                self.turns = speed != 0;
                // Ends a download of a preset.
                let id = self.sdo_id();
                self.steps.push(Step::Send(Frame::full(id, [0x80, 0, 0, 0, 0, 0, 0, 0])));
                self.pass(2000);
                Change::SpeedRpm(speed)
            }
        };
        self.set_plant(plant);
    }

    /// Types a line, and waits: the console takes one line after the other.
    fn set_plant(&mut self, plant: Change) {
        self.steps.push(Step::Type(plant));
        self.pass(20_000);
    }

    fn canopen(&mut self) {
        match self.random.u32(..40) {
            0..=11 => self.repeat(7, Self::sdo),
            12..=16 if self.is_valve() => self.repeat(3, Self::rpdo),
            12..=19 => self.repeat(3, |traffic| {
                let id = traffic.pick(&[0x080, 0x080, 0x081]);
                traffic.send(standard(id), 0, [0; 8]);
            }),
            20..=22 => self.activate(),
            23..=25 => {
                let command = self.pick(&[0x01, 0x01, 0x02, 0x80, 0x81, 0x82, 0x03]);
                let node = self.pick(&[0, self.node, self.node, 0x17]);
                self.send(standard(0), 2, [command, node, 0, 0, 0, 0, 0, 0]);
            }
            26..=28 => self.repeat(5, Self::lss),
            29 => self.bit_rate(),
            30..=33 => self.configure(),
            34 => self.save(),
            35 | 36 => self.uds(),
            37 => {
                // The EMCY of another node.
                let id = self.pick(&[0x081, 0x0A1, 0x0C5]);
                let data = self.pick(&[[0x00, 0x10, 1, 1, 0, 0, 0, 0], [0; 8]]);
                self.send(standard(id), 8, data);
            }
            _ => self.anything(),
        }
    }

    fn anything(&mut self) {
        let service = self.pick(&[0x080, 0x180, 0x200, 0x580, 0x600, 0x700]);
        let id: Id = match self.random.u32(..3) {
            0 => standard(self.random.u16(..=0x7FF)).into(),
            1 => extended(self.random.u32(..=0x1FFF_FFFF)).into(),
            _ => standard(service + u16::from(self.node & 0x7F)).into(),
        };
        let (len, data) = (self.random.u8(..=8), self.random.u64(..).to_le_bytes());
        self.send(id, len, data);
    }

    fn sdo_id(&self) -> Id {
        standard(0x600 + u16::from(self.node)).into()
    }

    fn sdo(&mut self) {
        const PRESET: u16 = 0x6003;
        let objects = if self.is_valve() { VALVE_OBJECTS } else { SENSOR_OBJECTS };
        let index = if self.one_in(12) { self.random.u16(..) } else { self.pick(objects) };
        let index = if self.turns && index == PRESET { 0x6004 } else { index };
        let command = if self.one_in(12) { self.random.u8(..) } else { self.pick(COMMANDS) };
        let sub = if self.one_in(12) { self.random.u8(..) } else { self.random.u8(..4) };
        let value = if self.one_in(5) { self.random.u32(..) } else { self.pick(VALUES) };
        let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value.to_le_bytes());
        self.send(self.sdo_id(), 8, [command, low, high, sub, a, b, c, d]);
    }

    fn write(&mut self, index: u16, sub: u8, size: u8, value: u32) {
        self.steps.push(Step::Send(Frame::full(self.sdo_id(), download(index, sub, size, value))));
    }

    fn rpdo(&mut self) {
        let word = self.pick(&[0x00, 0x01, 0x03, 0x0B, 0x0F, 0x0F, 0x0F, 0xFF]);
        let [low, high] = self.pick(&[0_u16, 0x2000, 0x4000, 0xC000, 0xE000, 0x7FFF, 0x1234]).to_le_bytes();
        self.send(standard(0x200 + u16::from(self.node)), 4, [word, 0, low, high, 0, 0, 0, 0]);
    }

    /// Use case 1, which random frames seldom get to.
    fn activate(&mut self) {
        self.send_text(&format!("000: 01 {:02X}", self.node));
        if self.is_valve() {
            let set_point = self.pick(&["00 00", "00 20", "00 C0", "FF 7F"]);
            for _ in 0..4 {
                self.send_text(&format!("{:03X}: 0F 00 {set_point}", 0x200 + u16::from(self.node)));
                self.pass_up_to(3000);
            }
        }
    }

    fn lss(&mut self) {
        let command = if self.one_in(12) { self.random.u8(..) } else { self.pick(LSS) };
        let [a, b] = if self.one_in(5) { [self.random.u8(..), self.random.u8(..)] } else { self.pick(LSS_FIRST) };
        let [c, d, e, f, ..] = if self.one_in(5) { self.random.u64(..).to_le_bytes() } else { [0; 8] };
        self.send(standard(0x7E5), 8, [command, a, b, 0, c, d, e, f]);
    }

    /// Another bit rate by LSS. The device is silent for the delay, before the change and after it.
    fn bit_rate(&mut self) {
        let index = self.pick(&[0, 2, 3, 4, 6]);
        let delay = self.random.u8(2..30);
        self.send_text("000: 02 00");
        self.send_text("7E5: 04 01 00 00 00 00 00 00");
        self.send_text(&format!("7E5: 13 00 {index:02X} 00 00 00 00 00"));
        if self.one_in(3) {
            self.send_text("7E5: 17 00 00 00 00 00 00 00");
            self.pass(30_000);
        }
        self.send_text(&format!("7E5: 15 {delay:02X} 00 00 00 00 00 00"));
        self.pass(5000 + 2000 * u64::from(delay));
        self.send_text("7E5: 04 00 00 00 00 00 00 00");
    }

    fn configure(&mut self) {
        let cycle = self.pick(&[0, 10, 10, 11, 20, 50]);
        match self.random.u32(..5) {
            0 => self.write(0x1017, 0, 2, cycle),
            1 => {
                self.write(0x1800, 2, 1, 0xFE);
                self.write(0x1800, 5, 2, cycle);
            }
            2 => {
                let transmission = self.pick(&[0, 1, 2, 3, 0xFE, 0xFF]);
                self.write(0x1800, 2, 1, transmission);
            }
            3 => {
                let mappable = if self.is_valve() { VALVE_MAPPABLE } else { SENSOR_MAPPABLE };
                let objects: Vec<u32> = (0..self.random.u32(1..5)).map(|_| self.pick(mappable)).collect();
                self.map(&objects);
            }
            _ => self.write(0x1005, 0, 4, 0x80),
        }
    }

    /// Maps objects into the TPDO, in the order of CiA 301, and switches it on. Without objects the mapping stays.
    fn map(&mut self, objects: &[u32]) {
        let id = self.pick(&[0x1A0, 0x181, 0x222]);
        self.write(0x1800, 1, 4, 0x8000_0000 | id);
        if let Ok(count @ 1..) = u32::try_from(objects.len()) {
            self.write(0x1A00, 0, 1, 0);
            (1..).zip(objects).for_each(|(sub, object)| self.write(0x1A00, sub, 4, *object));
            self.write(0x1A00, 0, 1, count);
        }
        self.write(0x1800, 1, 4, id);
    }

    /// Saves, or loads the factory values, and gives the memory time.
    fn save(&mut self) {
        let (index, word) = self.pick(&[(0x1010, *b"save"), (0x1010, *b"save"), (0x1011, *b"load")]);
        let sub = self.pick(&[1, 1, 2, 3]);
        self.write(index, sub, 4, u32::from_le_bytes(word));
        let time = self.pick(&[0, 500, 5000, 40_000]);
        self.pass(time);
    }

    fn uds(&mut self) {
        let (source, data) = (self.random.u32(..=0x7FF), self.pick(UDS));
        self.send(extended(0x1BC0_0000 | source << 11 | u32::from(self.node)), data[0] + 1, data);
    }

    fn isobus(&mut self) {
        match self.random.u32(..20) {
            0..=7 => self.repeat(4, Self::command),
            8..=11 => self.parameter_group(),
            12 | 13 => self.claim(),
            14 | 15 => self.transport(),
            16 => self.uds(),
            17 => self.drive(),
            _ => self.anything(),
        }
    }

    fn command(&mut self) {
        let states = [0x30, 0x31, 0x32, 0x33, 0x3A, 0x3E];
        let state = if self.one_in(9) { self.random.u8(..) } else { self.pick(&states) };
        let flow = self.pick(&[0, 1, 125, 250, 60]);
        let number = if self.one_in(9) { self.random.u32(..16) } else { 3 };
        let source = self.pick(&[0x27, 0x27, 0x27, 0x28]);
        let data = [flow, 0xFF, state, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF];
        self.send(extended(0x0CFE_3000 | number << 8 | source), 8, data);
    }

    /// The way out of the shutdown, and a set-point that is kept up.
    fn drive(&mut self) {
        for _ in 0..2 {
            self.send_text("0CFE3327: 00 FF 30 FF FF FF FF FF");
            self.pass(90_000);
        }
        let flow = self.random.u8(..=250);
        self.repeat(5, |traffic| {
            traffic.send_text(&format!("0CFE3327: {flow:02X} FF 31 FF FF FF FF FF"));
            traffic.pass(70_000);
        });
    }

    fn parameter_group(&mut self) {
        let groups = [0xEE00, 0xFECA, 0xFECB, 0xFECC, 0xFE13, 0xFE14, 0xFF00];
        let group = if self.one_in(9) { self.random.u32(..) } else { self.pick(&groups) };
        let destination = self.pick(&[0x83, 0x83, 0x83, 0xFF, 0x84]);
        let source = self.pick(&[0x27, 0xFE, 0x10]);
        let [a, b, c, _] = group.to_le_bytes();
        self.send(extended(0x18EA_0000 | destination << 8 | source), 3, [a, b, c, 0, 0, 0, 0, 0]);
    }

    /// Claims that the valve wins, and those for other addresses: it would lose only against a smaller NAME.
    fn claim(&mut self) {
        const OWN: u64 = 0x2002_FF08_0720_0001;
        let name = if self.one_in(3) { self.random.u64(..) | 1 << 63 } else { OWN + self.random.u64(1..1000) };
        let source = if self.one_in(5) { self.random.u32(..=0xFD) } else { 0x83 };
        self.send(extended(0x18EE_FF00 | source), 8, name.to_le_bytes());
    }

    fn transport(&mut self) {
        let source = self.random.u32(0x20..0x24);
        self.repeat(3, |traffic| {
            let (id, data) = traffic.pick(TRANSPORT);
            traffic.send(extended(id | source), 8, data);
        });
        if self.one_in(6) {
            for (id, data) in [0, 3, 4].map(|at| TRANSPORT[at]) {
                self.steps.push(Step::Send(Frame::full(extended(id | source).into(), data)));
            }
        }
    }
}
