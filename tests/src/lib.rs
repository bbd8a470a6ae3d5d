//! What the tests share.
//!
//! ```text
//! rig                   one device on a bus of its own: for what a device says and does
//! senses                what a valve senses
//! hostile               what can happen to any device, for random tests
//! nmt, lss, sdo, uds    frames of these services, which read like the manuals
//! isobus                a valve on ISOBUS on the rig
//! bus_rig               valves and a master in a simulated world: for bus errors, flashes, several devices
//! ```

mod bus_rig;
pub mod hostile;
pub mod isobus;
pub mod lss;
pub mod nmt;
mod rig;
pub mod sdo;
mod senses;
pub mod uds;

pub use bus_rig::BusRig;
pub use rig::{Rig, frame};
pub use senses::Senses;
