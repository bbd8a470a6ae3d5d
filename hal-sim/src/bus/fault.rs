//! Specifications of communication faults: the affected frames, the timing, the number and the effect.

use std::sync::Arc;

use protocol_core::frame::{Frame, Id, MAX_LEN, extended, key, standard};
use protocol_core::time::Duration;

/// The maximum number of faults.
pub const MAX_FAULTS: usize = 64;

/// The maximum number of copies that [`FaultKind::Repeat`] sends of a frame.
pub const MAX_REPEATS: u32 = 1000;

/// The probability of a fault that affects every frame, in millionths.
pub const ALWAYS: u32 = 1_000_000;

/// The maximum value of each time parameter.
const LONGEST_TIME: Duration = Duration::from_secs(24 * 60 * 60);

/// The mask of all 29 identifier bits.
const LONGEST: u32 = 0x1FFF_FFFF;

/// The number of a fault, unique on its bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct FaultId(pub(super) u64);

/// A communication fault on a bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The name of the fault, unique among the active faults.
    pub name: Arc<str>,
    /// The effect on the frames.
    pub kind: FaultKind,
    /// The frames that the fault can affect.
    pub frames: FrameFilter,
    /// The maximum number of affected frames; `None` is unlimited.
    pub count: Option<u32>,
    /// The probability that the fault affects a matching frame, in millionths, up to [`ALWAYS`].
    pub probability: u32,
    /// The seed of the random choices.
    pub seed: u64,
    /// The time from the addition of the fault to its start.
    pub from: Duration,
    /// The duration of the fault; `None` is unlimited.
    pub lasts: Option<Duration>,
}

/// A filter for the frames that a fault can affect. A frame must satisfy all conditions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameFilter {
    /// The identifier; `None` for any.
    pub id: Option<Id>,
    /// The identifier bits to compare; `None` for all.
    pub mask: Option<u32>,
    /// The name of the sending device or client; `None` for any.
    pub sender: Option<Arc<str>>,
}

/// The kind of a fault.
///
/// [`Lose`](Self::Lose) acts between the receiving controllers and their applications. [`Destroy`](Self::Destroy) and
/// [`Omit`](Self::Omit) act on the wire. [`Insert`](Self::Insert) sends through a separate controller. All other kinds
/// act between the sending application and its controller; they do not affect external controllers, whose applications
/// are outside the simulated world.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FaultKind {
    /// The frame is sent and acknowledged, but the receiving applications do not receive it.
    Lose {
        /// The names of the affected devices and clients; empty for all.
        receivers: Vec<Arc<str>>,
    },
    /// The frame reaches the sending controller late.
    Delay {
        /// The time by which the frame is late.
        delay: Delay,
        /// True if later frames with the same identifier may overtake this frame.
        overtake: bool,
    },
    /// The frame is sent, followed by copies.
    Repeat {
        /// The number of copies, from 1 to [`MAX_REPEATS`].
        times: u32,
        /// The time from the frame to the first copy, and from one copy to the next.
        after: Duration,
    },
    /// The frame is sent immediately after the sender's next frame, even if a fault delays the next frame.
    Swap {
        /// The maximum wait for the next frame; after this time, the frame is sent without a swap.
        within: Duration,
    },
    /// The frame is sent with changed content and a valid CRC.
    Corrupt(Corruption),
    /// An additional frame is sent, independently of all other traffic.
    Insert {
        /// The frame to insert.
        frame: Frame,
        /// The period; `None` sends the frame once.
        every: Option<Duration>,
    },
    /// A bit error destroys the attempt to send the frame. The controller retransmits the frame.
    Destroy,
    /// Some receivers detect an error in the last but one bit of the end of frame. These receivers discard the frame,
    /// all others accept it, and the sender retransmits it.
    Omit {
        /// The names of the devices and clients that detect the error.
        receivers: Vec<Arc<str>>,
    },
}

/// The delay of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delay {
    /// The same delay for every frame.
    Constant(Duration),
    /// A uniformly distributed delay between two inclusive bounds.
    Uniform(Duration, Duration),
    /// A delay to the next multiple of this period, so that frames arrive in bursts. The first period begins at the
    /// start of the fault.
    Burst(Duration),
}

/// Changes to the content of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Corruption {
    /// The changes to the identifier.
    pub id: Masks<u32>,
    /// The changes to the data length code. A result above 8 becomes 8. Additional data bytes are 0 before `data`
    /// applies.
    pub dlc: Masks<u8>,
    /// The changes to the data, first byte first.
    pub data: Masks<[u8; MAX_LEN]>,
}

/// Bit masks, applied in the order set, clear, toggle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Masks<T> {
    /// Bits that become 1.
    pub set: T,
    /// Bits that become 0.
    pub clear: T,
    /// Bits that are inverted.
    pub toggle: T,
}

/// The effect of a fault on a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FaultEffect {
    /// The named receivers do not receive the frame; an empty list means all receivers.
    Lost(Vec<Arc<str>>),
    /// The handover of the frame to the sending controller is delayed by this time.
    Delayed(Duration),
    /// The frame is sent this many additional times.
    Repeated(u32),
    /// The frame is held back until after the sender's next frame.
    Swapped,
    /// This frame is sent instead of the original.
    Corrupted(Frame),
    /// The frame was inserted.
    Inserted,
    /// The attempt to send the frame is destroyed.
    Destroyed,
    /// The named receivers discard the frame; all others accept it, and the sender retransmits it.
    Omitted(Vec<Arc<str>>),
}

/// The reason why a fault cannot be added.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FaultError {
    /// Another active fault has the same name.
    #[error("a fault named '{0}' is already active")]
    Taken(Arc<str>),
    /// [`MAX_FAULTS`] faults are already active.
    #[error("{MAX_FAULTS} faults are active: end one first")]
    TooMany,
    /// No device or client on the bus has this name.
    #[error("no device or client '{name}'; known: {known}")]
    Unknown {
        /// The unknown name.
        name: Arc<str>,
        /// The names on the bus.
        known: String,
    },
    /// A parameter is out of range or contradicts another parameter, or a [`FaultKind::Lose`] names a client that uses
    /// no received frames.
    #[error("{0}")]
    Invalid(String),
}

impl Fault {
    /// Creates a fault that affects all frames, starts immediately and lasts until it is ended.
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

    /// Validates the parameters of the fault.
    ///
    /// # Errors
    /// [`FaultError::Invalid`] if a parameter is out of range or contradicts another parameter.
    pub fn check(&self) -> Result<(), FaultError> {
        let refuse = |reason: &str| Err(FaultError::Invalid(reason.to_owned()));
        if self.probability > ALWAYS {
            return refuse("the probability must not exceed 1");
        }
        if self.count == Some(0) {
            return refuse("count must be at least 1");
        }
        if self.lasts.is_some_and(|lasts| lasts.as_ticks() == 0) {
            return refuse("the duration must be above 0");
        }
        if self.frames.mask.is_some() && self.frames.id.is_none() {
            return refuse("a mask needs an identifier");
        }
        if self.times().into_iter().flatten().any(|time| time > LONGEST_TIME) {
            return refuse("durations must not exceed one day");
        }
        match &self.kind {
            FaultKind::Delay { delay: Delay::Uniform(from, to), .. } if from > to => {
                refuse("the first bound of the delay must not exceed the second")
            }
            FaultKind::Delay { delay: Delay::Burst(period), .. } if period.as_ticks() == 0 => {
                refuse("the burst period must be above 0")
            }
            FaultKind::Repeat { times, .. } if !(1..=MAX_REPEATS).contains(times) => {
                refuse("times must be from 1 to 1000")
            }
            FaultKind::Corrupt(corruption) if *corruption == Corruption::default() => {
                refuse("corrupt needs at least one mask")
            }
            FaultKind::Insert { every: Some(every), .. } if every.as_ticks() == 0 => {
                refuse("the period must be above 0")
            }
            FaultKind::Insert { every: None, .. } if self.count.is_some() => {
                refuse("insert accepts a count only together with a period")
            }
            FaultKind::Insert { .. } if self.frames != FrameFilter::default() => {
                refuse("insert does not accept a frame filter")
            }
            FaultKind::Omit { receivers } if receivers.is_empty() => refuse("omit needs receivers"),
            _ => Ok(()),
        }
    }

    /// Returns the time parameters of the fault.
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

    /// Returns the names of the devices and clients that the fault refers to.
    pub(super) fn names(&self) -> impl Iterator<Item = &Arc<str>> {
        let receivers = match &self.kind {
            FaultKind::Lose { receivers } | FaultKind::Omit { receivers } => receivers.as_slice(),
            _ => &[],
        };
        receivers.iter().chain(&self.frames.sender)
    }
}

impl FaultKind {
    /// Returns whether the fault acts between the sending application and its controller.
    pub(super) const fn acts_at_sender(&self) -> bool {
        matches!(self, Self::Delay { .. } | Self::Repeat { .. } | Self::Swap { .. } | Self::Corrupt(_))
    }

    /// Returns whether an affected frame counts later: when its first copy is handed over to the controller, or when
    /// the frame is exchanged.
    pub(super) const fn counts_later(&self) -> bool {
        matches!(self, Self::Repeat { .. } | Self::Swap { .. })
    }
}

impl FrameFilter {
    /// Returns whether a frame sent by `sender` passes the filter.
    pub(super) fn passes(&self, sender: &str, frame: &Frame) -> bool {
        self.sender.as_deref().is_none_or(|wanted| wanted == sender)
            && self.id.is_none_or(|id| {
                // The mask applies to the identifier's value; the identifier formats must always be equal.
                let compared = self.mask.unwrap_or(u32::MAX) | !LONGEST;
                (key(id) ^ frame.key()) & compared == 0
            })
    }
}

impl Corruption {
    /// Applies the changes to a frame.
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
