//! Faults of the communication, as they are asked for: which frames, when, how often, and what happens to them.

use std::sync::Arc;

use protocol_core::frame::{Frame, Id, MAX_LEN, extended, key, standard};
use protocol_core::time::Duration;

/// The longest list of faults.
pub const MAX_FAULTS: usize = 64;

/// The most copies that [`FaultKind::Repeat`] sends of a frame.
pub const MAX_REPEATS: u32 = 1000;

/// The probability of what always happens, in millionths.
pub const ALWAYS: u32 = 1_000_000;

/// The longest time of a fault.
const LONGEST_TIME: Duration = Duration::from_secs(24 * 60 * 60);

/// The bits of the longest identifier.
const LONGEST: u32 = 0x1FFF_FFFF;

/// A fault of the communication on a bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The name of the fault, one of its own among those that are active.
    pub name: Arc<str>,
    /// What happens to the frames.
    pub kind: FaultKind,
    /// The frames that it can happen to.
    pub frames: FrameFilter,
    /// The number of frames that it happens to; without it, all until the fault ends.
    pub count: Option<u32>,
    /// The probability that it happens to a frame, in millionths, up to [`ALWAYS`].
    pub probability: u32,
    /// The seed of the random choices.
    pub seed: u64,
    /// The time until the fault begins.
    pub from: Duration,
    /// The time from its begin to its end; without it, the fault stays until it is ended.
    pub lasts: Option<Duration>,
}

/// The frames that a fault can happen to: all conditions hold.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameFilter {
    /// The identifier; without it, any.
    pub id: Option<Id>,
    /// The bits of the identifier that are compared; without it, all.
    pub mask: Option<u32>,
    /// The device or client that sends the frame; without it, any.
    pub sender: Option<Arc<str>>,
}

/// What happens to a frame.
///
/// [`Lose`](Self::Lose) acts between the controllers that received a frame and their applications,
/// [`Destroy`](Self::Destroy) and [`Omit`](Self::Omit) on the wire, [`Insert`](Self::Insert) by a controller of its own,
/// and all others between the application that sends the frame and its controller: not at controllers that live
/// elsewhere, whose application is not in this world.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FaultKind {
    /// The receivers do not get the frame; it is on the bus, and acknowledged.
    Lose {
        /// Who does not get it: devices and clients by name; all when empty.
        receivers: Vec<Arc<str>>,
    },
    /// The frame goes to the controller later.
    Delay {
        /// How much later.
        delay: Delay,
        /// Later frames of the same identifier do not wait behind it.
        overtake: bool,
    },
    /// The frame is sent again.
    Repeat {
        /// The number of copies, from 1 to [`MAX_REPEATS`].
        times: u32,
        /// The time from one to the next.
        after: Duration,
    },
    /// The frame is exchanged with the next one of its sender. It follows that one at once, also if it was delayed.
    Swap {
        /// The longest wait for the next one: without it the frame is sent then.
        within: Duration,
    },
    /// The frame is sent with other content and the right checksum.
    Corrupt(Corruption),
    /// A frame that nobody sent; the frames that pass do not matter.
    Insert {
        /// The frame.
        frame: Frame,
        /// The time from one to the next; without it, the frame is sent once.
        every: Option<Duration>,
    },
    /// A bit error destroys the attempt to send the frame, which the controller repeats.
    Destroy,
    /// An error in the last but one bit of the end of frame, which only some receivers see: they do not have the frame,
    /// all others do, and its sender repeats it.
    Omit {
        /// The receivers that see the error: devices and clients by name.
        receivers: Vec<Arc<str>>,
    },
}

/// The time by which a frame is late.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delay {
    /// The same for every frame.
    Constant(Duration),
    /// Equally likely between two bounds, both included.
    Uniform(Duration, Duration),
    /// Until the next multiple of a period, from the begin of the fault on: frames gather, and come in bursts.
    Burst(Duration),
}

/// The change of a frame's content.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Corruption {
    /// Changes of the identifier.
    pub id: Masks<u32>,
    /// Changes of the data length code; a result above 8 is taken for 8, new bytes are 0.
    pub dlc: Masks<u8>,
    /// Changes of the data, whose first byte is the first one here.
    pub data: Masks<[u8; MAX_LEN]>,
}

/// Bits that are set, then those that are cleared, then those that are toggled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Masks<T> {
    /// Bits that become 1.
    pub set: T,
    /// Bits that become 0.
    pub clear: T,
    /// Bits that change.
    pub toggle: T,
}

/// What a fault did to a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FaultEffect {
    /// These receivers do not get it; all when there are none.
    Lost(Vec<Arc<str>>),
    /// It goes to the controller so much later.
    Delayed(Duration),
    /// It is sent so many times more.
    Repeated(u32),
    /// It waits for the next one of its sender.
    Swapped,
    /// This is sent in its place.
    Corrupted(Frame),
    /// It was inserted.
    Inserted,
    /// Its attempt is destroyed.
    Destroyed,
    /// These receivers do not have it; all others do, and its sender repeats it.
    Omitted(Vec<Arc<str>>),
}

/// Why a fault cannot be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FaultError {
    /// Another active fault has this name.
    #[error("a fault named '{0}' is active")]
    Taken(Arc<str>),
    /// No more than [`MAX_FAULTS`] at a time.
    #[error("{MAX_FAULTS} faults are active: end one first")]
    TooMany,
    /// Nobody on the bus has this name.
    #[error("no device or client '{name}'; there are: {known}")]
    Unknown {
        /// The name.
        name: Arc<str>,
        /// The names that there are.
        known: String,
    },
    /// A value out of its range.
    #[error("{0}")]
    Invalid(&'static str),
}

impl Fault {
    /// Returns a fault of all frames, from now on until it is ended.
    #[must_use]
    pub fn new(name: &str, kind: FaultKind) -> Self {
        Self {
            name: name.into(),
            kind,
            frames: FrameFilter::default(),
            count: None,
            probability: ALWAYS,
            seed: 0,
            from: Duration::from_ticks(0),
            lasts: None,
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`FaultError::Invalid`]
    pub fn check(&self) -> Result<(), FaultError> {
        let refuse = |reason| Err(FaultError::Invalid(reason));
        if self.probability > ALWAYS {
            return refuse("the probability is above 1");
        }
        if self.count == Some(0) {
            return refuse("count 0: the fault would never happen");
        }
        if self.lasts.is_some_and(|lasts| lasts.as_ticks() == 0) {
            return refuse("the fault would end as it begins");
        }
        if self.frames.mask.is_some() && self.frames.id.is_none() {
            return refuse("a mask without an identifier");
        }
        if self.times().into_iter().flatten().any(|time| time > LONGEST_TIME) {
            return refuse("a time of a fault is a day at most");
        }
        match &self.kind {
            FaultKind::Delay { delay: Delay::Uniform(from, to), .. } if from > to => {
                refuse("the bounds of the delay are the wrong way round")
            }
            FaultKind::Delay { delay: Delay::Burst(period), .. } if period.as_ticks() == 0 => {
                refuse("a burst has a period above 0")
            }
            FaultKind::Repeat { times, .. } if !(1..=MAX_REPEATS).contains(times) => {
                refuse("a frame is repeated 1 to 1000 times")
            }
            FaultKind::Corrupt(corruption) if *corruption == Corruption::default() => refuse("nothing to corrupt"),
            FaultKind::Insert { every: Some(every), .. } if every.as_ticks() == 0 => {
                refuse("a cyclic frame has a period above 0")
            }
            FaultKind::Insert { every: None, .. } if self.count.is_some() => {
                refuse("a frame that is inserted once has no count")
            }
            FaultKind::Insert { .. } if self.frames != FrameFilter::default() => {
                refuse("an inserted frame has no filter")
            }
            FaultKind::Omit { receivers } if receivers.is_empty() => {
                refuse("name the receivers that do not have the frame")
            }
            _ => Ok(()),
        }
    }

    /// Returns all times in it.
    fn times(&self) -> [Option<Duration>; 3] {
        let of_kind = match &self.kind {
            FaultKind::Delay {
                delay: Delay::Constant(time) | Delay::Uniform(_, time) | Delay::Burst(time), ..
            }
            | FaultKind::Repeat { after: time, .. }
            | FaultKind::Swap { within: time } => Some(*time),
            FaultKind::Insert { every, .. } => *every,
            _ => None,
        };
        [of_kind, Some(self.from), self.lasts]
    }

    /// Returns the names of devices and clients in it.
    pub(super) fn names(&self) -> impl Iterator<Item = &Arc<str>> {
        let receivers = match &self.kind {
            FaultKind::Lose { receivers } | FaultKind::Omit { receivers } => receivers.as_slice(),
            _ => &[],
        };
        receivers.iter().chain(&self.frames.sender)
    }
}

impl FaultKind {
    /// Returns whether it acts between the application that sends a frame and its controller.
    pub(super) const fn acts_at_sender(&self) -> bool {
        matches!(self, Self::Delay { .. } | Self::Repeat { .. } | Self::Swap { .. } | Self::Corrupt(_))
    }
}

impl FrameFilter {
    /// Returns whether the fault can happen to a frame of this sender.
    pub(super) fn passes(&self, sender: &str, frame: &Frame) -> bool {
        self.sender.as_deref().is_none_or(|wanted| wanted == sender)
            && self.id.is_none_or(|id| {
                // The mask covers the number; the format has to be the same.
                let compared = self.mask.unwrap_or(u32::MAX) | !LONGEST;
                (key(id) ^ frame.key()) & compared == 0
            })
    }
}

impl Corruption {
    /// Returns the frame with its changes.
    pub(super) fn apply(&self, frame: &Frame) -> Frame {
        let id = match frame.id() {
            Id::Standard(id) => standard(self.id.apply(id.as_raw().into()) as u16).into(),
            Id::Extended(id) => extended(self.id.apply(id.as_raw())).into(),
        };
        let len = self.dlc.apply(frame.len()).min(MAX_LEN as u8);
        if frame.is_remote() {
            return Frame::remote(id, len);
        }
        let mut data = *frame.bytes();
        data[usize::from(len)..].fill(0);
        for (place, byte) in data[..usize::from(len)].iter_mut().enumerate() {
            let Masks { set, clear, toggle } = self.data;
            *byte = Masks { set: set[place], clear: clear[place], toggle: toggle[place] }.apply(*byte);
        }
        Frame::with_len(id, data, len)
    }
}

impl<T> Masks<T>
where
    T: Copy
        + std::ops::BitOr<Output = T>
        + std::ops::BitAnd<Output = T>
        + std::ops::BitXor<Output = T>
        + std::ops::Not<Output = T>,
{
    fn apply(self, value: T) -> T {
        (value | self.set) & !self.clear ^ self.toggle
    }
}
