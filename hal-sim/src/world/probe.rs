//! A simple device for tests: a heartbeat, an echo, and commands that request each effect.

use protocol_core::controller::{BitRate, Filter, Filters};
use protocol_core::device::{Device, Effect, Inputs, Outputs, Restart, StartCause, View, Viewable};
use protocol_core::frame::{Frame, standard};
use protocol_core::memory::{Image, Memory, RecordKey, StoreError, open, seal};
use protocol_core::time::{Duration, Instant, NEVER, after};

use super::SimDevice;

/// The base identifier of echo requests; the node ID is added. The base identifier of the answers is [`ECHO_ANSWER`].
pub(crate) const ECHO: u16 = 0x600;
pub(crate) const ECHO_ANSWER: u16 = 0x580;
/// The identifier of a [`Command`]; byte 1 contains the node ID.
pub(crate) const COMMAND: u16 = 0x000;
/// The base identifier of command result reports; the node ID is added.
pub(crate) const DONE: u16 = 0x080;
pub(crate) const HEARTBEAT: u16 = 0x700;

/// Byte 0 of a command.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Command {
    /// Stores bytes 2… as the parameters.
    Store = 1,
    /// Stores bytes 2… as the fault log.
    Log = 2,
    /// Sets the bit rate with the table index in byte 2.
    Rate = 3,
    /// Restarts the device.
    Restart = 4,
    /// Stores bytes 2… when flushed.
    Later = 5,
    /// Drops the number of frames in byte 2.
    Drop = 6,
}

#[derive(Clone)]
pub(crate) struct Probe {
    pub(crate) id: u8,
    pub(crate) rate: BitRate,
    pub(crate) period: Option<Duration>,
    pub(crate) beat_at: Instant,
    pub(crate) out: Vec<Frame>,
    pub(crate) effects: Vec<Effect>,
    pub(crate) later: Option<Effect>,
    pub(crate) inputs: Inputs,
    pub(crate) heard: u32,
    pub(crate) restarts: u32,
    pub(crate) cause: StartCause,
    pub(crate) parameters: Option<Vec<u8>>,
    pub(crate) damaged: bool,
    pub(crate) stored: Vec<(RecordKey, Result<(), StoreError>, Instant)>,
    pub(crate) dropped: u32,
}

/// The configuration of a [`Probe`].
#[derive(Clone, Copy)]
pub(crate) struct Plan {
    pub(crate) id: u8,
    pub(crate) rate: BitRate,
    pub(crate) period: Option<Duration>,
}

impl Plan {
    pub(crate) fn new(id: u8, rate: BitRate) -> Self {
        Self { id, rate, period: None }
    }

    pub(crate) fn beating(self, period: Duration) -> Self {
        Self { period: Some(period), ..self }
    }

    pub(crate) fn factory(self) -> impl Fn(&Image, StartCause, Instant) -> Box<dyn SimDevice> + Send + Sync + 'static {
        move |image, cause, now| Box::new(Probe::start(self, image, cause, now))
    }
}

impl Probe {
    fn start(plan: Plan, image: &Image, cause: StartCause, now: Instant) -> Self {
        let Plan { id, rate, period } = plan;
        Self {
            id,
            rate,
            period,
            beat_at: if period.is_some() { now } else { NEVER },
            out: Vec::new(),
            effects: Vec::new(),
            later: None,
            inputs: Inputs::default(),
            heard: 0,
            restarts: 0,
            cause,
            parameters: parameters(image),
            damaged: image.is_damaged(),
            stored: Vec::new(),
            dropped: 0,
        }
    }

    fn command(&mut self, command: u8, data: &[u8]) {
        let store = |key| Effect::Store(key, seal(1, data).unwrap());
        match command {
            1 => self.effects.push(store(RecordKey::Parameters)),
            2 => self.effects.push(store(RecordKey::FaultLog)),
            3 => self.effects.push(Effect::SetBitRate(BitRate::from_table_index(data[0]).unwrap())),
            4 => self.effects.push(Effect::Restart(Restart::Application)),
            6 => self.dropped += u32::from(data[0]),
            5 => self.later = Some(store(RecordKey::Parameters)),
            _ => {}
        }
        // The report goes out before the effect.
        self.out.push(Frame::of(standard(DONE + u16::from(self.id)).into(), &[command]).unwrap());
    }
}

fn parameters(memory: &dyn Memory) -> Option<Vec<u8>> {
    let sealed = memory.sealed(RecordKey::Parameters).unwrap_or(None);
    sealed.and_then(|record| open(1, record)).map(<[u8]>::to_vec)
}

/// Returns the command frame for a node.
pub(crate) fn command(command: Command, id: u8, data: &[u8]) -> Frame {
    Frame::of(standard(COMMAND).into(), &[&[command as u8, id], data].concat()).unwrap()
}

impl Viewable for Probe {
    fn view(&self, _: Instant) -> View {
        View {
            node_id: Some(self.id),
            bit_rate: self.rate,
            nmt: None,
            position: 0,
            valve: None,
            faults: [].into_iter().collect(),
        }
    }
}

impl Device for Probe {
    fn handle(&mut self, frame: &Frame, _: Instant) -> bool {
        self.heard += 1;
        let id = match frame.id() {
            embedded_can::Id::Standard(id) => id.as_raw(),
            embedded_can::Id::Extended(_) => return true,
        };
        if id == ECHO + u16::from(self.id) {
            self.out.push(Frame::of(standard(ECHO_ANSWER + u16::from(self.id)).into(), frame.data()).unwrap());
        } else if id == COMMAND && frame.data()[1] == self.id {
            self.command(frame.data()[0], &frame.data()[2..]);
        }
        true
    }

    /// Returns `None`: a probe has no filters.
    fn take_filters(&mut self) -> Option<Filters> {
        None
    }

    fn sense(&mut self, inputs: &Inputs, _: Instant) {
        self.inputs = *inputs;
    }

    fn poll(&mut self, now: Instant) {
        if let Some(period) = self.period
            && now >= self.beat_at
        {
            self.beat_at = after(self.beat_at, period);
            self.out.push(Frame::of(standard(HEARTBEAT + u16::from(self.id)).into(), &[5]).unwrap());
        }
    }

    fn take_abort(&mut self) -> Option<Filter> {
        None
    }

    fn next_frame(&mut self, _: Instant) -> Option<Frame> {
        let urgent =
            self.out.iter().enumerate().min_by_key(|(_, frame)| frame.arbitration()).map(|(place, _)| place)?;
        Some(self.out.remove(urgent))
    }

    fn give_back(&mut self, frame: Frame) {
        self.out.insert(0, frame);
    }

    fn all_sent(&mut self, _: Instant) -> bool {
        !self.out.is_empty()
    }

    fn sent_except(&mut self, _: &dyn Fn(Filter) -> bool, _: Instant) {}

    /// Returns the requested effects in order, once all frames are sent.
    fn next_effect(&mut self, all_sent: bool) -> Option<Effect> {
        (all_sent && !self.effects.is_empty()).then(|| self.effects.remove(0))
    }

    fn stored(&mut self, key: RecordKey, result: Result<(), StoreError>, now: Instant) {
        self.stored.push((key, result, now));
    }

    fn restart(&mut self, _: Restart, memory: &dyn Memory, _: Instant) {
        self.restarts += 1;
        self.parameters = parameters(memory);
    }

    fn flush(&mut self, _: Instant) {
        self.effects.extend(self.later.take());
    }

    fn deadline(&self) -> Instant {
        self.beat_at
    }

    fn outputs(&self) -> Outputs {
        Outputs::Encoder
    }

    fn bit_rate(&self) -> BitRate {
        self.rate
    }

    fn node_id(&self) -> Option<u8> {
        Some(self.id)
    }

    fn frames_dropped(&self) -> u32 {
        self.dropped
    }
}
