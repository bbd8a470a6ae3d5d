//! The valve actuators PVEA (proportional) and PVEO (on/off), Series 6 (SPEC 1–4, 6, 7).
//!
//! ```text
//! fault_codes      codes of the faults (SPEC 3)
//! dictionary       object dictionary                     objects         values of the objects, and rules
//! state_machine    device state machine of CiA 408       device_control  the valve under this state machine
//! auxiliary_valve  the valve under ISO 11783-7 commands
//! found            records in the memory at a start      records         payloads of the records
//! identification   identifiers of UDS lite               sensing         inputs that cause faults
//! view             view for people and tools
//! canopen/         application of a valve on CANopen     isobus/         application of a valve on ISOBUS
//! ```

mod auxiliary_valve;
mod canopen;
mod device_control;
mod dictionary;
mod fault_codes;
mod found;
mod identification;
mod isobus;
mod objects;
mod records;
mod sensing;
mod state_machine;
mod view;

pub use super::Protocol;
pub use super::kind::pve::Kind;
pub use canopen::PveCanopen;
pub use dictionary::entry;
pub use fault_codes::{FAULT_CODES, FaultCodes};
pub use isobus::PveIsobus;
#[cfg(feature = "names")]
pub(super) use objects::describe;
pub use state_machine::{DeviceMode, DeviceState};

/// The setup of a valve.
pub type Setup = super::Setup<Kind>;
