//! The proportional and on/off valve actuators PVEA and PVEO, Series 6 (SPEC 1–4, 6, 7).
//!
//! ```text
//! fault_codes     the codes of the faults: SPEC 3
//! dictionary      the object dictionary, one table          objects    the state behind its objects
//! state_machine   the device state machine of CiA 408       device_control  the valve controlled by it
//! auxiliary_valve the valve controlled by ISO 11783-7 commands
//! found           the records found in the memory at a start
//! records         the payloads of the records
//! identification  the identifiers of UDS lite          sensing    the faults caused by inputs
//! view            the view for people and tools
//! canopen/        the application: a valve on CANopen       isobus/    on ISOBUS
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
