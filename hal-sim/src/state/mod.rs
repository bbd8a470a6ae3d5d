//! The state of a device, what acts on it, and conditions on both, in the words of the control interface. JSON of the
//! control interface and scenarios in TOML are read by the same types.
//!
//! ```text
//! device     a device's state          plant   what acts on it from outside, and changes of that
//! condition  what can be waited for    watch   a condition that is looked at whenever it may hold
//! power      power and resets          bus     bit rate and disturbances
//! possible   the values that each key of a state can have, by kind
//! identifier CAN identifiers           pattern frames that are meant
//! schema     what is accepted, as JSON schemas, and the reader that follows them
//! given      readers of values that are told apart from missing ones
//! ```

mod bus;
mod condition;
mod device;
mod given;
mod identifier;
mod pattern;
mod plant;
mod possible;
mod power;
pub mod schema;
mod watch;

pub use bus::{BitsPerSecond, BusChange, Disturb};
pub use condition::{Condition, StateCondition};
pub use device::*;
pub use given::{given, given_object};
pub use identifier::Identifier;
pub use pattern::{DATA, DATA_PATTERN, Pattern};
pub use plant::{PlantChange, PlantState};
pub use possible::accepted;
pub use power::{Power, PowerChange, ResetCause};
pub use watch::StateWatch;

/// A value that cannot be: one line that says what is accepted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Invalid(pub String);
