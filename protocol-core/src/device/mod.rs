//! The products, and [`Device`], their common face.
//!
//! A device is sans-IO: frames, time and what it senses go in; frames, effects and outputs come out. It never blocks,
//! reads no clock and touches no hardware. [`pump`](crate::pump::pump) connects one with a controller.

pub mod pve;
mod senses;
mod tx_queue;

pub use senses::{Outputs, Senses};

use crate::controller::{BitRate, Filters};
use crate::frame::Frame;
use crate::memory::{Image, Record, RecordKey, StoreError};
use crate::time::Instant;

/// What a device wants done that is not a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Write this record; answer with [`Device::stored`]. One at a time: the next is handed out after the answer.
    Store(RecordKey, Record),
    /// Run the bus at this bit rate from now on.
    SetBitRate(BitRate),
    /// Read the memory again and call [`Device::restart`], then set the controller to [`Device::bit_rate`].
    Restart(Restart),
}

/// How much of the device starts anew (CiA 301, NMT).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Restart {
    /// Reset communication: the communication objects alone.
    Communication,
    /// Reset application, and what restarts "as after" it.
    Application,
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

/// A device on the bus, whatever it is.
///
/// `now` never runs backwards for a device: an instant earlier than the last one counts as the last one.
pub trait Device {
    /// Takes a frame from the bus. Says whether it was for the device; when it was not, all is as it was.
    fn handle(&mut self, frame: &Frame, now: Instant) -> bool;

    /// Which frames the device listens to, at first and whenever that has changed since this was last asked. Every frame
    /// that means something to it passes one of the filters; many that mean nothing to it pass as well.
    fn take_filters(&mut self) -> Option<Filters>;

    /// Takes what the device senses; to be called when any of it has changed, and once after the start.
    fn sense(&mut self, senses: &Senses, now: Instant);

    /// Lets the timers that are due act; costs next to nothing before [`deadline`](Self::deadline).
    fn poll(&mut self, now: Instant);

    /// The most urgent frame that wants to go out, in the order of arbitration, first come first served among equals.
    fn next_frame(&mut self) -> Option<Frame>;

    /// Takes back a frame that the controller could not take, or gave back for a more urgent one.
    fn give_back(&mut self, frame: Frame);

    /// The next record to be stored, as [`Effect::Store`], whether the bus has taken all that there is to send or not: a bus
    /// that is busy, or that nobody else is on, keeps nothing from being stored.
    fn next_store(&mut self) -> Option<Effect>;

    /// The next thing to be done. To be asked only when [`next_frame`](Self::next_frame) has nothing and the controller
    /// has sent everything: a restart must not swallow the answer sent before it. The device takes the question itself
    /// as the message that all is on the bus by `now`.
    fn next_effect(&mut self, now: Instant) -> Option<Effect>;

    /// Answers [`Effect::Store`].
    fn stored(&mut self, key: RecordKey, result: Result<(), StoreError>, now: Instant);

    /// Answers [`Effect::Restart`] with what the memory holds now.
    fn restart(&mut self, scope: Restart, image: &Image, now: Instant);

    /// Asks for everything that waits to be stored to be stored at once: the platform is about to be switched off.
    fn flush(&mut self, now: Instant);

    /// When [`poll`](Self::poll) is next due; [`NEVER`](crate::time::NEVER) when only a frame or a sense can change anything.
    fn deadline(&self) -> Instant;

    /// What the device drives.
    fn outputs(&self) -> Outputs;

    /// The bit rate that the device wants to run at.
    fn bit_rate(&self) -> BitRate;

    /// The node ID in force; `None` for a device that has none.
    fn node_id(&self) -> Option<u8>;

    /// How many frames were dropped because the transmit queue was full: nothing is lost silently.
    fn frames_dropped(&self) -> u32;
}
