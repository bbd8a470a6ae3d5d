//! What a use case is: a list of steps, in the manuals' notation.

use protocol_core::controller::BitRate;

use crate::Kind;
use crate::world::Plant;

/// A use case.
#[derive(Clone, Copy, Debug)]
pub struct UseCase {
    /// How it is called for on the command line.
    pub name: &'static str,
    /// What it shows.
    pub title: &'static str,
    /// What is on the bus, besides the master.
    pub devices: &'static [Device],
    /// What happens.
    pub steps: &'static [Step],
}

/// A device on the bus, with a memory that was never written. All of one use case start at the same bit rate.
#[derive(Clone, Copy, Debug)]
pub struct Device {
    /// The product.
    pub kind: Kind,
    /// Its node ID.
    pub node_id: u8,
    /// Its serial number; `None` for the kind's.
    pub serial: Option<u32>,
}

impl UseCase {
    /// Returns the bit rate that its devices start with: that of its master.
    #[must_use]
    pub fn bit_rate(&self) -> BitRate {
        let first = self.devices.first().and_then(|device| device.kind.bit_rates().first());
        first.copied().unwrap_or(BitRate::Kbit250)
    }
}

/// One step. Frames are written as the manual prints them; every one has its meaning beside it.
#[derive(Clone, Copy, Debug)]
pub enum Step {
    /// Explains what follows.
    Note(&'static str),
    /// The devices are switched on; the first time, or again.
    PowerCycle,
    /// The master sends this frame.
    Send(&'static str, &'static str),
    /// The next frame of a device must be this one.
    Expect(&'static str, &'static str),
    /// The next frame of a device must begin like this and go on with this position of the spool.
    ExpectPosition(&'static str, Position, &'static str),
    /// As [`Wait`](Self::Wait), so many milliseconds from the last frame of the master: its cycle.
    Cycle(u64),
    /// So many milliseconds pass, in which the devices send nothing but what is steady.
    Wait(u64),
    /// So many times, in a cycle of so many milliseconds: the first frame is sent and answered by the second.
    Cyclic(u32, u64, (&'static str, &'static str), (&'static str, &'static str)),
    /// What acts on all devices from outside changes.
    Plant(Plant),
    /// In a cycle of so many milliseconds the master sends this frame, at once and from then on, whatever else happens;
    /// in the place of the one before, from its next turn on, in its cycle.
    Repeat(u64, &'static str, &'static str),
    /// The master sends its cyclic frame so many times more.
    Cycles(u32),
    /// The master sends its cyclic frame no more.
    Pause,
    /// As [`Expect`](Self::Expect); and from then on the same frame may come again at any time, until a frame with its
    /// identifier is expected.
    Steady(&'static str, &'static str),
    /// No frame comes again that was steady.
    Unsteady,
    /// The master changes its bit rate.
    MasterBitRate(BitRate),
}

/// A position of the spool, which the bench's own delays may move a little.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position(pub i16);

impl Position {
    /// How far off it may be: a quarter of a millisecond on the spool's way.
    pub const TOLERANCE: i16 = 16;
}
