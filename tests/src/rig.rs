//! A device on a bus of its own, in virtual time: frames go in and come out at once, the memory is a map of records.

use std::collections::{BTreeMap, VecDeque};

use protocol_core::controller::{BitRate, Controller, Filter, Filters};
use protocol_core::device::pve::{Kind, Protocol, PveCanopen, PveIsobus, Setup};
use protocol_core::device::{Device, Effect, Senses, StartCause};
use protocol_core::frame::Frame;
use protocol_core::memory::{Image, Record, RecordKey, StoreError};
use protocol_core::pump::pump;
use protocol_core::time::{Duration, Instant, after};

/// The frame of a text in the manuals' notation, `5A0: 43 18 10 01 19 00 00 01`.
///
/// # Panics
/// When it is none.
#[must_use]
pub fn frame(text: &str) -> Frame {
    text.parse().unwrap_or_else(|error| panic!("{text:?}: {error}"))
}

/// A controller on an empty bus: what is transmitted is on the bus at once, unless the bus is held.
#[derive(Debug, Default)]
struct Wire {
    received: VecDeque<Frame>,
    sent: VecDeque<Frame>,
    /// The bus is busy: nothing can be transmitted.
    held: bool,
    /// What the device listens to: nothing else gets to it.
    filters: Filters,
}

impl embedded_can::nb::Can for Wire {
    type Frame = Frame;
    type Error = embedded_can::ErrorKind;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Self::Error> {
        if self.held {
            return Err(nb::Error::WouldBlock);
        }
        self.sent.push_back(*frame);
        Ok(None)
    }

    fn receive(&mut self) -> nb::Result<Frame, Self::Error> {
        self.received.pop_front().ok_or(nb::Error::WouldBlock)
    }
}

impl Controller for Wire {
    fn is_idle(&self) -> bool {
        !self.held
    }

    /// What was transmitted is on the bus.
    fn abort(&mut self, _: Filter) {}

    fn set_filters(&mut self, filters: &Filters) {
        self.filters.clone_from(filters);
    }
}

/// A write that the memory has begun.
#[derive(Debug)]
struct Write {
    key: RecordKey,
    record: Record,
    done: Instant,
}

/// The cycle in which the manual's controller sends.
const CYCLE_MS: u64 = 100;

/// The device of a setup.
fn power_on(setup: Setup, image: &Image, cause: StartCause, now: Instant) -> Box<dyn Device> {
    match setup.kind.protocol() {
        Protocol::Canopen => Box::new(PveCanopen::power_on(setup, image, cause, now)),
        Protocol::Isobus => Box::new(PveIsobus::power_on(setup, image, cause, now)),
    }
}

/// A valve on a rig.
pub struct Rig {
    setup: Setup,
    device: Box<dyn Device>,
    wire: Wire,
    now: Instant,
    senses: Senses,
    /// The memory: records by key. What is put in here is found at the next start.
    pub records: BTreeMap<RecordKey, Vec<u8>>,
    /// The next start finds the memory damaged as a whole.
    pub memory_damaged: bool,
    /// Every write fails.
    pub writes_fail: bool,
    /// How long a write takes.
    pub write_time: Duration,
    /// Every record that was written, in order.
    pub writes: Vec<RecordKey>,
    write: Option<Write>,
    bit_rates: Vec<BitRate>,
}

impl Rig {
    /// A `pvea-canopen` at node 0x20, fresh from the factory, booted; its two frames are taken.
    #[must_use]
    pub fn booted() -> Self {
        Self::booted_as(Setup::new(Kind::PveaCanopen))
    }

    /// The same of another kind.
    #[must_use]
    pub fn booted_pveo() -> Self {
        Self::booted_as(Setup::new(Kind::PveoCanopen))
    }

    /// A valve with a node ID, booted; its two frames are taken.
    #[must_use]
    pub fn booted_as(setup: Setup) -> Self {
        let mut rig = Self::power_on(setup);
        let node_id = rig.node_id().expect("a node ID");
        rig.expect(&format!("{:03X}: 00", 0x700 + u16::from(node_id)));
        rig.expect(&format!("{:03X}: 00 00 00 00 00 00 00 00", 0x080 + u16::from(node_id)));
        rig
    }

    /// A valve that was just powered up, with a memory that was never written.
    #[must_use]
    pub fn power_on(setup: Setup) -> Self {
        let now = Instant::from_secs(1);
        let device = power_on(setup, &Image::empty(), StartCause::PowerOn, now);
        let mut rig = Self {
            setup,
            device,
            wire: Wire::default(),
            now,
            senses: Senses::default(),
            records: BTreeMap::new(),
            memory_damaged: false,
            writes_fail: false,
            write_time: Duration::from_ticks(0),
            writes: Vec::new(),
            write: None,
            bit_rates: Vec::new(),
        };
        rig.device.sense(&rig.senses, now);
        rig.pump();
        rig
    }

    /// Takes the power away and gives it back: what was being written is lost.
    pub fn power_cycle(&mut self) {
        self.restart_by(StartCause::PowerOn);
    }

    /// The watchdog resets the processor.
    pub fn watchdog_reset(&mut self) {
        self.restart_by(StartCause::Watchdog);
    }

    /// Sends a frame to the device.
    pub fn send(&mut self, text: &str) {
        self.send_frame(frame(text));
    }

    /// Sends a frame to the device, whether its filters let it through or not: the core does not rely on them.
    ///
    /// # Panics
    /// When a frame that the filters keep away means something to the device.
    #[track_caller]
    pub fn send_frame(&mut self, frame: Frame) {
        let passes = !frame.is_remote() && self.filters().iter().any(|filter| filter.passes(&frame));
        let sent = self.wire.sent.len();
        self.wire.received.push_back(frame);
        self.pump();
        assert!(passes || self.wire.sent.len() == sent, "{frame} is answered, but passes no filter");
    }

    /// What the device listens to.
    #[must_use]
    pub fn filters(&self) -> &Filters {
        &self.wire.filters
    }

    /// The next frame that the device has sent.
    pub fn take_next(&mut self) -> Option<Frame> {
        self.wire.sent.pop_front()
    }

    /// Takes all frames that the device has sent, as the manuals print them.
    pub fn take(&mut self) -> Vec<String> {
        self.wire.sent.drain(..).map(|frame| frame.to_string()).collect()
    }

    /// Takes all frames that the device has sent, and returns those under this identifier.
    pub fn take_under(&mut self, id: &str) -> Vec<String> {
        let under = |frame: &String| frame.split_once(':').is_some_and(|(of_frame, _)| of_frame == id);
        self.take().into_iter().filter(under).collect()
    }

    /// The next frame that the device has sent must be this one.
    #[track_caller]
    pub fn expect(&mut self, text: &str) {
        let sent = self.take_next().map(|frame| frame.to_string());
        assert_eq!(sent.as_deref(), Some(text), "at {} us", self.now.as_micros());
    }

    /// The device must have sent nothing more.
    #[track_caller]
    pub fn expect_nothing(&mut self) {
        let sent = self.take();
        assert!(sent.is_empty(), "at {} us: {sent:?}", self.now.as_micros());
    }

    /// Sends a frame; the device must send these, and nothing more.
    #[track_caller]
    pub fn exchange(&mut self, request: &str, answers: &[&str]) {
        self.send(request);
        let sent = self.take();
        assert_eq!(sent, answers, "answers to {request}");
    }

    /// Lets so many milliseconds pass.
    pub fn advance(&mut self, ms: u64) {
        self.advance_by(Duration::from_millis(ms));
    }

    /// Lets time pass, stopping at every deadline of the device and of the memory.
    pub fn advance_by(&mut self, duration: Duration) {
        let end = after(self.now, duration);
        loop {
            let due =
                self.write.as_ref().map_or(self.device.deadline(), |write| write.done.min(self.device.deadline()));
            if due > end {
                break;
            }
            self.now = self.now.max(due);
            self.pump();
        }
        self.now = end;
        self.pump();
    }

    /// Lets so many milliseconds pass, as a machine controller does: with this frame every 100 ms, the first after 100 ms.
    pub fn advance_cyclic(&mut self, ms: u64, text: &str) {
        for _ in 0..ms / CYCLE_MS {
            self.advance(CYCLE_MS);
            self.send(text);
        }
        self.advance(ms % CYCLE_MS);
    }

    /// Lets time pass in one leap: the device is polled at its end alone.
    pub fn leap(&mut self, duration: Duration) {
        self.now = after(self.now, duration);
        self.pump();
    }

    /// Turns the platform's clock back: for a device, time must stand still until it has caught up.
    pub fn turn_back(&mut self, duration: Duration) {
        self.now = Instant::from_ticks(self.now.as_ticks().saturating_sub(duration.as_ticks()));
        self.pump();
    }

    /// Lets time pass in one leap, at whose end a frame comes before the device is polled.
    pub fn leap_to(&mut self, duration: Duration, text: &str) {
        self.now = after(self.now, duration);
        self.send(text);
    }

    /// Changes what the device senses.
    pub fn sense(&mut self, change: impl FnOnce(&mut Senses)) {
        change(&mut self.senses);
        self.device.sense(&self.senses, self.now);
        self.pump();
    }

    /// Holds the bus: nothing can be transmitted until it is released.
    pub fn hold_bus(&mut self, held: bool) {
        self.wire.held = held;
        self.pump();
    }

    /// Asks for everything to be stored.
    pub fn flush(&mut self) {
        self.device.flush(self.now);
        self.pump();
    }

    /// The device.
    #[must_use]
    pub fn device(&self) -> &dyn Device {
        &*self.device
    }

    /// The node ID in force.
    #[must_use]
    pub fn node_id(&self) -> Option<u8> {
        self.device.node_id()
    }

    /// The present instant.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.now
    }

    /// The bit rates that the device has switched to, oldest first.
    #[must_use]
    pub fn bit_rates(&self) -> &[BitRate] {
        &self.bit_rates
    }

    /// Brings the device to ACTIVE by use case 1, with set-point 0, at this instant; its TPDOs are taken.
    ///
    /// # Panics
    /// When it does not get there.
    #[track_caller]
    pub fn activate(&mut self) {
        let node_id = u16::from(self.node_id().expect("a node ID"));
        self.send("000: 01 00");
        for status in ["09", "0B", "0F"] {
            self.send(&format!("{:03X}: 0F 00 00 00", 0x200 + node_id));
            let sent = self.take_next().expect("a TPDO").to_string();
            assert!(sent.starts_with(&format!("{:03X}: {status} 00", 0x180 + node_id)), "{sent}");
        }
        self.expect_nothing();
    }

    /// The status word, read over SDO.
    #[track_caller]
    pub fn status(&mut self) -> u32 {
        self.read(0x6041, 0)
    }

    /// Reads a number over SDO, expedited.
    ///
    /// # Panics
    /// When there is no such answer.
    #[track_caller]
    pub fn read(&mut self, index: u16, sub: u8) -> u32 {
        let answer = self.sdo(0x40, index, sub, 0);
        let bytes = answer.bytes();
        assert!(matches!(bytes[0], 0x43 | 0x47 | 0x4B | 0x4F), "no number: {answer}");
        let [a, b, c, d] = [bytes[4], bytes[5], bytes[6], bytes[7]];
        u32::from_le_bytes([a, b, c, d])
    }

    /// Writes a number of so many bytes over SDO, expedited: `Err` with the abort code.
    ///
    /// # Errors
    /// The abort code.
    ///
    /// # Panics
    /// When there is no answer.
    #[track_caller]
    pub fn write(&mut self, index: u16, sub: u8, size: u8, value: u32) -> Result<(), u32> {
        let answer = self.sdo(0x23 | (4 - size) << 2, index, sub, value);
        match answer.bytes() {
            [0x60, ..] => Ok(()),
            [0x80, _, _, _, code @ ..] => Err(u32::from_le_bytes(*code)),
            _ => panic!("no answer to a download: {answer}"),
        }
    }

    /// The abort code that a read is answered with.
    ///
    /// # Panics
    /// When the read succeeds.
    #[track_caller]
    pub fn read_abort(&mut self, index: u16, sub: u8) -> u32 {
        let answer = self.sdo(0x40, index, sub, 0);
        let bytes = answer.bytes();
        assert_eq!(bytes[0], 0x80, "no abort: {answer}");
        u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]])
    }

    /// Reads an object in segments, whatever its length: its bytes.
    ///
    /// # Errors
    /// The abort code.
    ///
    /// # Panics
    /// When an answer is none of an upload.
    #[track_caller]
    pub fn read_segmented(&mut self, index: u16, sub: u8) -> Result<Vec<u8>, u32> {
        let answer = self.sdo(0x40, index, sub, 0);
        match answer.bytes() {
            [0x80, _, _, _, code @ ..] => return Err(u32::from_le_bytes(*code)),
            [0x41, ..] => {}
            _ => panic!("no segmented upload: {answer}"),
        }
        let mut data = Vec::new();
        for toggle in [0x00, 0x10].into_iter().cycle() {
            let answer = self.sdo(0x60 | toggle, 0, 0, 0);
            let [command, segment @ ..] = answer.bytes();
            assert_eq!(command & 0xF0, toggle, "no segment with this toggle bit: {answer}");
            data.extend(&segment[..7 - usize::from(command >> 1 & 7)]);
            if command & 1 != 0 {
                break;
            }
        }
        Ok(data)
    }

    /// Writes an object in segments, its size announced.
    ///
    /// # Errors
    /// The abort code.
    ///
    /// # Panics
    /// When an answer is none to a download.
    #[track_caller]
    pub fn write_segmented(&mut self, index: u16, sub: u8, data: &[u8]) -> Result<(), u32> {
        let accepted = |answer: Frame| match answer.bytes() {
            [0x60 | 0x20 | 0x30, ..] => Ok(()),
            [0x80, _, _, _, code @ ..] => Err(u32::from_le_bytes(*code)),
            _ => panic!("no answer to a download: {answer}"),
        };
        accepted(self.sdo(0x21, index, sub, u32::try_from(data.len()).expect("a short object")))?;
        let count = data.len().div_ceil(7).max(1);
        for number in 0..count {
            let rest = &data[number * 7..];
            let mut segment = [0; 8];
            let len = rest.len().min(7);
            segment[1..=len].copy_from_slice(&rest[..len]);
            let last = number + 1 == count;
            segment[0] = u8::try_from((number & 1) << 4 | (7 - len) << 1 | usize::from(last)).expect("a byte");
            accepted(self.sdo_bytes(segment))?;
        }
        Ok(())
    }

    /// Maps these objects into the PDO whose communication parameter this is, by the manual's procedure.
    ///
    /// # Panics
    /// When a step is refused.
    #[track_caller]
    pub fn map(&mut self, communication: u16, entries: &[u32]) {
        const OFF: u32 = 0x8000_0000;
        let mapping = communication + 0x200;
        let cob_id = self.read(communication, 1) & !OFF;
        let count = u32::try_from(entries.len()).expect("a few entries");
        let subs = (1..).zip(entries);
        let steps = [(communication, 1, 4, cob_id | OFF), (mapping, 0, 1, 0), (mapping, 0, 1, count)];
        let steps = steps.into_iter().chain(subs.map(|(sub, entry)| (mapping, sub, 4, *entry)));
        for (index, sub, size, value) in steps.chain([(communication, 1, 4, cob_id)]) {
            assert_eq!(self.write(index, sub, size, value), Ok(()), "{index:04X}:{sub} := {value:X}");
        }
    }

    /// Sends an SDO request; the answer.
    ///
    /// # Panics
    /// When there is none.
    #[track_caller]
    pub fn sdo(&mut self, command: u8, index: u16, sub: u8, data: u32) -> Frame {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = data.to_le_bytes();
        self.sdo_bytes([command, low, high, sub, a, b, c, d])
    }

    #[track_caller]
    fn sdo_bytes(&mut self, request: [u8; 8]) -> Frame {
        let node_id = self.node_id().expect("a node ID");
        let id = protocol_core::frame::standard(0x600 | u16::from(node_id));
        self.send_frame(Frame::full(id.into(), request));
        let answer = self.take_next().expect("an SDO answer");
        assert_eq!(answer.id(), protocol_core::frame::standard(0x580 | u16::from(node_id)).into(), "{answer}");
        answer
    }

    fn restart_by(&mut self, cause: StartCause) {
        self.write = None;
        self.wire.sent.clear();
        self.device = power_on(self.setup, &self.image(), cause, self.now);
        self.device.sense(&self.senses, self.now);
        self.pump();
    }

    fn image(&self) -> Image {
        let mut image = Image::empty();
        for (key, record) in &self.records {
            image.put(*key, record);
        }
        if self.memory_damaged {
            image.set_damaged();
        }
        image
    }

    fn pump(&mut self) {
        self.pump_all();
        assert!(self.device.deadline() > self.now, "what was due by {} us is due still", self.now.as_micros());
    }

    fn pump_all(&mut self) {
        loop {
            if let Some(write) = self.write.take_if(|write| write.done <= self.now) {
                let result = if self.writes_fail { Err(StoreError) } else { Ok(()) };
                if result.is_ok() {
                    self.records.insert(write.key, write.record.to_vec());
                    self.writes.push(write.key);
                }
                self.device.stored(write.key, result, self.now);
            }
            match pump(&mut *self.device, &mut self.wire, self.now) {
                None if self.write.as_ref().is_some_and(|write| write.done <= self.now) => {}
                None => return,
                Some(Effect::Store(key, record)) => {
                    assert!(self.write.is_none(), "two writes at once");
                    self.write = Some(Write { key, record, done: after(self.now, self.write_time) });
                }
                Some(Effect::SetBitRate(bit_rate)) => self.bit_rates.push(bit_rate),
                Some(Effect::Restart(scope)) => {
                    let image = self.image();
                    self.device.restart(scope, &image, self.now);
                }
            }
        }
    }
}
