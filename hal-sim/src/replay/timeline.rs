//! The power-up of each recorded device, derived from the device's first frame.

use std::fs;

use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant, after, since};
use protocol_core::wire::cob_id::{Function, classify};

use super::identifier::{is_claim, is_of};
use super::{Refusal, ReplayOptions};
use crate::bus::FrameBits;
use crate::devices::NamedDevice;
use crate::log::{Entry, Timestamp};
use crate::recording::{Logged, ReadError, Reader};
use crate::world::{EventKind, World};

/// The maximum time from power-up to the first frame from a device that sends without a request (A).
const SILENT: Duration = Duration::from_secs(2);

/// The time before the first entry at which a device is powered up if its first frame is not in the log. The device has
/// then booted by the first entry.
const LEAD: Duration = Duration::from_secs(1);

/// The time base of a replay and the power-up of each device.
#[derive(Debug)]
pub(super) struct Timeline {
    /// The log time that corresponds to virtual time 0.
    zero: Timestamp,
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
struct First {
    frame: Frame,
    delay: Duration,
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

    /// Continues the search with a log entry. `first` is the simulated device's first frame. If `exactly`, only an
    /// equal frame is accepted.
    fn look(self, entry: FirstFrame, first: &First, device: &NamedDevice, exactly: bool) -> Self {
        let frame = &entry.frame;
        let is_own =
            !frame.is_remote() && device.setup.node_id.is_some_and(|id| is_of(frame, device.setup.kind.protocol(), id));
        match self {
            Self::Perhaps { spoke: true, .. } if first.frame == *frame => Self::Before,
            _ if first.frame == *frame => Self::Found(entry),
            Self::Perhaps { claim, spoke } => {
                Self::Perhaps { claim, spoke: spoke || (is_own && !is_claim(frame.key())) }
            }
            _ if !exactly && is_like(&first.frame, frame) => {
                if is_claim(frame.key()) {
                    Self::Perhaps { claim: entry, spoke: false }
                } else {
                    Self::Found(entry)
                }
            }
            _ if is_own && !exactly => Self::Before,
            state => state,
        }
    }
}

impl Timeline {
    /// Finds the first frames from the devices in the log and derives the power-ups.
    pub(super) fn find(options: &ReplayOptions) -> Result<Self, Refusal> {
        if !fs::metadata(&options.file)?.is_file() {
            return Err("replay reads the file more than once; use a regular file".into());
        }
        let sought = |device| (device, first_frame(device), Search::Open);
        let mut sought: Vec<(&NamedDevice, Option<First>, Search)> = options.devices.iter().map(sought).collect();
        let mut start = None;
        for entry in Reader::open(&options.file)? {
            let Logged { number, record } = match entry {
                Ok(logged) => logged,
                Err(ReadError::NoEntry { .. }) => continue,
                Err(ReadError::Io(error)) => return Err(error.into()),
            };
            start.get_or_insert((number, record.at));
            let Entry::Frame(frame) = record.entry else { continue };
            for (device, first, search) in &mut sought {
                if let Some(first) = first
                    && !search.is_over()
                {
                    let entry = FirstFrame { number, at: record.at, frame };
                    *search = search.look(entry, first, device, options.from_boot_up);
                }
            }
            if sought.iter().all(|(_, first, search)| first.is_none() || search.is_over()) {
                break;
            }
        }
        let mut start = start.ok_or("no frame to replay")?;
        if let Some((device, ..)) = sought.iter().find(|(_, first, search)| first.is_some() && *search == Search::Open)
        {
            let what = if options.from_boot_up { "boot-up or address claim" } else { "frame" };
            return Err(format!("no {what} from {} in the log", device.name).into());
        }
        if options.from_boot_up {
            let earliest = sought.iter().filter_map(|(.., search)| search.found()).min_by_key(|entry| entry.number);
            start = earliest.map_or(start, |entry| (entry.number, entry.at));
        }
        let power_up = |(_, first, search): &(_, Option<First>, Search)| {
            let (at, before) = match (first, search.found()) {
                (Some(First { delay, .. }), Some(FirstFrame { at, .. })) => (at, *delay),
                _ => (start.1, LEAD),
            };
            at.as_micros().saturating_sub(before.as_micros())
        };
        let power_ups: Vec<u64> = sought.iter().map(power_up).collect();
        // Random delays depend on virtual time. A log that includes the first power-up therefore keeps its time base:
        // virtual time 0 is its first entry.
        let zero = power_ups.iter().copied().chain([start.1.as_micros()]).min().unwrap_or_default();
        let devices = sought.into_iter().zip(power_ups).map(|((_, first, search), at)| PowerUp {
            at: Instant::from_micros(at - zero),
            frame: first.map(|first| first.frame),
            logged: search.found(),
        });
        Ok(Self { zero: Timestamp::from_micros(zero), first: start, power_ups: devices.collect() })
    }

    /// Returns the virtual time of a log entry; `None` for a skipped entry.
    pub(super) fn instant(&self, logged: &Logged) -> Option<Instant> {
        let micros = logged.record.at.as_micros().saturating_sub(self.zero.as_micros());
        (logged.number >= self.first.0).then(|| Instant::from_micros(micros))
    }

    /// Returns the virtual time of the first entry that is not skipped.
    pub(super) fn opened(&self) -> Instant {
        Instant::from_micros(self.first.1.as_micros().saturating_sub(self.zero.as_micros()))
    }

    /// Converts virtual time to log time.
    pub(super) fn time(&self, at: Instant) -> Timestamp {
        self.zero.at(at)
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
/// excluded, because it shares the identifier of the boot-up message.
fn is_like(first: &Frame, frame: &Frame) -> bool {
    let is_heartbeat = matches!(frame.id(), Id::Standard(id) if matches!(classify(id), Some((Function::Heartbeat, _))))
        && matches!(frame.data(), [0x04 | 0x05 | 0x7F]);
    first.key() == frame.key() && !frame.is_remote() && !is_heartbeat
}

/// Determines the first frame from a device by a simulation of the device alone, at its bit rate.
fn first_frame(device: &NamedDevice) -> Option<First> {
    let rate = device.setup.bit_rate.or(device.setup.kind.bit_rates().first().copied())?;
    let mut world = World::new(rate, 0);
    world.record_events(true);
    world.add_gateway("the log");
    let node = world.add(&device.name, device.setup);
    world.power(node, true);
    let start = world.now();
    while world.next_event() <= after(start, SILENT) {
        world.step();
        let first = world.take_events().find_map(|event| match event.what {
            EventKind::Frame { frame, .. } => Some(First { frame, delay: since(event.at, start) }),
            _ => None,
        });
        if first.is_some() {
            return first;
        }
    }
    None
}

/// Returns the length of a frame on the wire, rounded up to microseconds.
pub(super) fn length(frame: &Frame, bits_per_second: u32) -> Duration {
    let bits = u64::from(FrameBits::of(frame).on_wire());
    Duration::from_micros((bits * 1_000_000).div_ceil(bits_per_second.into()))
}
