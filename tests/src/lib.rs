//! The common parts of the tests.
//!
//! ```text
//! rig                   one device on a bus
//! inputs                inputs of a valve
//! hostile               disturbances of any device, for random tests
//! nmt, lss, sdo, uds    frames of these services, in the notation of the manuals
//! isobus                a valve on ISOBUS on the rig
//! bus_rig               valves and a master in a simulated world, for bus errors, flashes and several devices
//! ```

mod bus_rig;
pub mod hostile;
mod inputs;
pub mod isobus;
pub mod lss;
pub mod nmt;
mod rig;
pub mod sdo;
pub mod uds;

pub use bus_rig::BusRig;
pub use inputs::Inputs;
pub use rig::{Rig, frame};

/// Eight bytes, which begin with these; the others are 0.
fn eight(bytes: &str) -> String {
    format!("{bytes}{}", " 00".repeat(8 - bytes.split(' ').count()))
}
