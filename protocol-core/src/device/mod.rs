//! The products, and their common interface [`Device`].
//!
//! A device is sans-IO: frames, time and inputs go in; frames, effects and outputs come out. It never blocks, reads no
//! clock and accesses no hardware. [`pump`](crate::pump::pump) connects it to a controller.

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

/// An action that a device demands of its platform.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Write this record, then call [`Device::stored`]. The next write is handed out only after that call.
    Store(RecordKey, Record),
    /// Run the bus at this bit rate from now on. The device has already [aborted](Device::take_abort) all frames.
    SetBitRate(BitRate),
    /// Read the memory again, call [`Device::restart`], then set the controller to [`Device::bit_rate`].
    Restart(Restart),
}

/// The scope of a restart (CiA 301, NMT), narrower first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Restart {
    /// Reset communication: the communication objects only.
    Communication,
    /// Reset application, and every other full restart.
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

/// The cause of a power-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StartCause {
    /// The power was switched on.
    #[default]
    PowerOn,
    /// The watchdog or a panic reset the processor, which raises the internal error.
    Watchdog,
}

/// A simulated device on the bus, independent of protocol and product.
///
/// The time of a device never runs backwards: a `now` before that of the previous call counts as the time of the
/// previous call. So does a `now` of 2^63 µs or more, which no clock reaches.
pub trait Device {
    /// Handles a received frame. Returns whether the frame was for the device; other frames have no effect.
    fn handle(&mut self, frame: &Frame, now: Instant) -> bool;

    /// Returns the receive filters of the device after its start and after every change; `None` otherwise. The filters
    /// pass every frame for the device, and possibly other frames.
    fn take_filters(&mut self) -> Option<Filters>;

    /// Updates the inputs. Must be called after the start and after every change of the inputs.
    fn sense(&mut self, inputs: &Inputs, now: Instant);

    /// Handles the timers that are due; cheap before [`deadline`](Self::deadline).
    fn poll(&mut self, now: Instant);

    /// Returns a filter for frames that the controller may hold but must no longer send. The caller passes the filter
    /// to [`Controller::abort`], and calls again until the result is `None`.
    ///
    /// [`Controller::abort`]: crate::controller::Controller::abort
    fn take_abort(&mut self) -> Option<Filter>;

    /// Encodes the most urgent pending frame with the state at `now`. Frames of equal identifiers keep their order. The
    /// controller then holds the frame, unless it is [given back](Self::give_back).
    fn next_frame(&mut self, now: Instant) -> Option<Frame>;

    /// Requeues a frame that the controller rejected, or returned in favour of a more urgent frame.
    fn give_back(&mut self, frame: Frame);

    /// Records that by `now` the controller has sent all frames handed to it. Returns whether a further frame can now
    /// be sent.
    fn all_sent(&mut self, now: Instant) -> bool;

    /// Returns the next effect. Stores and bit rates are handed out at any time, so a blocked bus does not delay them.
    /// A restart is handed out only if `all_sent`, so that it does not drop a preceding answer.
    fn next_effect(&mut self, all_sent: bool) -> Option<Effect>;

    /// Reports the result of [`Effect::Store`].
    fn stored(&mut self, key: RecordKey, result: Result<(), StoreError>, now: Instant);

    /// Carries out [`Effect::Restart`] with the present contents of the memory.
    fn restart(&mut self, scope: Restart, memory: &dyn Memory, now: Instant);

    /// Requests all delayed writes immediately, before the platform is switched off.
    fn flush(&mut self, now: Instant);

    /// Returns the time at which [`poll`](Self::poll) is next due; [`NEVER`](crate::time::NEVER) if only a frame or new
    /// inputs can change the state.
    fn deadline(&self) -> Instant;

    /// Returns the outputs of the device.
    fn outputs(&self) -> Outputs;

    /// Returns the bit rate in force.
    fn bit_rate(&self) -> BitRate;

    /// Returns the node ID or address in force; `None` if there is none.
    fn node_id(&self) -> Option<u8>;

    /// Returns the number of answers, EMCYs and broadcasts dropped because of a full queue, bus-off, a change of the
    /// bit rate or the loss of the address. The number is an upper bound. Lost cyclic frames are not counted.
    fn frames_dropped(&self) -> u32;
}
