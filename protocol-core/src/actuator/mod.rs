//! The valve without a protocol: set-point, spool, monitors, faults, power save and LED (SPEC 2).
//!
//! Nothing here knows a CAN identifier, an object dictionary or a diagnostic code: the protocols present what the
//! [`Valve`] says.

mod led;
mod set_point;
mod spool;

pub use led::{Color, Led};
pub use set_point::{Position, Scale, SetPoint};
pub use spool::{SpoolFault, SpoolSense};
