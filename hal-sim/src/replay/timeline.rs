//! The power-up of each recorded device, derived from the device's first frame.

use std::collections::BTreeMap;
use std::fs;

use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant, after, since};
use protocol_core::wire::cob_id::{Function, classify};

use super::entries::{Entries, micros};
use super::identifier::{is_claim, is_of};
use super::{Refusal, ReplayOptions};
use crate::Memory;
use crate::bus::FrameBits;
use crate::devices::NamedDevice;
use crate::log::{Entry, Timestamp};
use crate::recording::{Logged, ReadError};
use crate::world::{Event, EventKind, World};

/// The maximum time from the start of the application until a device has sent each message that needs no request, and
/// its cyclic message twice (A).
const SILENT: Duration = Duration::from_secs(4);

/// The minimum time from the start of the application to the first entry, if the first frame of a device is not in the
/// log. The device has then booted by the first entry.
const LEAD: Duration = Duration::from_secs(1);

/// The time base of a replay and the power-up of each device.
#[derive(Debug)]
pub(super) struct Timeline {
    /// The log time that corresponds to virtual time 0, in microseconds. Negative if the log begins soon after 0 and a
    /// device was powered up before the log.
    zero: i64,
    /// The number and time of the first entry that is not skipped.
    first: (u64, Timestamp),
    /// The power-up of each device, in the order of the options.
    pub(super) power_ups: Vec<PowerUp>,
}

#[derive(Debug)]
pub(super) struct PowerUp {
    pub(super) at: Instant,
    /// The first frame from the simulated device; `None` for a blank device, which sends no frame without a request.
    pub(super) frame: Option<Frame>,
    /// The first frame of the device in the log: equal to `frame`, or with the same identifier and different data.
    pub(super) logged: Option<FirstFrame>,
}

/// The first frame from a simulated device, and its delay after the power-up.
#[derive(Clone, Copy)]
struct First {
    frame: Frame,
    delay: Duration,
    /// The message that the device repeats without a request; `None` on CANopen.
    cycle: Option<Cycle>,
}

/// A message that a device repeats without a request: AVEF.
#[derive(Clone, Copy)]
struct Cycle {
    /// The identifier, as a [key](Frame::key).
    key: u32,
    /// The delay of the first message after the power-up.
    delay: Duration,
    period: Duration,
}

/// A device whose power-up is sought in the log.
struct Sought<'a> {
    device: &'a NamedDevice,
    first: Option<First>,
    search: Search,
    /// The time of the first cyclic message in the log.
    cyclic: Option<Timestamp>,
}

/// The state of the search for a device's first frame in the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Search {
    /// No entry has been found.
    Open,
    /// The entry has been found.
    Found(FirstFrame),
    /// A claim for the device's address with another NAME has been found. This claim counts as the first frame unless
    /// the device's own claim follows, which shows that a contender sent this claim. `spoke` is true if the address has
    /// since sent a frame other than a claim.
    Perhaps { claim: FirstFrame, spoke: bool },
    /// The log begins after the first frame, because a later frame of the device has been found.
    Before,
}

/// The number, the time and the content of a device's first frame in the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FirstFrame {
    number: u64,
    at: Timestamp,
    pub(super) frame: Frame,
}

impl Search {
    const fn found(self) -> Option<FirstFrame> {
        match self {
            Self::Found(entry) | Self::Perhaps { claim: entry, .. } => Some(entry),
            Self::Open | Self::Before => None,
        }
    }

    const fn is_over(self) -> bool {
        matches!(self, Self::Found(_) | Self::Before)
    }

    /// Continues the search with a log entry. `first` is the simulated device's first frame. If `from_boot_up`, frames
    /// before the first boot-up or address claim are skipped; otherwise they show that the log begins after it.
    fn look(self, entry: FirstFrame, first: &First, device: &NamedDevice, from_boot_up: bool) -> Self {
        let frame = &entry.frame;
        let is_own =
            !frame.is_remote() && device.setup.node_id.is_some_and(|id| is_of(frame, device.setup.kind.protocol(), id));
        match self {
            Self::Perhaps { claim, spoke: true } if first.frame == *frame => {
                if from_boot_up {
                    Self::Found(claim)
                } else {
                    Self::Before
                }
            }
            _ if first.frame == *frame => Self::Found(entry),
            Self::Perhaps { claim, spoke } => {
                Self::Perhaps { claim, spoke: spoke || (is_own && !is_claim(frame.key())) }
            }
            _ if is_like(&first.frame, frame) => {
                if is_claim(frame.key()) {
                    Self::Perhaps { claim: entry, spoke: false }
                } else {
                    Self::Found(entry)
                }
            }
            _ if is_own && !from_boot_up => Self::Before,
            state => state,
        }
    }
}

impl Sought<'_> {
    fn look(&mut self, entry: FirstFrame, from_boot_up: bool) {
        let Some(first) = &self.first else { return };
        if !self.search.is_over() {
            self.search = self.search.look(entry, first, self.device, from_boot_up);
        }
        if first.cycle.is_some_and(|cycle| cycle.key == entry.frame.key()) && !entry.frame.is_remote() {
            self.cyclic.get_or_insert(entry.at);
        }
    }

    fn is_over(&self) -> bool {
        let Some(first) = &self.first else { return true };
        self.search.is_over() && (self.search.found().is_some() || first.cycle.is_none() || self.cyclic.is_some())
    }

    /// Returns the log time of the power-up, in microseconds. A device without its first frame in the log has booted by
    /// `start`, and its cyclic messages have the phase of the log.
    fn power_up(&self, start: Timestamp) -> i64 {
        if let (Some(first), Some(entry)) = (&self.first, self.search.found()) {
            return micros(entry.at) - micros_of(first.delay);
        }
        let latest = micros(start) - micros_of(LEAD + self.device.electronics.boot);
        let cycle = self.first.and_then(|first| first.cycle).filter(|cycle| cycle.period > Duration::from_ticks(0));
        let (Some(cycle), Some(at)) = (cycle, self.cyclic) else { return latest };
        let at_first_message = micros(at) - micros_of(cycle.delay);
        let (early, period) = ((at_first_message - latest).max(0), micros_of(cycle.period));
        at_first_message - (early + period - 1) / period * period
    }
}

impl Timeline {
    /// Finds the first frames from the devices in the log and derives the power-ups.
    pub(super) fn find(options: &ReplayOptions) -> Result<Self, Refusal> {
        if !fs::metadata(&options.file)?.is_file() {
            return Err("replay reads the file more than once; use a regular file".into());
        }
        let sought = |device| Sought { device, first: first_frame(device), search: Search::Open, cyclic: None };
        let mut sought: Vec<Sought<'_>> = options.devices.iter().map(sought).collect();
        let mut start = None;
        for entry in Entries::open(&options.file)? {
            let Logged { number, record } = match entry {
                Ok(placed) => placed.logged,
                Err(ReadError::NoEntry { .. }) => continue,
                Err(ReadError::Io(error)) => return Err(error.into()),
            };
            start.get_or_insert((number, record.at));
            let Entry::Frame(frame) = record.entry else { continue };
            let entry = FirstFrame { number, at: record.at, frame };
            sought.iter_mut().for_each(|device| device.look(entry, options.from_boot_up));
            if sought.iter().all(Sought::is_over) {
                break;
            }
        }
        let mut start = start.ok_or("no frame to replay")?;
        if let Some(silent) = sought.iter().find(|device| device.first.is_some() && device.search == Search::Open) {
            let what = if options.from_boot_up { "boot-up or address claim" } else { "frame" };
            return Err(format!("no {what} from {} in the log", silent.device.name).into());
        }
        if options.from_boot_up {
            let earliest = sought.iter().filter_map(|device| device.search.found()).min_by_key(|entry| entry.number);
            start = earliest.map_or(start, |entry| (entry.number, entry.at));
        }
        let power_ups: Vec<i64> = sought.iter().map(|device| device.power_up(start.1)).collect();
        // Random delays depend on virtual time. A log that includes the first power-up therefore keeps its time base:
        // virtual time 0 is its first entry.
        let zero = power_ups.iter().copied().chain([micros(start.1)]).min().unwrap_or_default();
        let devices = sought.into_iter().zip(power_ups).map(|(device, at)| PowerUp {
            at: instant_since(zero, at),
            frame: device.first.map(|first| first.frame),
            logged: device.search.found(),
        });
        Ok(Self { zero, first: start, power_ups: devices.collect() })
    }

    /// Returns the virtual time of a log entry; `None` for a skipped entry.
    pub(super) fn instant(&self, logged: &Logged) -> Option<Instant> {
        (logged.number >= self.first.0).then(|| instant_since(self.zero, micros(logged.record.at)))
    }

    /// Returns the virtual time of the first entry that is not skipped.
    pub(super) fn opened(&self) -> Instant {
        instant_since(self.zero, micros(self.first.1))
    }

    /// Converts virtual time to log time. A time before 1970 becomes the start of 1970. `shifts` are the shifts of the
    /// log time, with the times from which they apply.
    pub(super) fn time(&self, at: Instant, shifts: &[(Instant, i64)]) -> Timestamp {
        let shift = shifts.iter().rev().find(|(from, _)| *from <= at).map_or(0, |(_, shift)| *shift);
        Timestamp::from_micros(at.as_micros().saturating_add_signed(self.zero.saturating_sub(shift)))
    }

    /// Returns whether a log entry contains the first frame from a device.
    pub(super) fn is_first(&self, number: u64) -> bool {
        self.power_ups.iter().any(|device| device.logged.is_some_and(|entry| entry.number == number))
    }

    /// Returns the number of the entry with each device's first frame; `None` for a device powered up before the log.
    pub(super) fn entries(&self) -> Vec<Option<u64>> {
        self.power_ups.iter().map(|device| device.logged.map(|entry| entry.number)).collect()
    }
}

/// Returns whether a frame may be the first frame with other data, because it has the same identifier. A heartbeat is
/// excluded, because it shares the identifier of the boot-up message; so is an answer to node guarding, with its toggle
/// bit.
fn is_like(first: &Frame, frame: &Frame) -> bool {
    let is_heartbeat = matches!(frame.id(), Id::Standard(id) if matches!(classify(id), Some((Function::Heartbeat, _))))
        && matches!(frame.data(), [state] if matches!(state & 0x7F, 0x04 | 0x05 | 0x7F));
    first.key() == frame.key() && !frame.is_remote() && !is_heartbeat
}

fn micros_of(time: Duration) -> i64 {
    i64::try_from(time.as_micros()).unwrap_or(i64::MAX)
}

/// Returns the virtual time of a log time, for a world that started at `zero`; 0 for an earlier time.
fn instant_since(zero: i64, at: i64) -> Instant {
    Instant::from_micros(u64::try_from(at.saturating_sub(zero)).unwrap_or(0))
}

/// Determines the first frame from a device by a simulation of the device alone, at its bit rate.
fn first_frame(device: &NamedDevice) -> Option<First> {
    let rate = device.setup.bit_rate.or(device.setup.kind.bit_rates().first().copied())?;
    let mut world = World::new(rate, 0);
    world.record_events(true);
    world.add_gateway("the log");
    let node = device.add_to(&mut world, Memory::in_ram());
    world.power(node, true);
    let (start, mut first) = (world.now(), None);
    let mut delays = BTreeMap::new();
    while world.next_event() <= after(start, SILENT + device.electronics.boot) {
        world.step();
        for Event { at, what, .. } in world.take_events() {
            let EventKind::Frame { frame, .. } = what else { continue };
            let (key, delay) = (frame.key(), since(at, start));
            let first = first.get_or_insert(First { frame, delay, cycle: None });
            if let Some(earlier) = delays.insert(key, delay) {
                return Some(First { cycle: Some(Cycle { key, delay: earlier, period: delay - earlier }), ..*first });
            }
        }
    }
    first
}

/// Returns the length of a frame on the wire, rounded up to microseconds.
pub(super) fn length(frame: &Frame, bits_per_second: u32) -> Duration {
    let bits = u64::from(FrameBits::of(frame).on_wire());
    Duration::from_micros((bits * 1_000_000).div_ceil(bits_per_second.into()))
}
