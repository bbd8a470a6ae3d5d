//! Disturbances of a device at any time, for random tests: time, bus, memory and power, and frames to a CANopen node.

use std::fmt::Debug;

use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BusErrorMode;
use protocol_core::frame::{Frame, Id, extended, standard};
use protocol_core::memory::RecordKey;
use protocol_core::time::Duration;

use crate::Rig;

/// A disturbance of the device.
#[derive(Clone, Debug)]
pub enum Disturbance {
    /// A number of milliseconds passes.
    Advance(u64),
    /// A number of microseconds passes without a poll of the device.
    Leap(u64),
    /// The clock is set back by a number of milliseconds.
    TurnBack(u64),
    /// The bus is held or released.
    HoldBus(bool),
    /// Writes fail or succeed from now on.
    WritesFail(bool),
    /// A write takes a number of milliseconds from now on.
    WriteTime(u64),
    /// The platform requests all delayed writes.
    Flush,
    /// The power is off for a moment.
    PowerCycle,
    /// The watchdog resets the processor.
    WatchdogReset,
    /// The next start finds the entire memory damaged, or does not.
    MemoryDamaged(bool),
    /// A bit of a record flips.
    Rot(RecordKey, usize, u8),
    /// The CAN controller enters this error mode.
    Bus(BusErrorMode),
    /// An internal fault is injected or removed.
    Internal(bool),
    /// An internal fault is injected and removed a number of times.
    Toggle(usize),
    /// The temperature of a valve becomes too high or normal.
    Hot(bool),
    /// The supply of a valve becomes too low or normal.
    SupplyLow(bool),
    /// Another node sends a frame.
    Send(&'static str),
    /// Another node sends a frame a number of times.
    Burst(usize, &'static str),
    /// A number of milliseconds passes, with a frame every 100 ms.
    Cyclic(u64, &'static str),
}

impl Disturbance {
    /// Returns any disturbance. Most times are short.
    pub fn any() -> impl Strategy<Value = Self> {
        let ms = || prop_oneof![4 => 0..=60_u64, 2 => 0..=600_u64, 1 => 0..=6000_u64];
        prop_oneof![
            12 => ms().prop_map(Self::Advance),
            4 => prop_oneof![4 => ms().prop_map(|ms| ms * 1000), 1 => 0..=1_u64 << 40].prop_map(Self::Leap),
            1 => ms().prop_map(Self::TurnBack),
            2 => any::<bool>().prop_map(Self::HoldBus),
            2 => any::<bool>().prop_map(Self::WritesFail),
            2 => ms().prop_map(Self::WriteTime),
            1 => Just(Self::Flush),
            1 => Just(Self::PowerCycle),
            1 => Just(Self::WatchdogReset),
            1 => prop::bool::weighted(0.2).prop_map(Self::MemoryDamaged),
            1 => (select(&RecordKey::ALL[..]), any::<usize>(), 0..8_u8).prop_map(|(key, at, bit)| Self::Rot(key, at, bit)),
        ]
    }

    /// Returns a change to bus-off or error-active.
    pub fn bus_off() -> impl Strategy<Value = Self> {
        select(&[BusErrorMode::ErrorActive, BusErrorMode::BusOff][..]).prop_map(Self::Bus)
    }

    /// Returns a change of a fault of a valve.
    pub fn faults() -> impl Strategy<Value = Self> {
        prop_oneof![
            4 => any::<bool>().prop_map(Self::Internal),
            1 => (1..30_usize).prop_map(Self::Toggle),
            2 => any::<bool>().prop_map(Self::Hot),
            1 => any::<bool>().prop_map(Self::SupplyLow),
        ]
    }

    /// Returns the number of milliseconds in which the device can send cyclic frames.
    #[must_use]
    pub const fn passes_ms(&self) -> u64 {
        if let Self::Advance(ms) = self { *ms } else { 0 }
    }

    /// Applies the disturbance.
    pub fn act(&self, rig: &mut Rig) {
        match self {
            Self::Advance(ms) => rig.advance(*ms),
            Self::Leap(us) => rig.leap(Duration::from_micros(*us)),
            Self::TurnBack(ms) => rig.turn_back(Duration::from_millis(*ms)),
            Self::HoldBus(held) => rig.hold_bus(*held),
            Self::WritesFail(fail) => rig.writes_fail = *fail,
            Self::WriteTime(ms) => rig.write_time = Duration::from_millis(*ms),
            Self::Flush => rig.flush(),
            Self::PowerCycle => rig.power_cycle(),
            Self::WatchdogReset => rig.watchdog_reset(),
            Self::MemoryDamaged(damaged) => rig.memory_damaged = *damaged,
            Self::Rot(key, at, bit) => {
                if let Some(record) = rig.records.get_mut(key).filter(|record| !record.is_empty()) {
                    let at = at % record.len();
                    record[at] ^= 1 << bit;
                }
            }
            Self::Bus(mode) => rig.sense_hat(|inputs| inputs.bus = *mode),
            Self::Internal(there) => rig.sense_hat(|inputs| inputs.internal_fault = *there),
            Self::Toggle(times) => (0..*times).for_each(|_| rig.internal_fault_comes_and_goes()),
            Self::Hot(there) => rig.sense(|inputs| inputs.temperature_c = if *there { 130 } else { 25 }),
            Self::SupplyLow(there) => rig.sense(|inputs| inputs.supply_mv = if *there { 8_000 } else { 24_000 }),
            Self::Send(text) => rig.send(text),
            Self::Burst(times, text) => (0..*times).for_each(|_| rig.send(text)),
            Self::Cyclic(ms, text) => rig.advance_cyclic(*ms, text),
        }
    }
}

/// A request, or a disturbance.
#[derive(Clone, Debug)]
pub enum Asked {
    /// The request with this number in a list.
    Request(usize),
    /// A disturbance.
    Other(Disturbance),
}

/// Sends requests, each with its answer, amid disturbances, and frees the bus by `free`. Each request must be answered
/// once, or counted as dropped.
///
/// # Panics
/// Panics if a request is answered twice, or if more answers are missing than were counted.
#[track_caller]
pub fn answered_or_counted(rig: &mut Rig, requests: &[(&str, &str)], events: &[Asked], free: impl FnOnce(&mut Rig)) {
    let (mut asked, mut sent) = (vec![0_usize; requests.len()], Vec::new());
    for event in events {
        match event {
            Asked::Request(number) => {
                asked[*number] += 1;
                rig.send(requests[*number].0);
            }
            Asked::Other(disturbance) => disturbance.act(rig),
        }
        sent.extend(rig.take());
    }
    free(rig);
    sent.extend(rig.take());
    let missing = requests.iter().zip(asked).map(|((request, answer), asked)| {
        let answered = sent.iter().filter(|frame| frame == answer).count();
        assert!(answered <= asked, "{request}: asked {asked} times, answered {answered} times");
        asked - answered
    });
    let (missing, dropped) = (missing.sum::<usize>(), usize::try_from(rig.device().frames_dropped()).expect("a few"));
    assert!(missing <= dropped, "{missing} answers are missing, {dropped} frames dropped");
}

/// Waits until nothing silences the device: neither the write in progress nor the delays of LSS.
pub fn let_be(rig: &mut Rig) {
    /// The maximum of each of the two delays for which LSS silences a device.
    const LSS_DELAY_MAX: Duration = Duration::from_millis(0xFFFF);
    rig.writes_fail = false;
    rig.write_time = Duration::from_ticks(0);
    rig.memory_damaged = false;
    rig.hold_bus(false);
    for _ in 0..3 {
        rig.leap(LSS_DELAY_MAX);
    }
}

/// The destination of a frame.
#[derive(Clone, Copy, Debug)]
pub enum To {
    /// A function of the predefined connection set, with the node ID of the device.
    Own(u16),
    /// An identifier.
    Any(Id),
}

impl To {
    /// Returns the identifier for a device with this node ID.
    #[must_use]
    pub fn id(self, node_id: u16) -> Id {
        match self {
            Self::Own(function) => standard(function + node_id).into(),
            Self::Any(id) => id,
        }
    }
}

/// Returns a known value or, seldom, any other.
pub fn mostly<T: Arbitrary + Clone + Debug + 'static>(known: &'static [T]) -> impl Strategy<Value = T> {
    prop_oneof![9 => select(known), 1 => any::<T>()]
}

/// Returns the data of an SDO request, mostly for one of these indices.
pub fn sdo(index: &'static [u16], value: impl Strategy<Value = u32>) -> impl Strategy<Value = [u8; 8]> {
    const COMMANDS: &[u8] =
        &[0x40, 0x22, 0x23, 0x27, 0x2B, 0x2F, 0x21, 0x20, 0x60, 0x70, 0x00, 0x10, 0x0B, 0x1D, 0x80, 0xA0, 0xC0];
    let sub = prop_oneof![9 => 0..=8_u8, 1 => any::<u8>()];
    (mostly(COMMANDS), mostly(index), sub, value).prop_map(|(command, index, sub, value)| {
        let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value.to_le_bytes());
        [command, low, high, sub, a, b, c, d]
    })
}

/// Returns the data of an LSS request, mostly with one of these beginnings after the command.
pub fn lss(commands: &'static [u8], first: &'static [[u8; 2]]) -> impl Strategy<Value = [u8; 8]> {
    let rest = prop_oneof![
        4 => select(first).prop_map(|[a, b]| [a, b, 0, 0, 0, 0, 0]),
        1 => any::<[u8; 7]>(),
    ];
    (mostly(commands), rest).prop_map(|(command, [a, b, c, d, e, f, g])| [command, a, b, c, d, e, f, g])
}

/// Returns an NMT command to all nodes, or to one of these.
pub fn nmt(nodes: &'static [u8]) -> impl Strategy<Value = (To, u8, [u8; 8])> {
    (select(&[0x01, 0x02, 0x80, 0x81, 0x82, 0x03][..]), select(nodes))
        .prop_map(|(command, node)| (To::Any(standard(0).into()), 2, [command, node, 0, 0, 0, 0, 0, 0]))
}

/// Returns any frame with any destination.
pub fn anything() -> impl Strategy<Value = (To, u8, [u8; 8])> {
    let to = prop_oneof![
        (0..=0x7FF_u16).prop_map(|id| To::Any(standard(id).into())),
        (0..=0x1FFF_FFFF_u32).prop_map(|id| To::Any(extended(id).into())),
        select(&[0x080, 0x180, 0x200, 0x580, 0x600, 0x700][..]).prop_map(To::Own),
    ];
    (to, 0..=8_u8, any::<[u8; 8]>())
}

/// Returns the frame, seldom with another length, and seldom as a remote frame.
pub fn distorted(frame: impl Strategy<Value = (To, u8, [u8; 8])>) -> impl Strategy<Value = (To, bool, u8, [u8; 8])> {
    let other_len = prop_oneof![9 => Just(None), 1 => (0..=8_u8).prop_map(Some)];
    (frame, other_len, prop::bool::weighted(0.03))
        .prop_map(|((to, len, data), other_len, remote)| (to, remote, other_len.unwrap_or(len), data))
}

/// Sends a frame to a device. Without a node ID the device is addressed by `default`.
pub fn send(rig: &mut Rig, (to, remote, len, data): (To, bool, u8, [u8; 8]), default: u16) {
    let id = to.id(rig.node_id().map_or(default, u16::from));
    rig.send_frame(if remote { Frame::remote(id, len) } else { Frame::with_len(id, data, len) });
}

/// Reads a number, if the device answers. Every sent frame is checked.
pub fn read(rig: &mut Rig, index: u16, check: fn(&Frame)) -> Option<u32> {
    let node_id = u16::from(rig.node_id()?);
    let [low, high] = index.to_le_bytes();
    rig.send_frame(Frame::full(standard(0x600 | node_id).into(), [0x40, low, high, 0, 0, 0, 0, 0]));
    let mut number = None;
    while let Some(frame) = rig.take_next() {
        check(&frame);
        let &[command, answered_low, answered_high, 0, a, b, c, d] = frame.bytes() else { continue };
        let answers = frame.id() == standard(0x580 | node_id).into() && (answered_low, answered_high) == (low, high);
        if answers && matches!(command, 0x43 | 0x4B | 0x4F) {
            number = Some(u32::from_le_bytes([a, b, c, d]));
        }
    }
    number
}

/// Checks a frame under an identifier of the predefined connection set. PDOs and EMCYs may have any identifier that no
/// other service has.
pub fn check_services(frame: &Frame) {
    assert!(!frame.is_remote(), "{frame}");
    let Id::Standard(id) = frame.id() else { return };
    let data = frame.data();
    match id.as_raw() {
        0x701..=0x77F => assert!(matches!(data, [0x00 | 0x04 | 0x05 | 0x7F]), "an NMT state: {frame}"),
        0x581..=0x5FF => assert!(data.len() == 8 && matches!(data[0] >> 5, 0..=4), "an SDO answer: {frame}"),
        0x7E4 => assert_eq!(data.len(), 8, "an LSS answer: {frame}"),
        0x000..=0x07F | 0x601..=0x67F | 0x6E0..=0x6FF | 0x780..=0x7FF => panic!("not a device's: {frame}"),
        _ => {}
    }
}
