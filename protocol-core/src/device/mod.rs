//! The products, and their common trait [`Device`].
//!
//! A device is sans-IO: frames, time and inputs go in; frames, effects and outputs come out. A device never blocks,
//! reads no clock and accesses no hardware. The [`pump`](crate::pump::pump) connects it to a controller.

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
    /// Write this record, then call [`Device::stored`]. The device hands out no other write before that call.
    Store(RecordKey, Record),
    /// Change the bit rate of the controller now. The device has [aborted](Device::take_abort) all frames.
    SetBitRate(BitRate),
    /// Read the memory, call [`Device::restart`], then set the controller to [`Device::bit_rate`].
    Restart(Restart),
}

/// The scope of a restart (CiA 301, NMT). A wider scope compares greater.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Restart {
    /// Reset communication: the communication objects restart.
    Communication,
    /// Reset application: the entire device restarts.
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
    /// The watchdog or a panic reset the processor. The device raises the internal error.
    Watchdog,
}

/// A simulated device on the bus, of any protocol and product.
///
/// The time of a device never runs backwards. A `now` before the previous call counts as the time of the previous call.
/// So does a `now` of 2^63 µs or more, which no clock reaches.
pub trait Device {
    /// Handles a received frame. Returns whether the device took the frame. A frame that is not taken has no effect.
    fn handle(&mut self, frame: &Frame, now: Instant) -> bool;

    /// Returns the receive filters once after a start, and once after every change. The filters pass every frame for
    /// the device, and possibly others.
    fn take_filters(&mut self) -> Option<Filters>;

    /// Updates the inputs. The platform calls this function after the start and after every change of the inputs.
    fn sense(&mut self, inputs: &Inputs, now: Instant);

    /// Handles the timers that are due. Before the [`deadline`](Self::deadline) the call costs little.
    fn poll(&mut self, now: Instant);

    /// Returns a filter for frames that the controller may hold but must no longer send. The caller passes it to
    /// [`Controller::abort`], and calls again until the result is `None`.
    ///
    /// [`Controller::abort`]: crate::controller::Controller::abort
    fn take_abort(&mut self) -> Option<Filter>;

    /// Encodes the most urgent pending frame, with the state at `now`. Frames with the same identifier keep their
    /// order. The controller then holds the frame, unless the caller [gives it back](Self::give_back).
    fn next_frame(&mut self, now: Instant) -> Option<Frame>;

    /// Requeues a frame that the controller rejected, or returned in favour of a more urgent frame.
    fn give_back(&mut self, frame: Frame);

    /// Records that the controller has sent all its frames by `now`. Returns whether another frame can be sent now.
    fn all_sent(&mut self, now: Instant) -> bool;

    /// Records that the controller has sent its frames by `now`, except those for which `is_held` returns true for a
    /// filter that passes them.
    fn sent_except(&mut self, is_held: &dyn Fn(Filter) -> bool, now: Instant);

    /// Returns the next effect. Stores and bit rates do not wait for the bus. A restart requires `all_sent`, so that
    /// the answer to the request for the restart is not dropped.
    fn next_effect(&mut self, all_sent: bool) -> Option<Effect>;

    /// Reports the result of [`Effect::Store`].
    fn stored(&mut self, key: RecordKey, result: Result<(), StoreError>, now: Instant);

    /// Executes [`Effect::Restart`] with the present contents of the memory.
    fn restart(&mut self, scope: Restart, memory: &dyn Memory, now: Instant);

    /// Requests all delayed writes at once, before the platform is switched off.
    fn flush(&mut self, now: Instant);

    /// Returns the time at which [`poll`](Self::poll) is next due; [`NEVER`](crate::time::NEVER) while only frames and
    /// inputs can change the state.
    fn deadline(&self) -> Instant;

    /// Returns the outputs of the device.
    fn outputs(&self) -> Outputs;

    /// Returns the bit rate in force.
    fn bit_rate(&self) -> BitRate;

    /// Returns the node ID or address in force.
    fn node_id(&self) -> Option<u8>;

    /// Returns the number of answers, EMCYs and broadcasts that were dropped: because of a full queue, bus-off, a
    /// change of the bit rate or the loss of the address. The controller may have sent some of them. Cyclic frames are
    /// not counted.
    fn frames_dropped(&self) -> u32;
}
