//! The spool: a model of the real one, or a measured position (SPEC 2).

use super::Position;

/// What can be wrong with a spool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpoolFault {
    /// Nothing.
    #[default]
    None,
    /// Stuck where it is.
    Stuck,
    /// Moves at a fraction of its rate.
    Slow,
    /// Does not stay where it is told to be.
    Drifting,
    /// Does not reach the float position.
    NoFloat,
}

/// What acts on the spool from outside the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpoolSense {
    /// What is wrong with it.
    pub fault: SpoolFault,
    /// Where the hand lever pushes it, while it does.
    pub lever: Option<Position>,
    /// The position that a sensor reads, on a board that has one: takes the model's place.
    pub measured: Option<Position>,
}
