//! The state of a device, its plant, and conditions on the state, in the words of the control interface. JSON of the
//! control interface and TOML of scenarios are parsed into the same types. [`schema::Schemas::check`] validates input
//! before the input is parsed: a derived deserialiser also accepts null for a missing key, and a list for an object.
//!
//! ```text
//! device     the state of a device      plant   the plant of a device, and its changes
//! condition  conditions to wait for     power   power and resets
//! bus        bit rate and disturbances      words   the plant words as JSON
//! fault      communication faults
//! possible   the values that each key of a state can have, by kind
//! identifier CAN identifiers            pattern patterns of frames
//! schema     JSON schemas of the input, and its validation
//! ```

mod bus;
mod condition;
mod device;
mod fault;
mod identifier;
mod pattern;
mod plant;
mod possible;
mod power;
pub mod schema;
mod words;

pub use bus::{BitsPerSecond, BusChange, Disturb};
pub use condition::{Condition, StateCondition, StateWatch};
pub use device::*;
pub use fault::{DataMasks, DlcMasks, FaultRecord, FaultRequest, IdentifierMasks, Millis};
pub(crate) use identifier::digits;
pub use identifier::{Identifier, IdentifierOrAll, raw};
pub use pattern::{DATA, DATA_PATTERN, Pattern};
pub use plant::{CRANKING, PlantChange, PlantState, Points, Profile, ReadyProfile};
pub use power::{Power, PowerChange, ResetCause};
pub use words::json_of;

/// The error message for an invalid value: one line, with the accepted values.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Invalid(pub String);
