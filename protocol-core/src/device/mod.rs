//! The products, and [`Device`], their common face.
//!
//! A device is sans-IO: frames, time and inputs go in; frames, effects and outputs come out. It never blocks,
//! reads no clock and touches no hardware. [`pump`](crate::pump::pump) connects one with a controller.

mod any;
#[cfg(feature = "names")]
mod description;
pub mod fault_log;
pub mod hat;
mod inputs;
mod kind;
pub mod plant;
pub mod pve;
pub mod reading;
pub mod runtime;
pub mod view;
pub mod writes;

pub use any::AnyDevice;
#[cfg(feature = "names")]
pub use description::{Capabilities, describe};
pub use inputs::{Inputs, Outputs, ProductInputs, ValveOutputs};
pub use kind::{Kind, Protocol, Setup};
pub use view::{View, Viewable};

use crate::canopen::nmt::Reset;
use crate::controller::{BitRate, Filter, Filters};
use crate::frame::Frame;
use crate::memory::{Memory, Record, RecordKey, StoreError};
use crate::time::Instant;

/// A demand of a device on its platform that is not a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Write this record; answer with [`Device::stored`]. One at a time: the next is handed out after the answer.
    Store(RecordKey, Record),
    /// Run the bus at this bit rate from now on. The device has [withdrawn](Device::take_abort) all frames before.
    SetBitRate(BitRate),
    /// Read the memory again and call [`Device::restart`], then set the controller to [`Device::bit_rate`].
    Restart(Restart),
}

/// The scope of a restart (CiA 301, NMT), the narrower scope first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Restart {
    /// Reset communication: the communication objects alone.
    Communication,
    /// Reset application, and what restarts "as after" it.
    Application,
}

impl From<Reset> for Restart {
    fn from(reset: Reset) -> Self {
        match reset {
            Reset::Communication => Self::Communication,
            Reset::Application => Self::Application,
        }
    }
}

/// Why the device is powered up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StartCause {
    /// Power came on.
    #[default]
    PowerOn,
    /// The watchdog, or a panic, reset the processor: raises the internal error.
    Watchdog,
}

/// A stand-in on the bus, whatever its protocol and product.
///
/// `now` never runs backwards for a device: an instant earlier than the last one counts as the last one. So does an instant
/// from 2^63 µs on, to which no clock comes.
pub trait Device {
    /// Takes a frame from the bus. Returns whether it was for the device; a frame for another changes nothing.
    fn handle(&mut self, frame: &Frame, now: Instant) -> bool;

    /// Returns the filters of the device: at first, and whenever they have changed. Every frame for the device passes
    /// one of them; many others pass as well.
    fn take_filters(&mut self) -> Option<Filters>;

    /// Takes the inputs; to be called when any of them has changed, and once after the start.
    fn sense(&mut self, inputs: &Inputs, now: Instant);

    /// Lets the timers that are due act; costs next to nothing before [`deadline`](Self::deadline).
    fn poll(&mut self, now: Instant);

    /// Returns the identifiers of frames that the controller took and that must not go out any more:
    /// [`Controller::abort`] them, and ask again until there are none.
    ///
    /// [`Controller::abort`]: crate::controller::Controller::abort
    fn take_abort(&mut self) -> Option<Filter>;

    /// Makes the most urgent pending frame, as things are at `now`: in the order of arbitration, first come first
    /// served among equals. The frame counts as the controller's until it is [given back](Self::give_back).
    fn next_frame(&mut self, now: Instant) -> Option<Frame>;

    /// Takes back a frame that the controller could not take, or gave back for a more urgent one, and queues it again.
    fn give_back(&mut self, frame: Frame);

    /// Takes note that every frame which the controller took is on the bus by `now`. Returns whether that makes another
    /// one ready to be sent.
    fn all_sent(&mut self, now: Instant) -> bool;

    /// Returns the next effect. A store and a new bit rate are handed out at any time: a bus that takes
    /// nothing keeps neither waiting. A restart is handed out only when `all_sent`: it must not swallow the answer
    /// before it.
    fn next_effect(&mut self, all_sent: bool) -> Option<Effect>;

    /// Answers [`Effect::Store`].
    fn stored(&mut self, key: RecordKey, result: Result<(), StoreError>, now: Instant);

    /// Answers [`Effect::Restart`] with what the memory holds now.
    fn restart(&mut self, scope: Restart, memory: &dyn Memory, now: Instant);

    /// Stores everything pending at once: the platform is about to be switched off.
    fn flush(&mut self, now: Instant);

    /// Returns when [`poll`](Self::poll) is next due; [`NEVER`](crate::time::NEVER) when only a frame or a sense can
    /// change anything.
    fn deadline(&self) -> Instant;

    /// Returns the outputs of the device.
    fn outputs(&self) -> Outputs;

    /// Returns the bit rate that the device is set to.
    fn bit_rate(&self) -> BitRate;

    /// Returns the node ID in force; `None` for a device that has none.
    fn node_id(&self) -> Option<u8>;

    /// Returns the number of dropped frames: for want of room in the queue, by bus-off, or during a change of the bit
    /// rate. No frame is lost silently.
    fn frames_dropped(&self) -> u32;
}
